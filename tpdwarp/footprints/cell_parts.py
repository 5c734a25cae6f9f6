"""Which footprints are cells of their lattice, and which B-splines; what lies between is both in parts.

Cells are shared between pixels exactly (:mod:`.cells`), and B-splines are smooth: where cells are as large as pixels,
the steps from one to the next would show. So σ1 ≥ σ2, the lengths of a footprint in pixels, say how much of its light
is that of a cell: all of it for σ1 ≤ 1 and σ2 ≤ ½, none for σ1 ≥ 2 or σ2 ≥ 1, and in between a part that changes
evenly, lest a seam shows where light goes over from one to the other. A photon that is both has two footprints.

Cells that are parts of those of the lattice (:mod:`tpdwarp.trajectories.edges`) are told apart as half of whole ones
would be, and stand for these as B-splines. Of cells between half a pixel and two pixels they so share more than those
beside them do, where pixels hide that these do not fit together.

The cell of a light with extent is as much larger as makes up for the variance of the light's image. Where the cells of
the lattice themselves are no longer than half a pixel, such cells overlap and show no steps, so that each photon has
one footprint: that of which it has more.

Beyond the paper.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import warp as wp

from tpdwarp.compiler_flags import calls_inlined
from tpdwarp.device import Launcher
from tpdwarp.footprints.light_images import images_of, is_widened
from tpdwarp.footprints.lit_cells import CellColumns, copy_count, lit_cell, spread_over_images
from tpdwarp.footprints.photon_rows import PhotonRows, stacked
from tpdwarp.footprints.shaping import (
    PixelSize,
    cell_in_frame,
    in_sides,
    light_on_plane,
    narrowing_at,
    pixel_on_plane,
    singular_values,
    tangent_frame,
)
from tpdwarp.photons.photon_map import PhotonMap

wp.set_module_options(calls_inlined())

# Lengths and widths, in pixels, up to which a footprint is a cell, and from which on it is none. Chosen: with cells up
# to twice as wide the light of soft waves errs by .0035 of itself, as the steps between them are seen, so by .0004; and
# longer cells show as stripes where light varies little across them.
LONGEST_CELL, SHORTEST_BSPLINE = wp.constant(1.0), wp.constant(2.0)
WIDEST_CELL, NARROWEST_BSPLINE = wp.constant(0.5), wp.constant(1.0)
# Cells of the lattice up to this length, in pixels, overlap once they are widened by the image of their light. Chosen,
# not derived: the mirror ring under a sun of 5° has a sixth fewer footprints by it, and
# errs by .0154 in the place of .0151.
LONGEST_OVERLAPPING = wp.constant(0.5)


@wp.kernel(enable_backward=False)
def measure_cells(
    base: int,
    in_turn: int,
    # In
    cells: CellColumns,
    pixel: PixelSize,
    # Out
    parts: wp.array(dtype=wp.float32),
    copies: wp.array(dtype=wp.int32),
):
    """The part of each photon's light that is that of its cell, and how many footprints stand for that where lights
    have an extent."""
    first = base + wp.tid() * in_turn
    for i in range(first, first + in_turn):
        frame = tangent_frame(cells.normal[i])
        on_plane = pixel_on_plane(pixel, cells.position[i], cells.normal[i], frame)
        parts[i] = 0.0
        if on_plane.p[0] * on_plane.q[1] - on_plane.p[1] * on_plane.q[0] != 0.0:
            j = cell_in_frame(frame, cells.dxdu[i], cells.dxdv[i])
            overlaps = bool(False)
            if copies.shape[0] > 0:
                own = in_sides(on_plane, j)
                light = light_on_plane(cells.images, i, frame)
                overlaps = is_widened(on_plane, light) and singular_values(
                    own[0, 0], own[0, 1], own[1, 0], own[1, 1]
                ).s1 <= LONGEST_OVERLAPPING
                lit = lit_cell(narrowing_at(cells.images, i) * j, on_plane, light)
                copies[i] = copy_count(lit)
                j = lit.w
            inside = in_sides(on_plane, j)
            sigma = singular_values(inside[0, 0], inside[0, 1], inside[1, 0], inside[1, 1])
            by_length = (SHORTEST_BSPLINE - sigma.s1) / (SHORTEST_BSPLINE - LONGEST_CELL)
            by_width = (NARROWEST_BSPLINE - wp.abs(sigma.s2)) / (NARROWEST_BSPLINE - WIDEST_CELL)
            parts[i] = wp.clamp(wp.min(by_length, by_width), 0.0, 1.0)
            if overlaps:
                parts[i] = wp.where(parts[i] >= 0.5, 1.0, 0.0)


@dataclass(frozen=True, eq=False)
class MeasuredCells:
    """What cells of photons are, one row a photon of all maps, one below the other.

    Attributes:
        columns: The photons.
        part: The part of the light of each that is that of its cell.
        copies: How many footprints stand for that; no rows where no light has an extent.
    """

    columns: CellColumns
    part: np.ndarray
    copies: np.ndarray

    @classmethod
    def of(cls, parts: list[PhotonRows], pixel: PixelSize, launcher: Launcher) -> MeasuredCells:
        """Those of photons, told apart by the sides that they have here."""
        columns = CellColumns()
        for name in ("position", "normal", "dxdu", "dxdv"):
            setattr(columns, name, launcher.array(stacked(parts, name), wp.vec3))
        columns.images = images_of(parts, "bspline", launcher)
        count = sum(map(len, parts))
        part = launcher.empty(count, wp.float32)
        extended = all(rows.has("image") for rows in parts)
        copies = launcher.zeros(count if extended else 0, wp.int32)
        launcher(measure_cells, count, [columns, pixel, part, copies], in_turn=True)
        return cls(columns, part.numpy(), copies.numpy())


def told_apart(
    maps: list[PhotonMap], pixel: PixelSize, launcher: Launcher
) -> tuple[list[PhotonRows], list[PhotonRows]]:
    """Photons whose footprints are B-splines, and those of cells, each with their part of the flux."""
    splines: list[PhotonRows] = []
    # Parts of cells lie at edges, where no lattice fills the receiver: one widened cell each is enough.
    whole: list[PhotonRows] = []
    parts: list[PhotonRows] = []
    rows: list[np.ndarray] = []
    maps = [photons for photons in maps if len(photons)]
    if not maps:
        return [], []
    in_cells = [photons.in_whole_cells for photons in maps]
    as_told = [
        PhotonRows(cells if photons.finer == 1 else _halved(cells))
        for photons, cells in zip(maps, in_cells, strict=True)
    ]
    measured = MeasuredCells.of(as_told, pixel, launcher)
    start = 0
    for photons, cells in zip(maps, in_cells, strict=True):
        part = measured.part[start : start + len(photons)]
        of_cells = whole if photons.finer == 1 else parts
        for taken, share, shaped in ((splines, 1.0 - part, cells), (of_cells, part, photons)):
            if share.min() == 1.0:
                taken.append(PhotonRows(shaped))
            elif share.any():
                index = np.flatnonzero(share > 0.0)
                taken.append(PhotonRows(shaped, index, share[index]))
            else:
                continue
            if taken is whole:
                rows.append(start + (np.arange(len(part)) if taken[-1].rows is None else taken[-1].rows))
        start += len(photons)
    if whole and len(measured.copies):
        at = np.concatenate(rows).astype(np.int32)
        whole = spread_over_images(whole, at, measured.copies[at], measured.columns, pixel, launcher)
    return splines, [*whole, *parts]


def _halved(photons: PhotonMap) -> PhotonMap:
    """Photons with half of their columns."""
    half = np.float32(0.5)
    return replace(photons, dxdu=half * photons.dxdu, dxdv=half * photons.dxdv)
