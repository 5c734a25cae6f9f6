"""Cells of a lattice under lights with extent: copies of them at places on the images of their lights.

A cell averaged over the image of its light has the variance of both. One cell of that variance would be a fraction of a
cell wider than the lattice, and cells side by side, which then overlap, sum to now more and now less than one. Where W
is a whole number of cells wide, and copies of W stand at the same few places beside each photon, those of each place
fill the receiver side by side, as the lattice does.

With V the variance of the image in filter space, where the cell is the unit square and has the variance 1/12, and λ
along a principal axis of V: W is ⌊√(1 + 12 λ)⌋ cells wide along it, and copies of it lie aside by the variance that is
left. Cells of less than a small part of a pixel are the nearest whole number of cells wide, and stand alone along that
axis: by how much that misses the variance of the image is nothing to the pixel. But where cells n wide come to lie
beside cells n + 1 wide, light lies aside by the difference of their variances by two, (2n + 1)/24 of a cell's square,
which shows where that is at an edge of a pixel. So cells nearly half way between two whole numbers are shared out
between both, and the step is spread over all of these.

Beyond the paper.
"""

from __future__ import annotations

import math

import numpy as np
import warp as wp

from tpdwarp.compiler_flags import calls_inlined
from tpdwarp.device import Launcher
from tpdwarp.footprints.light_images import cell_in_light, images_of, is_widened, light_variance, principal_axes
from tpdwarp.footprints.photon_rows import PhotonRows, stacked
from tpdwarp.footprints.shaping import (
    LightImageArrays,
    LightOnPlane,
    PixelOnPlane,
    PixelSize,
    cell_in_frame,
    in_sides,
    light_on_plane,
    narrowing_at,
    out_of_frame,
    pixel_on_plane,
    tangent_frame,
)
from tpdwarp.photons.light_columns import LightImage

wp.set_module_options(calls_inlined())

# Cells that are shorter than this part of a pixel have no copies. Chosen, not derived: with a quarter sea and ring take
# 1.38 and 1.33 times the CPU time of parallel light under a sun, so 1.04 and 1.17 (65 536 photons); errors grow by a
# tenth at most.
SHORTEST_COPIED = wp.constant(0.5)
# Of cells between these parts of a pixel, those that are less than ``SHARED_OUT`` from half way between two whole
# numbers are shared out between both. Chosen, not derived: the wave under a sun of .53°, whose cells are that narrow
# with 262 144 photons, errs by .0006 so, by .0014 without, and by .0012 with a tenth. What finer cells leave aside goes
# with their length, and of longer ones sea and ring err by less by a twentieth, but have a fifth more of them.
FINEST_SHARED, LONGEST_SHARED = wp.constant(0.03), wp.constant(0.09)
SHARED_OUT = wp.constant(0.25)
# Variance of a cell along its sides.
OF_CELL = wp.constant(1.0 / 12.0)
# A cell of a smaller determinant, by the squares of its sides, is a line, of which there is no filter space. Chosen,
# not derived.
LINE = wp.constant(1.0e-4)
# Places of unit variance along the axes along which there are copies; along both, a triangle.
THIRDS = [(math.cos(turn), math.sin(turn)) for turn in (0.0, 2.0 * math.pi / 3.0, 4.0 * math.pi / 3.0)]
_ASIDE = math.sqrt(2.0)
_PLACES = (
    [(0.0, 0.0)],
    [(0.0, -1.0), (0.0, 1.0)],
    [(-1.0, 0.0), (1.0, 0.0)],
    [(_ASIDE * a, _ASIDE * b) for a, b in THIRDS],
)
# By twice whether there are copies along the first axis and once whether along the second: how many, and where.
COPIES = np.array([len(places) for places in _PLACES])
PLACES = np.zeros((len(_PLACES), COPIES.max(), 2), np.float32)
for _kind, _of_kind in enumerate(_PLACES):
    PLACES[_kind, : len(_of_kind)] = _of_kind


