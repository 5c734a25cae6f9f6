"""A footprint as queries see it: clipped to the part of the shutter that they share, and placed on its trajectory."""

from __future__ import annotations

from functools import cache

import warp as wp

from tpdwarp.footprints.bspline import Trajectory
from tpdwarp.footprints.lines import is_line
from tpdwarp.footprints.shaping import FootprintArrays

# Parts of the shutter that are a smaller part of what a footprint or query stands for count as nothing: some 16
# roundings of times of order one.
SHORTEST_OVERLAP = wp.constant(1.0e-6)
# Added to how far off its plane a footprint reaches: rounding of positions in a scene of unit size, of which a path
# gathers a hundred or so (docs/rounding.md).
PLANE_ROUNDING = wp.constant(1.0e-5)
# Light that grazes a facet so much that its normal makes more of a difference than this is too little to be known.
# Chosen, not derived: light 3.6° above a facet.
LARGEST_SHADING_RATIO = wp.constant(16.0)


@wp.struct
class TimeWindow:
    """The part of the shutter that a query stands for.

    The query stands at its position at ``time`` (−½ … ½), and goes by ``motion`` over the whole shutter; it looks from
    ``center`` − ½ ``length`` to ``center`` + ½ ``length``.
    """

    time: float
    center: float
    length: float
    motion: wp.vec3


@wp.struct
class PlacedFootprint:
    """A footprint over the part of the shutter that it shares with a query, relative to that query.

    ``center`` is where it stands in the middle of that part, ``since`` how long after the query's own time that is.
    ``density`` is Φ |det M| times that part by what the query stands for; ``overlap`` is false where they share none.
    ``incidence`` is −ω/|ω·n_g|, for :func:`shading_ratio`.
    """

    receiver: int
    center: wp.vec3
    normal: wp.vec3
    row_u: wp.vec3
    row_v: wp.vec3
    density: wp.vec3
    plane_tolerance: float
    incidence: wp.vec3
    trajectory: Trajectory
    since: float
    overlap: bool


@wp.func
def shading_ratio(incidence: wp.vec3, n_s: wp.vec3) -> float:
    """|ω·n_s| / |ω·n_g|: photons fall by the geometric normal of a receiver, and light shades by its shading normal.

    Departs from the paper, whose receivers are flat. Where light grazes a facet the ratio grows without bound.
    """
    return wp.clamp(wp.dot(incidence, n_s), 0.0, LARGEST_SHADING_RATIO)


@cache
def place_footprint(smooth: bool, moves: bool, curved: bool, shaded: bool) -> wp.Function:
    """The function that places footprint ``j`` of Eq. 8 for a query, specialised by what footprints do.

    Velocity is relative (the paper, section 2): the query's own displacement is subtracted from the footprint's. Beyond
    the paper: the part of the shutter that the two share, and trajectories that curve.
    """

    @wp.func
    def place(
        footprints: FootprintArrays, durations: wp.array(dtype=wp.float32), j: int, window: TimeWindow
    ) -> PlacedFootprint:
        out = PlacedFootprint()
        out.receiver = footprints.receiver[j]
        out.normal = footprints.normal[j]
        if wp.static(shaded):
            out.incidence = footprints.incidence[j]
        out.plane_tolerance = footprints.plane_tolerance[j] + PLANE_ROUNDING
        center = footprints.center[j]
        row_u = footprints.row_u[j]
        row_v = footprints.row_v[j]
        density = footprints.density[j]
        trajectory = Trajectory()
        overlap = bool(True)
        if wp.static(smooth):
            trajectory.filter_width = footprints.filter_width[j]
            trajectory.pixel = footprints.pixel[j]
            trajectory.is_cell = footprints.is_cell[j]
        if wp.static(moves):
            # ---- Clip the shutter: the part that the query's window and the photon's own shutter have in common
            photon_time = footprints.time[j]
            duration = durations[j]
            opening = photon_time - 0.5 * duration
            closing = photon_time + 0.5 * duration
            share = float(1.0)
            if window.length < 1.0 or wp.length_sq(window.motion) > 0.0:
                opening = wp.max(window.center - 0.5 * window.length, opening)
                closing = wp.min(window.center + 0.5 * window.length, closing)
                share = window.length
            length = closing - opening
            overlap = length > SHORTEST_OVERLAP * share * duration
            middle = 0.5 * (opening + closing)
            out.since = middle - window.time
            part = length / duration
            late = (middle - photon_time) / duration

            # ---- Place the footprint on its trajectory, at the middle of that part
            motion = footprints.dxdt[j]
            center += late * motion
            if wp.static(curved):
                acceleration = footprints.acceleration[j]
                jerk = footprints.jerk[j]
                rate = footprints.jacobian_rate[j]
                center += (0.5 * late * late) * (acceleration + (late / 3.0) * jerk)
                motion += late * (acceleration + (0.5 * late) * jerk)
                acceleration += late * jerk
                gain = footprints.gain[j]
                flux_then = 1.0 + late * gain
                density = density * flux_then
                trajectory.gain = part * gain / flux_then
                if late != 0.0:
                    # The same trajectory, with the axes as they are in the middle of the part.
                    grown = wp.identity(n=2, dtype=float) + late * rate
                    inverse = wp.inverse(grown)
                    row_then = inverse[0, 0] * row_u + inverse[0, 1] * row_v
                    row_v = inverse[1, 0] * row_u + inverse[1, 1] * row_v
                    row_u = row_then
                    density = density * wp.abs(wp.determinant(inverse))
                    width = trajectory.filter_width
                    v_scale = inverse[1, 1]
                    trajectory.filter_width = wp.vec3(inverse[0, 0] * width[0], v_scale * width[1], v_scale * width[2])
                    trajectory.pixel = inverse * trajectory.pixel
                    rate = inverse * rate
                trajectory.straight = wp.length_sq(acceleration) + wp.length_sq(jerk) + wp.ddot(rate, rate) == 0.0
                second = part * part
                third = part * part * part
                trajectory.acceleration = second * wp.vec2(wp.dot(row_u, acceleration), wp.dot(row_v, acceleration))
                trajectory.jerk = third * wp.vec2(wp.dot(row_u, jerk), wp.dot(row_v, jerk))
                trajectory.jacobian_rate = part * rate
            swept = part * motion - length * window.motion
            trajectory.velocity = wp.vec2(wp.dot(row_u, swept), wp.dot(row_v, swept))
            if wp.static(smooth):
                trajectory.passes = is_line(trajectory)
            density = density * (length / (share * duration))
        out.center = center
        out.row_u = row_u
        out.row_v = row_v
        out.density = density
        out.trajectory = trajectory
        out.overlap = overlap
        return out

    return place
