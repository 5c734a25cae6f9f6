"""How far off a surface rays start that leave it, so that they do not meet it again."""

import warp as wp

# A part of the coordinates of the triangle at hand, about 64 units in their last place, so that a thin layer is as good
# as a thick one; and of its size, for triangles in the plane x = 0.
LIFT = wp.constant(4.0e-6)
SMALLEST_LIFT = wp.constant(4.0e-9)


@wp.func
def lift_off(n_g: wp.vec3, grain: wp.vec3, size: float) -> float:
    """Distance along the normal of a triangle with coordinates up to ``grain`` and edges of about ``size``."""
    return LIFT * wp.dot(wp.abs(n_g), grain) + SMALLEST_LIFT * size