@wp.struct
class LitCell:
    """A cell W under a light with extent, in the tangent plane: copies of it lie ``first`` and ``second`` aside.

    ``share`` of the light is another cell, ``other``, with copies as far aside.
    """

    w: wp.mat22
    first: wp.vec2
    second: wp.vec2
    other: wp.mat22
    share: float


@wp.func
def _share_of_other(value: float, cell: float) -> float:
    """The share of the whole number beyond the nearest one: ½ half way between both, 0 from ``SHARED_OUT`` on.

    Args:
        value: How wide W is, in cells.
        cell: How long the cell is, in pixels.
    """
    if cell < FINEST_SHARED or cell > LONGEST_SHARED:
        return 0.0
    from_half = 0.5 - wp.abs(value - wp.round(value))
    return wp.max(0.5 - 0.5 * from_half / SHARED_OUT, 0.0)


@wp.func
def _beyond(value: float) -> float:
    """The whole number beyond the nearest one."""
    nearest = wp.round(value)
    return nearest + wp.where(value > nearest, 1.0, -1.0)


@wp.struct
class AlongAxis:
    """How wide W is along an axis, in cells, and how far ``aside`` copies of it lie; for ``share`` of the light it is
    ``other`` cells wide."""

    whole: float
    aside: float
    other: float
    share: float


@wp.func
def _along(image: float, cell: float) -> AlongAxis:
    """W along an axis.

    Args:
        image: The variance of the light's image, by that of a cell.
        cell: How long the cell is, in pixels.
    """
    both = 1.0 + image
    root = wp.sqrt(both)
    out = AlongAxis()
    if cell <= SHORTEST_COPIED:
        out.whole = wp.round(root)
        out.other = _beyond(root)
        out.share = _share_of_other(root, cell)
        return out
    out.whole = wp.max(wp.floor(root), 1.0)
    out.other = out.whole
    out.aside = wp.sqrt(OF_CELL * wp.max(both - out.whole * out.whole, 0.0))
    return out


@wp.func
def lit_cell(j: wp.mat22, pixel: PixelOnPlane, light: LightOnPlane) -> LitCell:
    """What stands for a cell J that is averaged over the image of its light."""
    out = LitCell()
    out.w = j
    if not is_widened(pixel, light):
        return out
    if wp.abs(wp.determinant(j)) <= LINE * wp.ddot(j, j):
        out.w = cell_in_light(j, light)
        return out
    inverse = wp.inverse(j)
    of = principal_axes(inverse * light_variance(light) * wp.transpose(inverse))
    across = wp.vec2(-of.first[1], of.first[0])
    first = j * of.first
    second = j * across
    seen = in_sides(pixel, j)
    one = _along(of.s1 / OF_CELL, wp.length(seen * of.first))
    two = _along(of.s2 / OF_CELL, wp.length(seen * across))
    out.w = one.whole * wp.outer(first, of.first) + two.whole * wp.outer(second, across)
    # Along both axes at once it is another number in few places: the one nearer to half way changes.
    out.share = wp.max(one.share, two.share)
    if one.share >= two.share:
        out.other = one.other * wp.outer(first, of.first) + two.whole * wp.outer(second, across)
    else:
        out.other = one.whole * wp.outer(first, of.first) + two.other * wp.outer(second, across)
    out.first = one.aside * first
    out.second = two.aside * second
    if one.aside > 0.0 and two.aside > 0.0:
        # Along the lattice, by the root of that variance: where it is the same all around it has no axes of its own.
        root = one.aside * wp.outer(of.first, of.first) + two.aside * wp.outer(across, across)
        out.first = j * wp.vec2(root[0, 0], root[1, 0])
        out.second = j * wp.vec2(root[0, 1], root[1, 1])
    return out


