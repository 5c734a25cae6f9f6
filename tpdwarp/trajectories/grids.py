"""Grids of keyframes: D_t x, x, ln Φ and ∇·S as functions of the place on a light, interpolated on the device."""

from __future__ import annotations

import numpy as np
import warp as wp

from tpdwarp.compiler_flags import calls_inlined
from tpdwarp.device import Launcher
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.trajectories.neighbours import Pairs, growth_of, second_differences

wp.set_module_options(calls_inlined())

# Photons of the four around a place that have to have taken a path for its values to be valid.
FEWEST_CORNERS = wp.constant(3)


@wp.struct
class Grid:
    """Where the photons of one lattice on one path lie in :class:`GridArrays`.

    That of cell (u, v) from cell ``first`` on is at ``start`` + u · ``size[1]`` + v.
    """

    first: wp.vec2d
    size: wp.vec2i
    start: int


@wp.struct
class GridArrays:
    """The photons of all grids, cell by cell.

    ``path`` is that of the cell's photon, −1 where there is none; ``log_flux`` is ln Φ, ``bend`` its second differences
    along u and v, ``growth`` how fast a cell grows that rides on the surface that its light meets first.
    """

    path: wp.array(dtype=wp.int64)
    dxdt: wp.array(dtype=wp.vec3)
    position: wp.array(dtype=wp.vec3)
    log_flux: wp.array(dtype=wp.float32)
    bend: wp.array(dtype=wp.vec2)
    growth: wp.array(dtype=wp.float32)


@wp.struct
class Riders:
    """Photons that are looked up: their place on the light at mid shutter, their shift over the whole of it, paths.

    ``grid`` is the number of each one's grid. Places are in steps of the lattice of the photons; ``scale`` and
    ``offset``, one for each grid, make them steps of the grid's.
    """

    grid: wp.array(dtype=wp.int32)
    emission: wp.array(dtype=wp.vec2)
    shift: wp.array(dtype=wp.vec2)
    path: wp.array(dtype=wp.uint32)
    scale: wp.array(dtype=wp.vec2d)
    offset: wp.array(dtype=wp.vec2d)


@wp.struct
class StateArrays:
    """What was found, one row a photon; ``drift`` is how far it has moved over the light, in cells of the grid,
    ``rough`` the second differences of ln Φ there.

    ``corners`` has a bit for each of the four cells around it that took its path, and ``beyond`` is how many cells it
    lies outside of them along u and v.
    """

    dxdt: wp.array(dtype=wp.vec3d)
    position: wp.array(dtype=wp.vec3d)
    log_flux: wp.array(dtype=wp.float64)
    growth: wp.array(dtype=wp.float64)
    rough: wp.array(dtype=wp.float64)
    drift: wp.array(dtype=wp.float64)
    valid: wp.array(dtype=wp.int32)
    corners: wp.array(dtype=wp.int32)
    beyond: wp.array(dtype=wp.vec2d)


@wp.struct
class Corner:
    """A photon of a grid beside a place: its values, and whether it took the path that is looked for."""

    dxdt: wp.vec3d
    position: wp.vec3d
    log_flux: wp.float64
    bend: wp.vec2d
    growth: wp.float64
    valid: int


@wp.func
def corner_at(cells: GridArrays, grid: Grid, u: int, v: int, path: wp.uint32) -> Corner:
    """The photon of a cell; none outside of the grid."""
    out = Corner()
    if u >= 0 and v >= 0 and u < grid.size[0] and v < grid.size[1]:
        k = grid.start + u * grid.size[1] + v
        if cells.path[k] == wp.int64(path):
            out.dxdt = wp.vec3d(cells.dxdt[k])
            out.position = wp.vec3d(cells.position[k])
            out.log_flux = wp.float64(cells.log_flux[k])
            out.bend = wp.vec2d(cells.bend[k])
            out.growth = wp.float64(cells.growth[k])
            out.valid = 1
    return out


@wp.func
def on_plane_of(missing: Corner, a: Corner, b: Corner, opposite: Corner) -> Corner:
    """A corner, or where it is missing, what lies there on the plane through the others."""
    out = missing
    if missing.valid == 0:
        out.dxdt = a.dxdt + b.dxdt - opposite.dxdt
        out.position = a.position + b.position - opposite.position
        out.log_flux = a.log_flux + b.log_flux - opposite.log_flux
        out.bend = a.bend + b.bend - opposite.bend
        out.growth = a.growth + b.growth - opposite.growth
    return out


