"""Rasters of smooth light: irradiance at the corners of squares on planes, found when first looked at.

Between corners it is interpolated by cubic convolution (Keys 1981), which is exact for parabolas. Corners are gathered
in tiles, always whole ones, so that their values depend neither on who looks first nor on how queries are cut into
batches; those that no footprint reaches are dark, and nothing is gathered there. A query that moves sees the mean along
its way, while the light stands still.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.footprints.background import COARSEST_SQUARE
from tpdwarp.footprints.bounds import Piece
from tpdwarp.footprints.footprint_map import FootprintMap
from tpdwarp.footprints.gather import BOX_MARGIN, PLAIN_LOOKUP, gathered, time_windows
from tpdwarp.footprints.irradiance import Lookup, QueryArrays, has_shading_normals
from tpdwarp.footprints.placing import PLANE_ROUNDING, TimeWindow
from tpdwarp.footprints.planes import SAME_NORMAL, Plane
from tpdwarp.footprints.shaping import TangentFrame, tangent_frame
from tpdwarp.footprints.ways import MOST_PIECES
from tpdwarp.footprints.weights import GatherForm

# Corners of a tile along u and v: together the queries of one thread of the gather.
TILE_U = wp.constant(16)
TILE_V = wp.constant(8)
# Squares of corners that follow each other: queries that a thread of a CPU works on at once.
LEAF_SIDE = wp.constant(4)
LEAF = wp.constant(int(LEAF_SIDE) ** 2)
TILE_CORNERS = int(TILE_U) * int(TILE_V)
# Rasters reach so far from the foot of the origin along either axis: the scene has unit radius.
REACH = wp.constant(2.0)
FLAT = wp.constant(1.0 - SAME_NORMAL)
# Corners along either side that a value is interpolated from.
STENCIL = wp.constant(4)
# So far from the ends of rasters there are corners all around: the coarsest of squares have two there.
MARGIN = wp.constant(2.0 * float(COARSEST_SQUARE))
# Places along its way that a query looks at, at most: sixteen for each of the pieces that it would be cut into
# (tpdwarp.footprints.ways).
MOST_PLACES = wp.constant(16 * MOST_PIECES)
# What becomes of a query: its receiver has no background light; or it lies on no raster and is gathered itself.
ELSEWHERE = wp.constant(-1)
OFF_RASTER = wp.constant(-2)
# Of a tile, in the place of where its corners stand: they are not known yet, or no footprint reaches them.
UNKNOWN = wp.constant(-1)
DARK = wp.constant(-2)


@wp.struct
class RasterArrays:
    """Rasters of several planes, with one and the same sides of squares on each.

    Tiles are numbered plane by plane, side by side, ``first_tile`` counting from the first one of a plane; ``slots``
    says where the corners of a tile stand in ``values``, or ``UNKNOWN`` or ``DARK``.
    """

    receiver: wp.array(dtype=wp.int32)
    foot: wp.array(dtype=wp.vec3)
    normal: wp.array(dtype=wp.vec3)
    side: wp.array(dtype=wp.float32)
    tiles_across: wp.array(dtype=wp.int32)
    tiles_down: wp.array(dtype=wp.int32)
    first_tile: wp.array(dtype=wp.int32)
    tiles_of_plane: int
    slots: wp.array(dtype=wp.int32)
    values: wp.array(dtype=wp.vec3)


@wp.func
def on_plane(rasters: RasterArrays, plane: int, frame: TangentFrame, x: wp.vec3) -> wp.vec2:
    """Coordinates of x on a plane with its ``frame``, from the corner where its rasters begin."""
    d = x - rasters.foot[plane]
    return wp.vec2(wp.dot(frame.e1, d) + REACH, wp.dot(frame.e2, d) + REACH)


@wp.func
def tile_of(rasters: RasterArrays, plane: int, level: int, u: int, v: int) -> int:
    """The number of the tile that corner (u, v) belongs to."""
    within = u // TILE_U + rasters.tiles_across[level] * (v // TILE_V)
    return plane * rasters.tiles_of_plane + rasters.first_tile[level] + within


@wp.func
def tile_around(rasters: RasterArrays, plane: int, level: int, first: wp.vec2i, corner: int) -> int:
    """The tile of an outermost one of the corners that a value is interpolated from, of which ``first`` is the first.

    Tiles are no narrower than all of them together: they lie in those of the four outermost ones.
    """
    u = first[0] + (STENCIL - 1) * (corner % 2)
    v = first[1] + (STENCIL - 1) * (corner // 2)
    return tile_of(rasters, plane, level, u, v)


@wp.func
def within_tile(u: int, v: int) -> int:
    """The place of corner (u, v) in its tile, leaf by leaf: squares of four by four corners."""
    across = u % TILE_U
    down = v % TILE_V
    return LEAF * (across // LEAF_SIDE + TILE_U // LEAF_SIDE * (down // LEAF_SIDE)) + (
        across % LEAF_SIDE + LEAF_SIDE * (down % LEAF_SIDE)
    )


@wp.kernel(enable_backward=False)
def find_lit_tiles(
    base: int,
    # In
    rasters: RasterArrays,
    level: int,
    receiver: wp.array(dtype=wp.int32),
    pieces: wp.array(dtype=Piece),
    lower: wp.array(dtype=wp.vec3),
    upper: wp.array(dtype=wp.vec3),
    # Out
    lit: wp.array(dtype=wp.int32),
):
    """Marks the tiles of a level that pieces of footprints reach, by their boxes."""
    i = base + wp.tid()
    middle = 0.5 * (lower[i] + upper[i])
    margin = wp.vec3(BOX_MARGIN, BOX_MARGIN, BOX_MARGIN)
    half = 0.5 * (upper[i] - lower[i]) + 2.0 * margin
    side = rasters.side[level]
    for plane in range(rasters.receiver.shape[0]):
        if rasters.receiver[plane] == receiver[pieces[i].footprint]:
            n = rasters.normal[plane]
            if wp.abs(wp.dot(n, middle - rasters.foot[plane])) <= wp.dot(wp.abs(n), half):
                frame = tangent_frame(n)
                place = on_plane(rasters, plane, frame, middle)
                reach = wp.vec2(wp.dot(wp.abs(frame.e1), half), wp.dot(wp.abs(frame.e2), half))
                first = (place - reach) / side
                last = (place + reach) / side
                across = rasters.tiles_across[level]
                down = rasters.tiles_down[level]
                first_u = wp.max(int(wp.floor(first[0])) // TILE_U, 0)
                first_v = wp.max(int(wp.floor(first[1])) // TILE_V, 0)
                last_u = wp.min(int(wp.ceil(last[0])) // TILE_U, across - 1)
                last_v = wp.min(int(wp.ceil(last[1])) // TILE_V, down - 1)
                begin = plane * rasters.tiles_of_plane + rasters.first_tile[level]
                for v in range(first_v, last_v + 1):
                    for u in range(first_u, last_u + 1):
                        lit[begin + u + across * v] = 1


@wp.func
def place_count(motion: wp.vec3, window: TimeWindow, side: float) -> int:
    """At how many places of its way a query looks, on squares of ``side``: one for each that it passes."""
    return 1 + wp.min(int(window.length * wp.length(motion) / side), MOST_PLACES - 1)


@wp.func
def place_on_way(x: wp.vec3, motion: wp.vec3, window: TimeWindow, number: int, count: int) -> wp.vec3:
    """Where a query stands in the middle of one of ``count`` parts of its window."""
    late = window.center - window.time + window.length * ((float(number) + 0.5) / float(count) - 0.5)
    return x + late * motion


@wp.func
def corner_below(place: wp.vec2, side: float) -> wp.vec2i:
    """The first of the corners that a value at ``place`` is interpolated from."""
    return wp.vec2i(int(place[0] / side) - 1, int(place[1] / side) - 1)


@wp.kernel(enable_backward=False)
def find_planes(
    base: int,
    # In
    rasters: RasterArrays,
    queries: QueryArrays,
    windows: wp.array(dtype=TimeWindow),
    shaded: int,
    # Out
    planes: wp.array(dtype=wp.int32),
    wanted: wp.array(dtype=wp.int32),
):
    """The plane of each query, and which tiles queries need that are not known yet."""
    i = base + wp.tid()
    planes[i] = ELSEWHERE
    window = windows[wp.min(i, windows.shape[0] - 1)]
    x = queries.position[i]
    motion = wp.vec3()
    if queries.motion.shape[0] > 0:
        motion = queries.motion[i]
    for plane in range(rasters.receiver.shape[0]):
        if rasters.receiver[plane] == queries.receiver[i] and planes[i] < 0:
            planes[i] = OFF_RASTER
            n = rasters.normal[plane]
            flat = wp.dot(n, queries.normal[i]) > FLAT
            if shaded != 0:
                flat = flat and wp.dot(n, queries.shading_normal[i]) > FLAT
            frame = tangent_frame(n)
            for end in range(2):
                at = x + (window.center - window.time + (float(end) - 0.5) * window.length) * motion
                place = on_plane(rasters, plane, frame, at)
                # Two coarsest squares more, for the corners around it.
                inside = wp.min(place) > MARGIN and wp.max(place) < 2.0 * REACH - MARGIN
                flat = flat and inside and wp.abs(wp.dot(n, at - rasters.foot[plane])) <= PLANE_ROUNDING
            if flat:
                planes[i] = plane
    plane = planes[i]
    if plane >= 0:
        frame = tangent_frame(rasters.normal[plane])
        for level in range(rasters.side.shape[0]):
            side = rasters.side[level]
            count = place_count(motion, window, side)
            for number in range(count):
                place = on_plane(rasters, plane, frame, place_on_way(x, motion, window, number, count))
                first = corner_below(place, side)
                tile = tile_of(rasters, plane, level, first[0], first[1])
                # Tiles are no narrower than all of the corners: they lie in this one and the next along either axis.
                more_u = wp.where(first[0] % TILE_U > TILE_U - STENCIL, 2, 1)
                more_v = wp.where(first[1] % TILE_V > TILE_V - STENCIL, 2, 1)
                for v in range(more_v):
                    for u in range(more_u):
                        needed = tile + u + rasters.tiles_across[level] * v
                        if rasters.slots[needed] == UNKNOWN:
                            wanted[needed] = 1


@wp.kernel(enable_backward=False)
def place_corners(
    base: int,
    # In
    rasters: RasterArrays,
    level: int,
    tiles: wp.array(dtype=wp.int32),
    # Out
    queries: QueryArrays,
):
    """Queries at the corners of ``tiles``, which are all of one side."""
    i = base + wp.tid()
    tile = tiles[i // (TILE_U * TILE_V)]
    within = i % (TILE_U * TILE_V)
    plane = tile // rasters.tiles_of_plane
    number = tile % rasters.tiles_of_plane - rasters.first_tile[level]
    across = rasters.tiles_across[level]
    side = rasters.side[level]
    leaf = within // LEAF
    place = within % LEAF
    leaves_across = TILE_U // LEAF_SIDE
    corner_u = TILE_U * (number % across) + LEAF_SIDE * (leaf % leaves_across) + place % LEAF_SIDE
    corner_v = TILE_V * (number // across) + LEAF_SIDE * (leaf // leaves_across) + place // LEAF_SIDE
    u = float(corner_u) * side - REACH
    v = float(corner_v) * side - REACH
    n = rasters.normal[plane]
    frame = tangent_frame(n)
    queries.position[i] = rasters.foot[plane] + u * frame.e1 + v * frame.e2
    queries.normal[i] = n
    if queries.shading_normal.shape[0] > 0:
        queries.shading_normal[i] = n
    queries.receiver[i] = rasters.receiver[plane]


@wp.func
def cubic_weights(t: float) -> wp.vec4:
    """Weights of the four corners around a place that lies the part t between the inner two (Keys 1981, a = −½)."""
    return wp.vec4(
        0.5 * t * ((2.0 - t) * t - 1.0),
        1.0 + 0.5 * t * t * (3.0 * t - 5.0),
        0.5 * t * ((4.0 - 3.0 * t) * t + 1.0),
        0.5 * t * t * (t - 1.0),
    )


@wp.func
def interpolated(rasters: RasterArrays, plane: int, level: int, place: wp.vec2) -> wp.vec3:
    """The light of one raster at ``place``, no less than zero."""
    side = rasters.side[level]
    first = corner_below(place, side)
    lit = int(0)
    for corner in range(4):
        if rasters.slots[tile_around(rasters, plane, level, first, corner)] >= 0:
            lit = 1
    if lit == 0:
        return wp.vec3()
    along_u = cubic_weights(place[0] / side - float(first[0] + 1))
    along_v = cubic_weights(place[1] / side - float(first[1] + 1))
    # Tiles, and places within them, are sums of one number for each column and one for each row.
    tile_of_column = wp.vec4i()
    place_of_column = wp.vec4i()
    for u in range(STENCIL):
        tile_of_column[u] = tile_of(rasters, plane, level, first[0] + u, 0)
        place_of_column[u] = within_tile(first[0] + u, 0)
    total = wp.vec3()
    for v in range(STENCIL):
        down = tile_of(rasters, plane, level, 0, first[1] + v) - tile_of(rasters, plane, level, 0, 0)
        place_of_row = within_tile(0, first[1] + v)
        for u in range(STENCIL):
            slot = rasters.slots[tile_of_column[u] + down]
            if slot >= 0:
                value = rasters.values[slot * TILE_U * TILE_V + place_of_column[u] + place_of_row]
                total += (along_u[u] * along_v[v]) * value
    return wp.max(total, wp.vec3(0.0, 0.0, 0.0))


@wp.kernel(enable_backward=False)
def add_rasters(
    base: int,
    # In
    rasters: RasterArrays,
    queries: QueryArrays,
    windows: wp.array(dtype=TimeWindow),
    planes: wp.array(dtype=wp.int32),
    # Out
    irradiance: wp.array(dtype=wp.vec3),
):
    """Adds the light of all rasters to queries on planes, in the mean along their way."""
    i = base + wp.tid()
    plane = planes[i]
    if plane >= 0:
        window = windows[wp.min(i, windows.shape[0] - 1)]
        motion = wp.vec3()
        if queries.motion.shape[0] > 0:
            motion = queries.motion[i]
        total = irradiance[i]
        frame = tangent_frame(rasters.normal[plane])
        for level in range(rasters.side.shape[0]):
            count = place_count(motion, window, rasters.side[level])
            for number in range(count):
                at = place_on_way(queries.position[i], motion, window, number, count)
                place = on_plane(rasters, plane, frame, at)
                total += interpolated(rasters, plane, level, place) / float(count)
        irradiance[i] = total


class Rasters:
    """Smooth light on planes.

    Args:
        planes: The planes.
        levels: Footprints by the sides of the squares that they are gathered on; there may be several of one side.
        form: How they are evaluated.
        launcher: Where.

    Attributes:
        levels: The footprints of each raster.
    """

    def __init__(
        self, planes: list[Plane], levels: list[tuple[float, FootprintMap]], form: GatherForm, launcher: Launcher
    ) -> None:
        self.levels = [footprints for _, footprints in levels]
        self._form, self._launcher = form, launcher
        self._shaded = any(footprints.footprints.shaded for footprints in self.levels)
        sides = [side for side, _ in levels]
        # One square more, for the corners at the end.
        squares = [int(2.0 * float(REACH) / side) + 1 for side in sides]
        across, down = (np.array([-(-(count + 1) // size) for count in squares]) for size in (int(TILE_U), int(TILE_V)))
        first = np.concatenate([[0], np.cumsum(across * down)])
        self._first_tiles = first
        out = self._arrays = RasterArrays()
        out.receiver = launcher.array(np.array([plane.receiver for plane in planes], np.int32), wp.int32)
        for name in ("foot", "normal"):
            setattr(out, name, launcher.array(np.array([getattr(p, name) for p in planes], np.float32), wp.vec3))
        out.side = launcher.array(np.array(sides, np.float32), wp.float32)
        out.tiles_across = launcher.array(across.astype(np.int32), wp.int32)
        out.tiles_down = launcher.array(down.astype(np.int32), wp.int32)
        out.first_tile = launcher.array(first[:-1].astype(np.int32), wp.int32)
        out.tiles_of_plane = int(first[-1])
        lit = launcher.zeros(len(planes) * int(first[-1]), wp.int32)
        for level, footprints in enumerate(self.levels):
            if footprints.pieces is not None:
                found = footprints.pieces
                given = [out, level, footprints.footprints.arrays.receiver, found.rows, found.lower, found.upper]
                launcher(find_lit_tiles, found.rows.shape[0], [*given, lit])
        self._slots = np.where(lit.numpy() == 1, np.int32(UNKNOWN), np.int32(DARK))
        self._values = np.zeros((0, 3), np.float32)
        self._hold()

    def add_to(self, queries: QueryArrays, lookup: Lookup, irradiance: wp.array) -> np.ndarray:
        """Adds the light of the rasters to ``irradiance`` at ``queries``.

        Returns:
            Rows of queries that rasters say nothing of though there is such light on their receiver, shape [m].
        """
        count = queries.position.shape[0]
        planes = self._launcher.zeros(count, wp.int32)
        wanted = self._launcher.zeros(len(self._slots), wp.int32)
        shaded = int(self._shaded and has_shading_normals(queries))
        looking = queries if lookup.query_moves else at_rest(queries, self._launcher)
        windows = time_windows(lookup.windows(), self._launcher)
        self._launcher(find_planes, count, [self._arrays, looking, windows, shaded, planes, wanted])
        self._find(np.flatnonzero(wanted.numpy()))
        self._launcher(add_rasters, count, [self._arrays, looking, windows, planes, irradiance])
        return np.flatnonzero(planes.numpy() == int(OFF_RASTER))

    def _find(self, tiles: np.ndarray) -> None:
        """Gathers at the corners of ``tiles``."""
        if not len(tiles):
            return
        values = [self._values]
        levels = np.searchsorted(self._first_tiles, tiles % self._arrays.tiles_of_plane, side="right") - 1
        for level in np.unique(levels):
            those = tiles[levels == level].astype(np.int32)
            self._slots[those] = sum(map(len, values)) // TILE_CORNERS + np.arange(len(those), dtype=np.int32)
            corners = self._corners(int(level), those)
            found = gathered([self.levels[level]], corners, self._form, self._launcher, PLAIN_LOOKUP)
            values.append(found.irradiance.numpy())
        self._values = np.concatenate(values)
        self._hold()

    def _corners(self, level: int, tiles: np.ndarray) -> QueryArrays:
        count = len(tiles) * TILE_CORNERS
        queries = QueryArrays()
        queries.position, queries.normal = (self._launcher.zeros(count, wp.vec3) for _ in range(2))
        queries.motion = self._launcher.zeros(0, wp.vec3)
        queries.shading_normal = self._launcher.zeros(count if self._shaded else 0, wp.vec3)
        queries.receiver = self._launcher.zeros(count, wp.int32)
        self._launcher(place_corners, count, [self._arrays, level, self._launcher.array(tiles, wp.int32), queries])
        return queries

    def _hold(self) -> None:
        """Gives the device what is known by now."""
        self._arrays.slots = self._launcher.array(self._slots, wp.int32)
        self._arrays.values = self._launcher.array(self._values, wp.vec3)


def at_rest(queries: QueryArrays, launcher: Launcher) -> QueryArrays:
    """The queries without their motion."""
    out = QueryArrays()
    for name in QueryArrays.vars:
        setattr(out, name, getattr(queries, name))
    out.motion = launcher.zeros(0, wp.vec3)
    return out
