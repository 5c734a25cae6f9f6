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

from dataclasses import replace

import numpy as np
import warp as wp

from tpdwarp.compiler_flags import calls_inlined
from tpdwarp.device import Launcher
from tpdwarp.footprints.light_images import images_of, is_widened
from tpdwarp.footprints.lit_cells import lit_cell, spread_over_images
from tpdwarp.footprints.photon_rows import PhotonRows
from tpdwarp.footprints.shaping import (
    LightImageArrays,
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
    position: wp.array(dtype=wp.vec3),
    normal: wp.array(dtype=wp.vec3),
    dxdu: wp.array(dtype=wp.vec3),
    dxdv: wp.array(dtype=wp.vec3),
    images: LightImageArrays,
    pixel: PixelSize,
    # Out
    parts: wp.array(dtype=wp.float32),
):
    """The part of each photon's light that is that of its cell."""
    first = base + wp.tid() * in_turn
    for i in range(first, first + in_turn):
        frame = tangent_frame(normal[i])
        on_plane = pixel_on_plane(pixel, position[i], normal[i], frame)
        parts[i] = 0.0
        if on_plane.p[0] * on_plane.q[1] - on_plane.p[1] * on_plane.q[0] != 0.0:
            j = cell_in_frame(frame, dxdu[i], dxdv[i])
            overlaps = bool(False)
            if images.image.shape[0] > 0:
                own = in_sides(on_plane, j)
                light = light_on_plane(images, i, frame)
                overlaps = is_widened(on_plane, light) and singular_values(
                    own[0, 0], own[0, 1], own[1, 0], own[1, 1]
                ).s1 <= LONGEST_OVERLAPPING
                j = lit_cell(narrowing_at(images, i) * j, on_plane, light).w
            inside = in_sides(on_plane, j)
            sigma = singular_values(inside[0, 0], inside[0, 1], inside[1, 0], inside[1, 1])
            by_length = (SHORTEST_BSPLINE - sigma.s1) / (SHORTEST_BSPLINE - LONGEST_CELL)
            by_width = (NARROWEST_BSPLINE - wp.abs(sigma.s2)) / (NARROWEST_BSPLINE - WIDEST_CELL)
            parts[i] = wp.clamp(wp.min(by_length, by_width), 0.0, 1.0)
            if overlaps:
                parts[i] = wp.where(parts[i] >= 0.5, 1.0, 0.0)


def told_apart(
    maps: list[PhotonMap], pixel: PixelSize, launcher: Launcher
) -> tuple[list[PhotonRows], list[PhotonRows]]:
    """Photons whose footprints are B-splines, and those of cells, each with their part of the flux."""
    splines: list[PhotonRows] = []
    cells: list[PhotonRows] = []
    for photons in (some for some in maps if len(some)):
        whole = photons.in_whole_cells
        parts = _parts(whole if photons.finer == 1 else _halved(whole), pixel, launcher)
        for taken, part, shaped in ((splines, 1.0 - parts, whole), (cells, parts, photons)):
            if part.min() == 1.0:
                taken.append(PhotonRows(shaped))
            elif part.any():
                index = np.flatnonzero(part > 0.0)
                taken.append(PhotonRows(shaped, index, part[index]))
    # Parts of cells lie at edges, where no lattice fills the receiver: one widened cell each is enough.
    whole = [part for part in cells if part.photons.finer == 1]
    parts = [part for part in cells if part.photons.finer != 1]
    return splines, [*spread_over_images(whole, pixel, launcher), *parts]


def _halved(photons: PhotonMap) -> PhotonMap:
    """Photons with half of their columns."""
    half = np.float32(0.5)
    return replace(photons, dxdu=half * photons.dxdu, dxdv=half * photons.dxdv)


def _parts(photons: PhotonMap, pixel: PixelSize, launcher: Launcher) -> np.ndarray:
    out = launcher.zeros(len(photons), wp.float32)
    columns = (getattr(photons, name) for name in ("position", "normal", "dxdu", "dxdv"))
    arrays = [launcher.array(column, wp.vec3) for column in columns]
    inputs = [*arrays, images_of([PhotonRows(photons)], "bspline", launcher), pixel, out]
    launcher(measure_cells, len(photons), inputs, in_turn=True)
    return out.numpy()