@wp.kernel(enable_backward=False)
def interpolate(
    base: int,
    in_turn: int,
    # In
    grids: wp.array(dtype=Grid),
    cells: GridArrays,
    riders: Riders,
    rows: wp.array(dtype=wp.int32),
    part: wp.float64,
    # Out
    out: StateArrays,
):
    """Values at the places that photons have at the part ``part`` (−½ … ½) of the shutter, bilinearly."""
    first = base + wp.tid() * in_turn
    for number_of_row in range(first, first + in_turn):
        i = rows[number_of_row]
        half = wp.float64(0.5)
        number = riders.grid[i]
        grid = grids[number]
        scale = riders.scale[number]
        moved = part * wp.vec2d(riders.shift[i])
        out.drift[i] = wp.max(wp.abs(wp.cw_mul(moved, scale)))
        place = wp.cw_mul(wp.vec2d(riders.emission[i]) + moved, scale) + riders.offset[number] - grid.first
        place = place - wp.vec2d(half, half)
        last = wp.vec2d(wp.float64(grid.size[0] - 1), wp.float64(grid.size[1] - 1))

        # ---- Outside the outermost photons, by up to a cell, it is as on the line that they make
        beyond = wp.max(wp.max(-place), wp.max(place - last))
        inside = wp.max(wp.min(place, last), wp.vec2d())
        out.beyond[i] = place - inside
        place = inside
        u = wp.min(int(wp.floor(place[0])), wp.max(grid.size[0] - 2, 0))
        v = wp.min(int(wp.floor(place[1])), wp.max(grid.size[1] - 2, 0))
        x = place[0] - wp.float64(u)
        y = place[1] - wp.float64(v)
        path = riders.path[i]
        a = corner_at(cells, grid, u, v, path)
        b = corner_at(cells, grid, u + 1, v, path)
        c = corner_at(cells, grid, u, v + 1, path)
        d = corner_at(cells, grid, u + 1, v + 1, path)
        count = a.valid + b.valid + c.valid + d.valid
        out.corners[i] = a.valid + 2 * b.valid + 4 * c.valid + 8 * d.valid
        if beyond < wp.float64(1.0) and count >= FEWEST_CORNERS:
            p = on_plane_of(a, b, c, d)
            q = on_plane_of(b, a, d, c)
            r = on_plane_of(c, a, d, b)
            s = on_plane_of(d, b, c, a)
            one = wp.float64(1.0)
            out.dxdt[i] = (one - y) * ((one - x) * p.dxdt + x * q.dxdt) + y * ((one - x) * r.dxdt + x * s.dxdt)
            out.position[i] = (one - y) * ((one - x) * p.position + x * q.position) + y * (
                (one - x) * r.position + x * s.position
            )
            out.log_flux[i] = (one - y) * ((one - x) * p.log_flux + x * q.log_flux) + y * (
                (one - x) * r.log_flux + x * s.log_flux
            )
            bend = (one - y) * ((one - x) * p.bend + x * q.bend) + y * ((one - x) * r.bend + x * s.bend)
            # What a line misses of a parabola, which differs by where in its cells a photon rides.
            out.log_flux[i] -= half * (x * (one - x) * bend[0] + y * (one - y) * bend[1])
            out.rough[i] = wp.abs(bend[0]) + wp.abs(bend[1])
            out.growth[i] = (one - y) * ((one - x) * p.growth + x * q.growth) + y * (
                (one - x) * r.growth + x * s.growth
            )
            out.valid[i] = 1


def grids_of(
    photons: PhotonMap, rows: np.ndarray, starts: np.ndarray, beside: tuple[Pairs, Pairs], launcher: Launcher
) -> tuple[wp.array, GridArrays]:
    """The grids of photons, each of one lattice and on one path, and their cells.

    Args:
        rows: Rows of the photons, those of a grid side by side, shape [n].
        starts: Where in ``rows`` those of each grid begin, shape [k].
        beside: Photons one cell on in u, and in v.
    """
    cell = np.floor(photons.emission[rows]).astype(np.int64)
    first = np.minimum.reduceat(cell, starts, axis=0)
    size = np.maximum.reduceat(cell, starts, axis=0) - first + 1
    counts = size.prod(axis=1)
    ends = np.cumsum(counts)
    table = np.zeros(len(starts), Grid.numpy_dtype())
    table["first"], table["size"], table["start"] = first, size, ends - counts
    number = np.repeat(np.arange(len(starts)), np.diff(starts, append=len(rows)))
    u, v = (cell - first[number]).T
    at = (ends - counts)[number] + u * size[number, 1] + v

    def column(values: np.ndarray, dtype: object, empty: int = 0) -> wp.array:
        filled = np.full((int(ends[-1]), *values.shape[1:]), empty, values.dtype)
        filled[at] = values
        return launcher.array(filled, dtype)

    log_flux = np.log(np.maximum(photons.flux.max(axis=1), np.finfo(np.float32).tiny))
    bend = np.stack([second_differences(log_flux, pairs) for pairs in beside], axis=1)
    out = GridArrays()
    out.path = column(photons.path[rows].astype(np.int64), wp.int64, -1)
    out.dxdt, out.position = (column(getattr(photons, name)[rows], wp.vec3) for name in ("dxdt", "position"))
    out.log_flux, out.growth = (column(values[rows], wp.float32) for values in (log_flux, growth_of(photons, beside)))
    out.bend = column(bend[rows].astype(np.float32), wp.vec2)
    return wp.array(table, dtype=Grid, device=launcher.device), out
