"""Eq. 8 as it is written down: the gather in which every query meets every footprint.

It is there to be read, and for tests to hold the fast one against.
"""

from __future__ import annotations

from functools import cache

import warp as wp

from tpdwarp.compiler_flags import own_module
from tpdwarp.device import Launcher
from tpdwarp.footprints.footprint_map import FootprintMap
from tpdwarp.footprints.gather import PLAIN_LOOKUP, SMALLEST_COSINE, irradiance_arrays, irradiance_of, time_window
from tpdwarp.footprints.irradiance import Irradiance, IrradianceArrays, Lookup, QueryArrays, has_shading_normals
from tpdwarp.footprints.lanes import Lanes
from tpdwarp.footprints.placing import TimeWindow, place_footprint, shading_ratio
from tpdwarp.footprints.runs import LARGEST_DEVIATION, window_of
from tpdwarp.footprints.shaping import FootprintArrays
from tpdwarp.footprints.weights import GatherForm, footprint_weight


@cache
def plain_gather_kernel(form: GatherForm, moves: bool, curved: bool, shaded: bool) -> wp.Kernel:
    """The sum of Eq. 8 by one thread a query, without groups, tree or parabolas."""
    weight = footprint_weight(form, 1, moves, curved)
    lane = Lanes.of(1)
    place = place_footprint(form.smooth, moves, curved, shaded)

    @wp.kernel(**own_module())
    def plain_gather(
        base: int, footprints: FootprintArrays, durations: wp.array(dtype=wp.float32), run_size: float,
        window: TimeWindow, queries: QueryArrays, out: IrradianceArrays,
    ):  # fmt: skip
        i = base + wp.tid()
        motion = wp.vec3(0.0, 0.0, 0.0)
        if queries.motion.shape[0] > 0:
            motion = queries.motion[i]
        own = window_of(window, motion, (1.0 + LARGEST_DEVIATION) * wp.length(motion), run_size)
        for j in range(footprints.center.shape[0]):
            placed = place(footprints, durations, j, own)
            d = queries.position[i] + placed.since * motion - placed.center
            same = placed.receiver == queries.receiver[i] and placed.overlap
            facing = wp.dot(queries.normal[i], placed.normal) > SMALLEST_COSINE
            if same and facing and wp.abs(wp.dot(placed.normal, d)) <= placed.plane_tolerance:
                weights = weight(lane(wp.dot(placed.row_u, d)), lane(wp.dot(placed.row_v, d)), placed.trajectory)
                w = weights[0]
                if wp.static(shaded):
                    w *= shading_ratio(placed.incidence, queries.shading_normal[i])
                out.irradiance[i] = out.irradiance[i] + w * placed.density

    return plain_gather


def plain_gather(
    footprints: FootprintMap,
    queries: QueryArrays,
    form: GatherForm,
    launcher: Launcher,
    lookup: Lookup = PLAIN_LOOKUP,
) -> Irradiance:
    """Irradiance at ``queries``; the arguments are those of :func:`tpdwarp.footprints.gather.gather`."""
    count = queries.position.shape[0]
    out = irradiance_arrays(count, False, launcher)
    every = footprints.footprints
    moves = every.moves or queries.motion.shape[0] > 0
    shaded = every.shaded and has_shading_normals(queries)
    kernel = plain_gather_kernel(form, moves, every.curved, shaded)
    inputs = [every.arrays, every.durations, footprints.run_size, time_window(lookup), queries, out]
    launcher(kernel, count, inputs)
    return irradiance_of(out, False)