@wp.kernel(enable_backward=False)
def spread_cells(
    base: int,
    in_turn: int,
    # In
    position: wp.array(dtype=wp.vec3),
    normal: wp.array(dtype=wp.vec3),
    images: LightImageArrays,
    pixel: PixelSize,
    # In and out
    dxdu: wp.array(dtype=wp.vec3),
    dxdv: wp.array(dtype=wp.vec3),
    # Out
    first: wp.array(dtype=wp.vec3),
    second: wp.array(dtype=wp.vec3),
    other_u: wp.array(dtype=wp.vec3),
    other_v: wp.array(dtype=wp.vec3),
    share: wp.array(dtype=wp.float32),
):
    """The sides of cells, and how far copies of them lie aside along two axes, 0 where there is none along one; those
    of the cells that ``share`` of the light is."""
    start = base + wp.tid() * in_turn
    for i in range(start, start + in_turn):
        frame = tangent_frame(normal[i])
        on_plane = pixel_on_plane(pixel, position[i], normal[i], frame)
        j = narrowing_at(images, i) * cell_in_frame(frame, dxdu[i], dxdv[i])
        lit = lit_cell(j, on_plane, light_on_plane(images, i, frame))
        dxdu[i] = out_of_frame(frame, wp.vec2(lit.w[0, 0], lit.w[1, 0]))
        dxdv[i] = out_of_frame(frame, wp.vec2(lit.w[0, 1], lit.w[1, 1]))
        first[i] = out_of_frame(frame, lit.first)
        second[i] = out_of_frame(frame, lit.second)
        share[i] = lit.share
        if lit.share > 0.0:
            other_u[i] = out_of_frame(frame, wp.vec2(lit.other[0, 0], lit.other[1, 0]))
            other_v[i] = out_of_frame(frame, wp.vec2(lit.other[0, 1], lit.other[1, 1]))


def spread_over_images(cells: list[PhotonRows], pixel: PixelSize, launcher: Launcher) -> list[PhotonRows]:
    """Cells as what stands for them under the images of their lights, which these photons then have no more."""
    if not cells or not all(part.has("image") for part in cells):
        return cells
    columns = [launcher.array(stacked(cells, name), wp.vec3) for name in ("position", "normal")]
    sides = [launcher.array(stacked(cells, name, own=True), wp.vec3) for name in ("dxdu", "dxdv")]
    count = sum(map(len, cells))
    asides = [launcher.zeros(count, wp.vec3) for _ in range(2)]
    others = [launcher.zeros(count, kind) for kind in (wp.vec3, wp.vec3, wp.float32)]
    images = images_of(cells, "bspline", launcher)
    launcher(spread_cells, count, [*columns, images, pixel, *sides, *asides, *others], in_turn=True)
    position, dxdu, dxdv, first, second = (values.numpy() for values in (columns[0], *sides, *asides))
    other_u, other_v, other = (values.numpy() for values in others)

    # ---- Copies, cell by cell: those of the cell, then those of the other
    kind = 2 * first.any(axis=1).astype(np.int8) + second.any(axis=1)
    copies = COPIES[kind]
    rows = np.where(other > 0.0, 2 * copies, copies)
    cell = np.repeat(np.arange(count), rows)
    number = np.arange(len(cell)) - np.repeat(np.cumsum(rows) - rows, rows)
    swap = number >= copies[cell]
    place = PLACES[kind[cell], number - swap * copies[cell]]
    share = np.where(swap, other[cell], 1.0 - other[cell]) / copies[cell].astype(np.float32)
    changed = {
        "position": position[cell] + place[:, :1] * first[cell] + place[:, 1:] * second[cell],
        "dxdu": np.where(swap[:, None], other_u[cell], dxdu[cell]),
        "dxdv": np.where(swap[:, None], other_v[cell], dxdv[cell]),
        "image": np.full(len(cell), int(LightImage.NONE), np.int32),
    }
    found = []
    start = 0
    for part in cells:
        low, high = np.searchsorted(cell, (start, start + len(part)))
        rows = cell[low:high] - start
        of_part = share[low:high] if part.part is None else share[low:high] * part.part[rows]
        values = {name: column[low:high] for name, column in changed.items()}
        found.append(PhotonRows(part.photons, rows if part.rows is None else part.rows[rows], of_part, values))
        start += len(part)
    return found
