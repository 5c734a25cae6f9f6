"""Footprints that go far: lines have the light that nodes along the way add up to."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from tests.footprints.photons import ONE_THREAD
from tpdwarp.footprints.bspline import Trajectory, bspline_weight
from tpdwarp.footprints.lanes import CPU_LANES as LANE_COUNT
from tpdwarp.footprints.lanes import Lanes as AnyLanes
from tpdwarp.footprints.lines import is_line
from tpdwarp.footprints.lines import line_weights as any_line_weights

# In parts of the light: what nodes err by at the edges of pixels, and a hundredth at the ends of a line, where its
# profile along itself is taken for a box.
LARGEST_ERROR = 0.015
# Two B-splines at right angles are, across a line that is slanted to both, one of the same variance but for .03 of it.
SLANTED = 0.035

Lanes = AnyLanes.of(LANE_COUNT)
line_weights = any_line_weights.of(LANE_COUNT)
along_nodes = bspline_weight(LANE_COUNT, True, True)


@wp.kernel(enable_backward=False)
def weigh(
    base: int,
    u: wp.array(dtype=Lanes),
    v: wp.array(dtype=Lanes),
    trajectory: Trajectory,
    lines: wp.array(dtype=Lanes),
    nodes: wp.array(dtype=Lanes),
    chosen: wp.array(dtype=wp.int32),
):
    i = base + wp.tid()
    lines[i] = line_weights(u[i], v[i], trajectory)
    nodes[i] = along_nodes(u[i], v[i], trajectory)
    chosen[i] = int(is_line(trajectory))


def trajectory(velocity, acceleration=(0, 0), jerk=(0, 0), rate=(0, 0, 0, 0), gain=0.0, width=(0, 0, 0), pixel=None):
    out = Trajectory()
    out.velocity, out.acceleration, out.jerk = wp.vec2(*velocity), wp.vec2(*acceleration), wp.vec2(*jerk)
    out.jacobian_rate, out.gain, out.filter_width = wp.mat22(*rate), gain, wp.vec3(*width)
    if pixel is not None:
        out.pixel, out.is_cell = wp.mat22(*pixel), 1
    out.straight = not any((*acceleration, *jerk, *rate))
    return out


def weights(given: Trajectory, half: float, count: int = 64) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Weights by lines and by nodes on a grid of squares of four by four queries, if it is a line, a query's area."""
    side = 4 * count
    x = (np.arange(side) + 0.5) / side * 2 * half - half
    u, v = (
        a.reshape(count, 4, count, 4).transpose(0, 2, 1, 3).reshape(-1, LANE_COUNT).astype(np.float32)
        for a in np.meshgrid(x, x)
    )
    out = [ONE_THREAD.zeros(count**2, Lanes) for _ in range(2)]
    chosen = ONE_THREAD.zeros(count**2, wp.int32)
    at = [wp.array(a, dtype=Lanes, device="cpu") for a in (u, v)]
    ONE_THREAD(weigh, count**2, [*at, given, *out, chosen])
    lines, nodes = (array.numpy().astype(np.float64) for array in out)
    return lines, nodes, chosen.numpy(), (2 * half / side) ** 2


FAST = {
    "along an axis": dict(velocity=(50, 0)),
    "slanted": dict(velocity=(40, 25)),
    "boxes": dict(velocity=(60, -45), width=(2, 1.5, 0)),
    "thin": dict(velocity=(90, 70), width=(0, 4, 2)),
    "cell": dict(velocity=(50, 30), pixel=(3, 1, -0.5, 2)),
    "cell along an axis": dict(velocity=(0, 60), pixel=(3, 0, 0, 3)),
    "oblique cell": dict(velocity=(85, 86), pixel=(4.5, -4.89, 4.43, -44.42)),
    "curved": dict(velocity=(50, 35), acceleration=(6, -8), jerk=(4, 0), pixel=(3, 1, -0.5, 2)),
    "growing": dict(velocity=(50, 35), rate=(0.4, 0, 0, -0.3), gain=0.6),
}  # fmt: skip


@pytest.mark.parametrize("what", FAST)
def test_lines_have_the_light_of_nodes_along_the_way(what):
    lines, nodes, chosen, area = weights(trajectory(**FAST[what]), 60.0)
    assert chosen.all()
    assert lines.sum() * area == pytest.approx(1.0, abs=0.01)
    allowed = SLANTED if what in ("slanted", "growing") else LARGEST_ERROR
    assert np.abs(lines - nodes).sum() < allowed * nodes.sum()


def test_in_the_middle_a_straight_line_is_exact():
    given = trajectory((0, 60), pixel=(3, 0, 0, 3))
    lines, nodes, _, _ = weights(given, 4.0, 16)
    # Nodes see the edges of pixels to two hundredths.
    np.testing.assert_allclose(lines, nodes, atol=2e-2 * nodes.max())
    # A cell and a pixel thrice as wide: two boxes of these sides, at rest across, over the way.
    assert lines.max() == pytest.approx(1.0 / 3.0 / 60.0, rel=1e-3)


@pytest.mark.parametrize("velocity", [(5, 0), (0, 5), (3.9, 2.9)])
def test_the_shortest_lines_are_dark_beyond_where_they_end(velocity):
    """A B-spline that goes little farther than three times what it reaches over to one side."""
    lines, nodes, chosen, area = weights(trajectory(velocity), 8.0)
    assert chosen.all()
    assert lines[nodes == 0].sum() * area < 2e-3


SLOW = {
    "slow": dict(velocity=(3, 2)),
    "a slow cell": dict(velocity=(12, 12), pixel=(3, 0, 0, 3)),
    "turning": dict(velocity=(50, 0), acceleration=(0, 80)),
    "a disc": dict(velocity=(90, 0), width=(2, 3, -1)),
}  # fmt: skip


@pytest.mark.parametrize("what", SLOW)
def test_what_is_slow_or_turns_or_is_a_disc_is_no_line(what):
    assert not weights(trajectory(**SLOW[what]), 1.0, 1)[2].any()
