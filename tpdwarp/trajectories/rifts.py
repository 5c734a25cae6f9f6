"""Rifts: places on the light where cells that ride on what they meet drift apart, or over one another.

Cells ride on the surface that their light meets first, and fill the lattice as long as those side by side ride alike.
One body that passes before another hides light from it: at the edge of the nearer one cells ride with it, beside them
with the other, and in time a gap opens there or cells overlap, so that light is missing or shines twice. So around such
edges cells ride along a field that goes over from the one to the other smoothly, over a width in which it can: as wide
to either side as cells drift apart. They are traced in parts of the shutter, and each is as large at the part s of it
as the field makes it: with u + s S(u) for the place of the cell u,

    D_u x + s (∂_u S_u D_u x + ∂_u S_v D_v x),  likewise along v,  and the flux of its cell by det(I + s ∇S).

Beyond the paper, whose photons start from the light.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tpdwarp.photons.photon_map import PhotonMap

# Cells side by side may drift apart by less than this [cells] within the shutter. Chosen, not derived: with half of it
# a torus that turns by 10 degrees takes half as long again, for nothing.
LARGEST_DRIFT_APART = 1.0
# Nor do they count that drift apart by less than this part of the lattice, however fine its cells: so little light is
# missing there. Chosen, not derived: silhouettes of a torus that turns by 10 degrees do, and gain nothing.
LEAST_PART = 1.0 / 64.0
# Of how far cells drift apart at rifts, this quantile is the width of the field to either side: where light grazes they
# may do so without bound. Chosen, not derived.
WIDTH_QUANTILE = 0.9


def rift_cells(field: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The cells around rifts of a field of shifts [u, v, 2], shape [u, v] bool, and the field that they ride along."""
    across: list[np.ndarray] = []
    rift = np.zeros(field.shape[:2], bool)
    for axis, (apart, torn) in enumerate(_drifts_apart(field)):
        across.append(apart[torn])
        for cut in (slice(1, None), slice(None, -1)):
            rift[(cut, slice(None)) if axis == 0 else (slice(None), cut)] |= torn
    widths = np.concatenate(across)
    if not len(widths):
        return rift, field
    width = math.ceil(min(float(np.quantile(widths, WIDTH_QUANTILE)), max(field.shape[:2])))
    if any(2 * width + 1 > size for size, apart in zip(field.shape, across, strict=False) if len(apart)):
        # The mean over more than the lattice is none that cells can ride along: they rest.
        return np.zeros_like(rift), np.zeros_like(field)
    return _mean_over(rift[..., None].astype(np.float64), width)[..., 0] > 0.0, _mean_over(field, width)


def widths_of_rifts(field: np.ndarray) -> np.ndarray:
    """How wide the rifts across u and across v of a field of shifts [u, v, 2] are [cells], shape [2]; 0 without any."""
    return np.array(
        [np.quantile(apart[torn], WIDTH_QUANTILE) if torn.any() else 0.0 for apart, torn in _drifts_apart(field)]
    )


def _drifts_apart(field: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """How far cells side by side along u, then along v, drift apart, and between which of them there is a rift."""
    least = max(LARGEST_DRIFT_APART, LEAST_PART * max(field.shape[:2]))
    for axis in (0, 1):
        apart = np.linalg.norm(np.diff(field, axis=axis), axis=2)
        yield apart, apart > least


def gradients(field: np.ndarray) -> np.ndarray:
    """∂_a S_b of a field [u, v, 2], shape [u, v, 2, 2] by a and b."""
    sizes = field.shape[:2]
    parts = [np.gradient(field, axis=axis) if sizes[axis] > 1 else np.zeros_like(field, np.float64) for axis in (0, 1)]
    return np.stack(parts, axis=2)


def stretched(photons: PhotonMap, growth: np.ndarray) -> PhotonMap:
    """Photons with the sizes and the flux of cells that have grown.

    Args:
        growth: s ∇S of the cell of each, shape [n, 2, 2].
    """
    columns = []
    for axis, column in enumerate((photons.dxdu, photons.dxdv)):
        by_u, by_v = (growth[:, axis, along, None] for along in (0, 1))
        columns.append(column + (by_u * photons.dxdu + by_v * photons.dxdv).astype(np.float32))
    flux = photons.flux * np.abs(np.linalg.det(np.eye(2) + growth))[:, None].astype(np.float32)
    return replace(photons, dxdu=columns[0], dxdv=columns[1], flux=flux)


def _mean_over(field: np.ndarray, width: int) -> np.ndarray:
    """The mean of a field [u, v, k] over squares that reach ``width`` cells to either side of each."""
    for axis in (0, 1):
        ends = [(0, 0)] * field.ndim
        ends[axis] = (width + 1, width)
        sums = np.cumsum(np.pad(field, ends, mode="edge"), axis=axis, dtype=np.float64)
        size = field.shape[axis]
        after, before = (np.take(sums, np.arange(size) + start, axis=axis) for start in (2 * width + 1, 0))
        field = (after - before) / (2 * width + 1)
    return field
