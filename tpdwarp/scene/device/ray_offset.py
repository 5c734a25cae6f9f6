"""Ray offsets: how far off a surface a ray starts that leaves it, so that it does not meet that surface again."""

import warp as wp

# A part of the coordinates of the triangle at hand: about 64 units in their last place (float32 has 2⁻²⁴), which covers
# the rounding of the hit, of the ray and of the traversal together, while thin layers stay as good as thick ones.
OFFSET_BY_MAGNITUDE = wp.constant(4.0e-6)
# A part of the triangle's size, for triangles in the planes x = 0, y = 0, z = 0, whose coordinates there vanish.
OFFSET_BY_SIZE = wp.constant(4.0e-9)


@wp.func
def ray_offset(n_g: wp.vec3, magnitude: wp.vec3, size: float) -> float:
    """Distance along the normal of a triangle with coordinates up to ``magnitude`` and edges of about ``size``."""
    return OFFSET_BY_MAGNITUDE * wp.dot(wp.abs(n_g), magnitude) + OFFSET_BY_SIZE * size
