"""Where a camera path stands before it meets a surface, so that branches begin there and not at the camera again.

As for photons (:mod:`tpdwarp.photons.path_state`): all of a path before a branch is that of the path which reported it.
"""

from __future__ import annotations

import warp as wp

from tpdwarp.photons.beam import Beam


@wp.struct
class ViewState:
    """A camera path on its way from one surface to the next.

    ``start`` and ``end`` are where along the beam the next surface is looked for, ``passed_by`` and ``travelled`` what
    lies behind it, without and with surfaces that act, ``depth_scale`` is the depth of a unit of the camera's ray and
    ``depth`` that of what was met first (−1: nothing yet), ``inside`` are the media that it is in, ``decision`` is the
    number of its next decision, ``bounce`` that of surfaces met; ``flags`` and random numbers go on.
    """

    beam: Beam
    throughput: wp.vec3
    stream: wp.uint32
    start: float
    end: float
    passed_by: float
    travelled: float
    depth_scale: float
    depth: float
    inside: int
    decision: int
    bounce: int
    flags: int


@wp.func
def view_state(
    beam: Beam,
    throughput: wp.vec3,
    stream: wp.uint32,
    start: float,
    end: float,
    passed_by: float,
    travelled: float,
    depth_scale: float,
    depth: float,
    inside: int,
    decision: int,
    bounce: int,
    flags: int,
) -> ViewState:
    """The state of these parts."""
    out = ViewState()
    out.beam = beam
    out.throughput = throughput
    out.stream = stream
    out.start = start
    out.end = end
    out.passed_by = passed_by
    out.travelled = travelled
    out.depth_scale = depth_scale
    out.depth = depth
    out.inside = inside
    out.decision = decision
    out.bounce = bounce
    out.flags = flags
    return out
