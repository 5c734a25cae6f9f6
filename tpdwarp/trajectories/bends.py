"""Columns, bends and reaches: what neighbours on the light say of a footprint beside its own columns.

Normals are straight within a triangle, so that D_u x and D_v x are those of the one triangle that a photon met, and
jump from one to the next. A cell that is as large as a triangle or larger has light from several, and long cells have
it from dozens: what the one says of it is chance. The way from the neighbour before to the neighbour after counts all
triangles in between. So half of that way takes the place of a column where its two parts are nearly alike, as they are
where light is smooth over some cells; where light changes from cell to cell, at folds and creases, the column stands.

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

from dataclasses import replace

import numpy as np

from tpdwarp.photons.lattices import EmissionPlan
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.photons.vectors import lengths
from tpdwarp.trajectories.neighbours import Pairs, differences, neighbours

# Neighbours are of one smooth sheet where the way between them is the mean of their columns, up to this part of the
# longer one: at a fold it is, across the edge of a facet it is not. Chosen, not derived.
LARGEST_MISFIT = 0.5
# Columns are taken from neighbours where the ways to these two differ by up to this part of the column, and the less
# so up to twice of it. Chosen on the moving solids of ``scripts/benchmarks/solids.py`` with 16 384 photons: those err
# by up to 1.1 times as much where all columns are taken so, and with this by .96 to 1.01 times as much as with none.
LARGEST_TURN = 0.3


def with_bends(photons: PhotonMap, plan: EmissionPlan) -> PhotonMap:
    """The photons of a lattice with their columns over whole cells, their bends, which lie in the plane of their
    receivers, and their reaches.
    """
    bend, reach = np.zeros_like(photons.position), np.ones((len(photons), 2), np.float32)
    columns = [photons.dxdu, photons.dxdv]
    resting = _at_rest(photons)
    for axis, (a, b) in enumerate(neighbours(photons, plan)):
        same = photons.receiver[a] == photons.receiver[b]
        a, b = a[same], b[same]
        column, smooth = over_cells(columns[axis], photons.position, (a, b))
        columns[axis] = column
        way = photons.position.take(b, axis=0) - photons.position.take(a, axis=0)
        reach[:, axis] = _reach(column, (a, b), lengths(way))
        column = column * reach[:, axis : axis + 1]
        mean = 0.5 * (column.take(a, axis=0) + column.take(b, axis=0))
        misfit = lengths(way - mean)
        sizes = lengths(column)
        longer = np.maximum(sizes[a], sizes[b])
        beside = misfit <= LARGEST_MISFIT * longer
        weight = np.maximum(resting, smooth)[:, None]
        bend += 0.5 * weight * differences(column, (a[beside], b[beside]))
    bend -= photons.normal * np.einsum("ij,ij->i", photons.normal, bend)[:, None]
    return replace(photons, dxdu=columns[0], dxdv=columns[1], bend=bend, reach=reach)


def over_cells(column: np.ndarray, position: np.ndarray, pairs: Pairs) -> tuple[np.ndarray, np.ndarray]:
    """A column [n, 3] of photons at ``position`` [n, 3] as it is over their cells, by the way between neighbours.

    Where a photon has no neighbour on one side, or light is not smooth over some cells, it is as it was.

    Returns:
        The column, and how far light is smooth around each photon, 0 … 1, shape [n].
    """
    a, b = pairs
    rows = np.arange(len(column))
    ahead, behind = rows.copy(), rows.copy()
    # A photon has one neighbour at most on either side.
    ahead[a], behind[b] = b, a
    before, after = position - position.take(behind, axis=0), position.take(ahead, axis=0) - position
    limit = LARGEST_TURN * lengths(column)
    turn = np.divide(lengths(after - before), limit, out=np.full_like(limit, 2.0), where=limit > 0.0)
    part = np.where((ahead != rows) & (behind != rows), np.clip(2.0 - turn, 0.0, 1.0), 0.0).astype(np.float32)
    return column + part[:, None] * (0.5 * (before + after) - column), part


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
    """The photons with the parts of their columns that their footprints reach over."""
    if not len(photons.reach) or photons.reach.min() == 1.0:
        return photons
    u, v = photons.reach[:, :1], photons.reach[:, 1:]
    trajectory = photons.trajectory
    if trajectory is not None:
        trajectory = replace(trajectory, dxdut=u * trajectory.dxdut, dxdvt=v * trajectory.dxdvt)
    return replace(photons, dxdu=u * photons.dxdu, dxdv=v * photons.dxdv, trajectory=trajectory)


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
