"""Cells that sweep over an edge of what they light between two instants, and are seen to at neither.

Light glides over a picket, a step, a slat: as the shutter opens it falls beside it, and so it does in its middle. But
where at some instant cells side by side meet surfaces that lie apart, the edge between them moves on the light by

    w = −(D_u x, D_v x)⁺ (D_t x − D_t of what it meets)

cells within the shutter, and passes over all cells on that way.

Beyond the paper.
"""

from __future__ import annotations

import numpy as np

from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.trajectories.retraced import CellsOfLattices, Window

# Light side by side lies on surfaces apart where it leaves the plane of either by more than this part of its distance.
# Chosen, not derived.
LEAST_OFF_PLANE = 0.2
# Edges that move by fewer cells are seen by the cells beside them. Chosen, not derived.
SHORTEST_WAY = 1.0


def swept_cells(found: CellsOfLattices, important: np.ndarray, number: int, window: Window, share: float) -> np.ndarray:
    """Which cells of ``window`` edges pass over around an instant, shape [u, v].

    Args:
        found: Photons of that instant; D_t x over the whole shutter.
        important: Which of them count, shape [n].
        number: Of the lattice.
        share: How long before and after it is asked, as a part of the shutter.
    """
    photons = found.photons
    swept = window.grid(dtype=bool)
    rows, cells = found.of(number)
    counts = important[rows] & window.holds(cells)
    rows, cells = rows[counts], cells[counts]
    if not len(rows) or _on_one_plane(photons, rows):
        return swept
    # Of each cell its brightest photon.
    order = np.argsort(photons.flux[rows].sum(axis=1), kind="stable")
    brightest = np.full(tuple(window.size), -1, np.int64)
    brightest[window.at(cells[order])] = rows[order]
    for axis in (0, 1):
        ahead, behind = [slice(None)] * 2, [slice(None)] * 2
        ahead[axis], behind[axis] = slice(1, None), slice(None, -1)
        a, b = brightest[tuple(behind)], brightest[tuple(ahead)]
        u, v = np.nonzero((a >= 0) & (b >= 0))
        one, other = a[u, v], b[u, v]
        apart = (photons.path[one] != photons.path[other]) & _off_planes(photons, one, other)
        cell = np.stack([u, v], axis=1)[apart]
        for side in (one[apart], other[apart]):
            mark_ways(swept, cell, share * edge_ways(photons, side))
    return swept


def edge_ways(photons: PhotonMap, rows: np.ndarray) -> np.ndarray:
    """How far, in cells, edges of what photons light move on the light within the shutter, shape [n, 2]."""
    columns = np.stack([photons.dxdu[rows], photons.dxdv[rows]], axis=2).astype(np.float64)
    way = (photons.dxdt[rows] - photons.receiver_motion[rows]).astype(np.float64)
    return -np.einsum("nij,nj->ni", np.linalg.pinv(columns, rcond=1e-3), way)


def _on_one_plane(photons: PhotonMap, rows: np.ndarray) -> bool:
    offset = photons.position[rows] - photons.position[rows[0]]
    return bool(np.all(np.abs(offset @ photons.normal[rows[0]]) <= 1e-5 * np.abs(offset).max()))


def _off_planes(photons: PhotonMap, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Which of some photons and others lie off each other's plane, shape [n]."""
    offset = photons.position[other] - photons.position[one]
    off = np.maximum(*(np.abs(np.sum(offset * photons.normal[side], axis=1)) for side in (one, other)))
    return off > LEAST_OFF_PLANE * np.linalg.norm(offset, axis=1)


def mark_ways(swept: np.ndarray, cells: np.ndarray, ways: np.ndarray) -> None:
    """Marks the cells of a grid [u, v] that lie as far as ``ways`` [n, 2] to either side of ``cells`` [n, 2].

    Ways may begin beside the grid, and be as long as they like: of each only what lies in the grid is gone along.
    """
    far = np.abs(ways).max(axis=1, initial=0.0) > SHORTEST_WAY
    cells, ways = cells[far].astype(np.float64), ways[far].astype(np.float64)
    if not len(cells):
        return
    # ---- From where to where each lies in the grid, as parts of it
    across = np.where(ways == 0.0, np.finfo(np.float64).tiny, ways)
    with np.errstate(over="ignore"):
        sides = np.stack([(side - cells) / across for side in (np.full(2, -0.5), np.array(swept.shape) - 0.5)])
    first = sides.min(axis=0).max(axis=1).clip(-1.0, 1.0)
    last = sides.max(axis=0).min(axis=1).clip(-1.0, 1.0)
    met = last > first
    if not met.any():
        return
    begin, way = cells[met] + first[met, None] * ways[met], (last - first)[met, None] * ways[met]
    # Halves of a whole way have as many.
    steps = 2 * int(np.ceil(0.5 * np.abs(way).max()))
    for step in np.linspace(0.0, 1.0, steps + 1):
        u, v = np.rint(begin + step * way).astype(np.int64).T
        inside = (u >= 0) & (v >= 0) & (u < swept.shape[0]) & (v < swept.shape[1])
        swept[u[inside], v[inside]] = True
