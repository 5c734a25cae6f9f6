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
from tpdwarp.footprints.light_images import cell_in_light, is_widened, light_variance, principal_axes
from tpdwarp.footprints.photon_rows import PhotonRows
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
# Nor do those that would lie aside by less than this part of a pixel: what they leave out of the variance of its light
# is a twentieth of the pixel's own. Chosen, not derived: over the sea under a sun of .53° a ninth of the cells has
# copies so, where nearly half had; no picture of extent.py changes by more than .0004.
LEAST_ASIDE = wp.constant(0.06)
# Variance of a cell along its sides.
OF_CELL = wp.constant(1.0 / 12.0)
# A cell of a smaller determinant, by the squares of its sides, is a line, of which there is no filter space. Chosen,
# not derived.
LINE = wp.constant(1.0e-4)
# Corners of a triangle of unit variance.
THIRD = wp.constant(2.0 * math.pi / 3.0)
ASIDE = wp.constant(math.sqrt(2.0))
# Columns that copies have of their own.
SPREAD = ("position", "dxdu", "dxdv")


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
    if out.aside * cell < LEAST_ASIDE:
        out.aside = 0.0
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


@wp.func
def copy_count(lit: LitCell) -> int:
    """How many footprints stand for a cell: two with copies along one axis, three along both, as many of the other."""
    count = int(1)
    if wp.length_sq(lit.first) > 0.0:
        count += 1
    if wp.length_sq(lit.second) > 0.0:
        count += 1
    return wp.where(lit.share > 0.0, 2 * count, count)


@wp.func
def _place_of_copy(lit: LitCell, number: int) -> wp.vec2:
    """How far aside a copy lies: those along one axis at −1 and 1 of it, those along both at the corners of a triangle,
    so that they have unit variance."""
    along_first = wp.length_sq(lit.first) > 0.0
    along_second = wp.length_sq(lit.second) > 0.0
    if along_first and along_second:
        turn = THIRD * float(number)
        return ASIDE * (wp.cos(turn) * lit.first + wp.sin(turn) * lit.second)
    return (2.0 * float(number) - 1.0) * (lit.first + lit.second)


@wp.struct
class CellColumns:
    """Photons whose cells are measured and spread, one row a photon, and the images of their lights."""

    position: wp.array(dtype=wp.vec3)
    normal: wp.array(dtype=wp.vec3)
    dxdu: wp.array(dtype=wp.vec3)
    dxdv: wp.array(dtype=wp.vec3)
    images: LightImageArrays


@wp.kernel(enable_backward=False)
def spread_cells(
    base: int,
    in_turn: int,
    # In
    rows: wp.array(dtype=wp.int32),
    starts: wp.array(dtype=wp.int32),
    cells: CellColumns,
    pixel: PixelSize,
    # Out
    position: wp.array(dtype=wp.vec3),
    dxdu: wp.array(dtype=wp.vec3),
    dxdv: wp.array(dtype=wp.vec3),
    share: wp.array(dtype=wp.float32),
):
    """The copies of some cells, from ``starts`` on, and which share of the light each of them is."""
    first = base + wp.tid() * in_turn
    for k in range(first, first + in_turn):
        i = rows[k]
        frame = tangent_frame(cells.normal[i])
        on_plane = pixel_on_plane(pixel, cells.position[i], cells.normal[i], frame)
        j = narrowing_at(cells.images, i) * cell_in_frame(frame, cells.dxdu[i], cells.dxdv[i])
        lit = lit_cell(j, on_plane, light_on_plane(cells.images, i, frame))
        count = copy_count(lit)
        copies = int(count)
        if lit.share > 0.0:
            copies = count / 2
        for n in range(count):
            w = lit.w
            part = 1.0 - lit.share
            if n >= copies:
                w = lit.other
                part = lit.share
            at = starts[k] + n
            position[at] = cells.position[i]
            if copies > 1:
                position[at] += out_of_frame(frame, _place_of_copy(lit, n % copies))
            dxdu[at] = out_of_frame(frame, wp.vec2(w[0, 0], w[1, 0]))
            dxdv[at] = out_of_frame(frame, wp.vec2(w[0, 1], w[1, 1]))
            share[at] = part / float(copies)


def spread_over_images(
    cells: list[PhotonRows],
    rows: np.ndarray,
    copies: np.ndarray,
    columns: CellColumns,
    pixel: PixelSize,
    launcher: Launcher,
) -> list[PhotonRows]:
    """Cells as what stands for them under the images of their lights, which these photons then have no more.

    Args:
        rows: Where the photons of all ``cells`` stand in ``columns``, shape [n] int32.
        copies: How many footprints stand for each of them, shape [n] int32.
    """
    ends = np.cumsum(copies, dtype=np.int32)
    total = int(ends[-1]) if len(ends) else 0
    out = [launcher.empty(total, kind) for kind in (wp.vec3, wp.vec3, wp.vec3, wp.float32)]
    given = [launcher.array(values, wp.int32) for values in (rows, ends - copies)]
    launcher(spread_cells, len(rows), [*given, columns, pixel, *out], in_turn=True)
    position, dxdu, dxdv, share = (values.numpy() for values in out)
    found = []
    start = first = 0
    for part in cells:
        last = int(ends[start + len(part) - 1])
        of_part = copies[start : start + len(part)]
        here = np.arange(len(part)) if part.rows is None else part.rows
        of_light = share[first:last] if part.part is None else share[first:last] * np.repeat(part.part, of_part)
        values = {name: column[first:last] for name, column in zip(SPREAD, (position, dxdu, dxdv), strict=True)}
        values |= {"image": np.int32(LightImage.NONE), "dxda": np.float32(0.0), "dxdb": np.float32(0.0)}
        found.append(PhotonRows(part.photons, np.repeat(here, of_part), of_light, values))
        start, first = start + len(part), last
    return found
