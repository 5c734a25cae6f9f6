"""Where a path stands before it meets a surface, so that branches begin there and not at the light again.

All of a path before a branch is that of the path which reported it (:mod:`tpdwarp.photons.branching`). Inside of
solids, where branches branch again, that is most of it.
"""

from __future__ import annotations

import warp as wp

from tpdwarp.photons.beam import Beam
from tpdwarp.photons.light_columns import LightColumns


@wp.struct
class PathState:
    """A path on its way from one surface to the next, with all that its photon is made of where it lands.

    ``start`` is where along the beam the next surface is looked for, ``inside`` are the media that it is in,
    ``decision`` is the number of its next decision, ``count`` that of its interactions, ``bounce`` of surfaces met.
    """

    beam: Beam
    columns: LightColumns
    emitted: wp.vec3
    flux: wp.vec3
    shift: wp.vec2
    path: wp.uint32
    start: float
    inside: int
    decision: int
    count: int
    bounce: int


@wp.func
def path_state(
    beam: Beam,
    columns: LightColumns,
    emitted: wp.vec3,
    flux: wp.vec3,
    shift: wp.vec2,
    path: wp.uint32,
    start: float,
    inside: int,
    decision: int,
    count: int,
    bounce: int,
) -> PathState:
    """The state of these parts."""
    out = PathState()
    out.beam = beam
    out.columns = columns
    out.emitted = emitted
    out.flux = flux
    out.shift = shift
    out.path = path
    out.start = start
    out.inside = inside
    out.decision = decision
    out.count = count
    out.bounce = bounce
    return out
