"""Wide footprints as parabolas: what they add to a run of queries is added up before it is evaluated.

A footprint that is much larger than a run is nearly a parabola over it. So the parabolas of all wide footprints that a
run meets are summed, and evaluated once at each query: faint wide ones cost next to nothing.
"""

from __future__ import annotations

import warp as wp


@wp.struct
class Parabola:
    """Irradiance at the displacement d from the middle of a run: value + slopes d + dᵀ curvature d, by channel."""

    used: bool
    value: wp.vec3
    slopes: wp.mat33
    curvature_r: wp.mat33
    curvature_g: wp.mat33
    curvature_b: wp.mat33


@wp.func
def parabola_at(parabola: Parabola, d: wp.vec3) -> wp.vec3:
    """Their part of the sum of Eq. 8 at ``d`` from the middle of the run, no less than zero."""
    curved = wp.vec3(
        wp.dot(d, parabola.curvature_r * d), wp.dot(d, parabola.curvature_g * d), wp.dot(d, parabola.curvature_b * d)
    )
    return wp.max(parabola.value + parabola.slopes * d + curved, wp.vec3(0.0, 0.0, 0.0))
