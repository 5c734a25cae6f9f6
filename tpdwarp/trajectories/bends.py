"""Columns, bends and reaches: what neighbours on the light say of a footprint beside its own columns.

Normals are straight within a triangle, so that D_u x and D_v x are those of the one triangle that a photon met, and
jump from one to the next. A cell that is as large as a triangle or larger has light from several, and long cells have
it from dozens: what the one says of it is chance. The way from the neighbour before to the neighbour after counts all
triangles in between. So half of that way takes the place of a column where its two parts are nearly alike, as they are
where light is smooth over some cells, or differ evenly: half of the way misses a sixth of the third derivative, which
the neighbours of both show. Where light changes from cell to cell, at folds and creases, the column stands.

A footprint stands for a cell, and for what a B-spline reaches over besides, as if D_u x and D_v x were the same all
over it. With D_uu x = ∂_u D_u x they are not: light from the place (a, b) of the lattice lands

    ½ (a² D_uu x + b² D_vv x) + a b D_uv x

beside where first order has it. On average over a kernel of variance κ cells² along u and v that is κ times the bend,

    ½ (D_uu x + D_vv x)

by which a footprint is moved, so that beside folds its light does not fall on the dark side. Second derivatives are the
differences of D_u x and D_v x between neighbours, where these lie as far apart as their columns say.

Where light grazes or is nearly totally reflected, columns grow without bound, and its way to the neighbouring cell
does not. A footprint reaches no farther than its farther neighbour along u or v on the same path. Where there is none
here it keeps its columns: its neighbours may have been traced in other parts of the shutter.

Where light is not smooth in that sense, and moves by its footprint within the shutter, it is not moved by bends, and
light that moves by less by less: on ``scripts/benchmarks/solids.py torus-turning-10`` it erred by .042 with bends there
and by .037 without.

Beyond the paper.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.photons.lattices import EmissionPlan
from tpdwarp.photons.photon_map import PhotonMap, together
from tpdwarp.photons.vectors import lengths
from tpdwarp.trajectories.neighbours import Pairs, neighbours

# Neighbours are of one smooth sheet where the way between them is the mean of their columns, up to this part of the
# longer one: at a fold it is, across the edge of a facet it is not. Chosen, not derived.
LARGEST_MISFIT = wp.constant(0.5)
# Columns are taken from neighbours where the ways to these two, or the turns of these ways from cell to cell, differ by
# up to this part of the column, and the less so up to twice of it. Chosen on the moving solids of
# ``scripts/benchmarks/solids.py`` with 16 384 photons: those err by up to 1.1 times as much where all columns are taken
# so, and with this by .96 to 1.01 times as much as with none.
LARGEST_TURN = wp.constant(0.3)


@wp.struct
class Beside:
    """The photons beside others along one axis of the lattice, on the same path to the same receiver; −1 for none."""

    ahead: wp.array(dtype=wp.int32)
    behind: wp.array(dtype=wp.int32)


@wp.struct
class Widened:
    """A column over whole cells, the part of it that a footprint reaches over, and how far light is smooth around."""

    column: wp.array(dtype=wp.vec3)
    reach: wp.array(dtype=wp.float32)
    smooth: wp.array(dtype=wp.float32)


@wp.kernel(enable_backward=False)
def widen_columns(
    base: int,
    # In
    column: wp.array(dtype=wp.vec3),
    position: wp.array(dtype=wp.vec3),
    beside: Beside,
    # Out
    out: Widened,
):
    """D_u x or D_v x (Eq. 4) over the cells of photons, by the way between neighbours, and its reach."""
    i = base + wp.tid()
    ahead = beside.ahead[i]
    behind = beside.behind[i]
    own = column[i]
    before = wp.vec3(0.0, 0.0, 0.0)
    after = wp.vec3(0.0, 0.0, 0.0)
    if behind >= 0:
        before = position[i] - position[behind]
    if ahead >= 0:
        after = position[ahead] - position[i]
    part = float(0.0)
    limit = LARGEST_TURN * wp.length(own)
    if ahead >= 0 and behind >= 0 and limit > 0.0:
        turn = wp.length(after - before)
        ahead2 = beside.ahead[ahead]
        behind2 = beside.behind[behind]
        if ahead2 >= 0 and behind2 >= 0:
            further = position[ahead2] - position[ahead] + position[behind] - position[behind2]
            turn = wp.min(turn, 0.5 * wp.length(further - before - after))
        part = wp.clamp(2.0 - turn / limit, 0.0, 1.0)
    own = own + part * (0.5 * (before + after) - own)
    farthest = wp.max(wp.length(before), wp.length(after))
    length = wp.length(own)
    out.column[i] = own
    out.smooth[i] = part
    out.reach[i] = 1.0
    if farthest > 0.0 and farthest < length:
        out.reach[i] = farthest / length


@wp.func
def fits(widened: Widened, position: wp.array(dtype=wp.vec3), a: int, b: int) -> bool:
    """Whether the way from one photon to the next is what their columns (Eq. 4) say."""
    one = widened.reach[a] * widened.column[a]
    other = widened.reach[b] * widened.column[b]
    misfit = wp.length(position[b] - position[a] - 0.5 * (one + other))
    return misfit <= LARGEST_MISFIT * wp.max(wp.length(one), wp.length(other))


@wp.kernel(enable_backward=False)
def add_bends(
    base: int,
    # In
    widened: Widened,
    position: wp.array(dtype=wp.vec3),
    normal: wp.array(dtype=wp.vec3),
    resting: wp.array(dtype=wp.float32),
    beside: Beside,
    # Out
    bend: wp.array(dtype=wp.vec3),
):
    """Adds half of the second derivative along one axis (beyond the paper), in the plane of the receiver."""
    i = base + wp.tid()
    here = widened.reach[i] * widened.column[i]
    low = here
    high = here
    sides = int(0)
    ahead = beside.ahead[i]
    if ahead >= 0:
        if fits(widened, position, i, ahead):
            high = widened.reach[ahead] * widened.column[ahead]
            sides += 1
    behind = beside.behind[i]
    if behind >= 0:
        if fits(widened, position, behind, i):
            low = widened.reach[behind] * widened.column[behind]
            sides += 1
    # Central differences, one-sided at the ends of a row.
    half = wp.where(sides == 2, 0.25, 0.5) * wp.max(resting[i], widened.smooth[i])
    along = half * (high - low)
    bend[i] = bend[i] + along - wp.dot(normal[i], along) * normal[i]


def with_bends(
    photons: PhotonMap, plan: EmissionPlan, launcher: Launcher, beside: Sequence[PhotonMap] = ()
) -> PhotonMap:
    """The photons of a lattice with their columns over whole cells, their bends, which lie in the plane of their
    receivers, and their reaches.

    Args:
        photons: Of the lattices of ``plan``.
        plan: The lattices.
        launcher: Runs the kernels.
        beside: Photons of other cells at the time of ``photons``, which are neighbours of these besides.
    """
    beside = [others for others in beside if len(others)]
    if beside and len(photons):
        own = np.arange(len(photons))
        return with_bends(together([photons, *beside]), plan, launcher).rows(own)
    count = len(photons)
    position, normal = (launcher.array(values, wp.vec3) for values in (photons.position, photons.normal))
    resting, bend = launcher.array(_at_rest(photons), wp.float32), launcher.zeros(count, wp.vec3)
    columns, reach = [], []
    for column, (a, b) in zip((photons.dxdu, photons.dxdv), neighbours(photons, plan), strict=True):
        same = photons.receiver[a] == photons.receiver[b]
        beside = _beside(a[same], b[same], count, launcher)
        widened = over_cells(column, position, beside, launcher)
        launcher(add_bends, count, [widened, position, normal, resting, beside, bend])
        columns.append(widened.column.numpy())
        reach.append(widened.reach.numpy())
    reaches_over = np.stack(reach, axis=1)
    return replace(photons, cell_u=columns[0], cell_v=columns[1], bend=bend.numpy(), reach=reaches_over)


def over_cells(column: np.ndarray, position: wp.array, beside: Beside, launcher: Launcher) -> Widened:
    """A column [n, 3] of photons as it is over their cells, by the way between neighbours.

    Where a photon has no neighbour on one side, or light is not smooth over some cells, it is as it was.
    """
    out = launcher.rows(Widened, len(column))
    launcher(widen_columns, len(column), [launcher.array(column, wp.vec3), position, beside, out])
    return out


def _beside(a: np.ndarray, b: np.ndarray, count: int, launcher: Launcher) -> Beside:
    """Pairs of photons, each with the one next to it, as what lies beside each of ``count`` photons."""
    out = Beside()
    for name, rows, others in (("ahead", a, b), ("behind", b, a)):
        found = np.full(count, -1, np.int32)
        # A photon has one neighbour at most on either side.
        found[rows] = others
        setattr(out, name, launcher.array(found, wp.int32))
    return out


def reaches(photons: PhotonMap, plan: EmissionPlan, place: np.ndarray) -> np.ndarray:
    """The parts of D_u x and D_v x that end at the farther neighbour along each, shape [n, 2].

    Args:
        place: Where in their cells the photons started, in lattice steps from the middle, shape [n, 2]: the way to a
            neighbour counts by the step between the two.
    """
    reach = np.ones((len(photons), 2), np.float32)
    columns = (photons.dxdu, photons.dxdv)
    for axis, (a, b) in enumerate(neighbours(photons, plan)):
        same = photons.receiver[a] == photons.receiver[b]
        a, b = a[same], b[same]
        aligned = photons.position - place[:, 1 - axis, None] * columns[1 - axis]
        steps = 1.0 + place[b, axis] - place[a, axis]
        apart = lengths(aligned.take(b, axis=0) - aligned.take(a, axis=0)) / steps
        reach[:, axis] = _reach(columns[axis], (a, b), apart)
    return reach


def within_reach(photons: PhotonMap) -> PhotonMap:
    """The photons with columns over whole cells, and of these the parts that their footprints reach over."""
    if not len(photons.reach):
        return photons
    no_rows = np.zeros((0, 3), np.float32)
    used_up = {"cell_u": no_rows, "cell_v": no_rows, "reach": no_rows[:, :2]}
    whole = replace(photons, dxdu=photons.cell_u, dxdv=photons.cell_v, **used_up)
    if photons.reach.min() == 1.0:
        return whole
    u, v = photons.reach[:, :1], photons.reach[:, 1:]
    trajectory = whole.trajectory
    if trajectory is not None:
        trajectory = replace(trajectory, dxdut=u * trajectory.dxdut, dxdvt=v * trajectory.dxdvt)
    return replace(whole, dxdu=u * whole.dxdu, dxdv=v * whole.dxdv, trajectory=trajectory)


def _at_rest(photons: PhotonMap) -> np.ndarray:
    """One where light stands still, less where it moves, nothing where it moves by its footprint; shape [n]."""
    longer = photons.size
    moved = lengths(photons.dxdt)
    share = np.divide(moved, longer, out=np.ones_like(moved), where=longer > moved)
    return (1.0 - share).astype(np.float32)


def _reach(column: np.ndarray, pairs: Pairs, apart: np.ndarray) -> np.ndarray:
    """The part of a column [n, 3] that ends at the farther neighbour along it, at most one; shape [n].

    Args:
        apart: How far apart the photons of each pair are.
    """
    farthest = np.zeros(len(column), np.float32)
    for rows in pairs:
        # A photon has one neighbour at most on either side.
        farthest[rows] = np.maximum(farthest[rows], apart)
    length = lengths(column)
    limited = (farthest > 0.0) & (farthest < length)
    return np.divide(farthest, length, out=np.ones_like(length), where=limited)
