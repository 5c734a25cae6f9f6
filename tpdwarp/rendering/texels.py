"""Texels of a receiver: where on its triangles each texel of its texture lies, with gutters around its charts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.rendering.surface_points import SurfacePoints

# Triangles whose area in the texture is a smaller part of a texel have no place in it: some 16 roundings of texels.
SMALLEST_AREA = 1.0e-6
# Sides of texels that differ by less than this, on the whole, are taken for the same. Positions are authored in single
# precision: on meshes of a thousand edges across, edges are rounded by 6e-5 of themselves.
AFFINE = 1.0e-3


@dataclass(frozen=True, eq=False)
class Texels:
    """The texels of one tile that lie on a receiver, or within the gutter around it.

    Attributes:
        resolution: Texels along each side of the tile.
        places: Their places in the tile, row by row from t = 1 down, shape [n].
        points: Where they are on the receiver's triangles, numbered among themselves; those of gutters at the nearest
            place of a chart.
        inside: Whether their middles lie on a triangle, and not in a gutter, shape [n].
    """

    resolution: int
    places: np.ndarray
    points: SurfacePoints
    inside: np.ndarray

    def picture(self, values: np.ndarray) -> np.ndarray:
        """Values [n, c] of the texels as a picture [resolution, resolution, c]; zero where there is none."""
        out = np.zeros((self.resolution**2, values.shape[1]), np.float32)
        out[self.places] = values
        return out.reshape(self.resolution, self.resolution, -1)


@wp.kernel(enable_backward=False)
def _nearest(
    base: int,
    mesh: wp.uint64,
    resolution: int,
    gutter: float,
    triangles: wp.array(dtype=wp.int32),
    weights: wp.array(dtype=wp.vec2),
    inside: wp.array(dtype=wp.int32),
):
    i = base + wp.tid()
    row = i / resolution
    x = wp.vec3(float(i - row * resolution) + 0.5, float(resolution - row) - 0.5, 0.0)
    triangles[i] = -1
    found = wp.mesh_query_point_no_sign(mesh, x, gutter)
    if found.result:
        triangles[i] = found.face
        weights[i] = wp.vec2(found.u, found.v)
        # A middle on a triangle is met but for rounding, which is some millionths of the coordinates.
        away = wp.length(wp.mesh_eval_position(mesh, found.face, found.u, found.v) - x)
        inside[i] = wp.where(away < 1.0e-5 * float(resolution), 1, 0)


def tiles_of(coordinates: np.ndarray) -> list[tuple[int, int]]:
    """The unit squares of (s, t) that triangles with these coordinates [m, 3, 2] lie in, in the order of their rows."""
    low = np.floor(coordinates.min(axis=1) + 1e-6).astype(int)
    high = np.maximum(np.ceil(coordinates.max(axis=1) - 1e-6).astype(int) - 1, low)
    tiles = {
        (u, v)
        for (u0, v0), (u1, v1) in {(tuple(a), tuple(b)) for a, b in zip(low.tolist(), high.tolist(), strict=True)}
        for u in range(u0, u1 + 1)
        for v in range(v0, v1 + 1)
    }
    return sorted(tiles, key=lambda tile: (tile[1], tile[0]))


def texels_of(
    coordinates: np.ndarray, tile: tuple[int, int], resolution: int, gutter: float, launcher: Launcher
) -> Texels:
    """The texels of a tile.

    Args:
        coordinates: Texture coordinates of the corners of the receiver's triangles, shape [m, 3, 2].
        tile: Which unit square of (s, t).
        resolution: Texels along each of its sides.
        gutter: How far beyond charts texels are filled [texels].
        launcher: The device.
    """
    places = (np.asarray(coordinates, np.float64) - np.asarray(tile)) * resolution
    area = 0.5 * np.abs(_determinants(places))
    beside = (places.min(axis=1) > resolution + gutter) | (places.max(axis=1) < -gutter)
    kept = np.flatnonzero((area > SMALLEST_AREA) & ~beside.any(axis=1))
    count = resolution**2
    if not len(kept):
        nothing = np.zeros(0, np.int32)
        points = SurfacePoints(nothing, np.zeros((0, 2), np.float32), np.zeros(0, np.float32))
        return Texels(resolution, nothing, points, np.zeros(0, bool))
    flat = np.zeros((3 * len(kept), 3), np.float32)
    flat[:, :2] = places[kept].reshape(-1, 2)
    mesh = wp.Mesh(
        points=wp.array(flat, dtype=wp.vec3, device=launcher.device),
        indices=wp.array(np.arange(len(flat), dtype=np.int32), dtype=wp.int32, device=launcher.device),
    )
    triangles, weights = launcher.zeros(count, wp.int32), launcher.zeros(count, wp.vec2)
    inside = launcher.zeros(count, wp.int32)
    launcher(_nearest, count, [mesh.id, resolution, max(gutter, 0.5), triangles, weights, inside])
    found = np.flatnonzero(triangles.numpy() >= 0)
    chosen = kept[triangles.numpy()[found]].astype(np.int32)
    points = SurfacePoints(chosen, weights.numpy()[found], np.ones(len(found), np.float32))
    return Texels(resolution, found, points, inside.numpy()[found] > 0)


def overlap_of(coordinates: np.ndarray, texels: list[Texels]) -> float:
    """How many times over triangles lie on each other in a texture, as far as its texels show: 1 where they do not."""
    area = 0.5 * np.abs(_determinants(coordinates)).sum()
    covered = sum(float(found.inside.sum()) / found.resolution**2 for found in texels)
    return float(area / covered) if covered else 1.0


def texel_size(
    corners: np.ndarray, coordinates: np.ndarray, resolution: int, keeps_shape: bool, scale: float
) -> PixelSize:
    """What a texel stands for on a receiver.

    Where the map from (s, t) to the surface is affine and the same all over, that is the exact parallelogram with the
    sides ∂P/∂s and ∂P/∂t of a texel; else a square of the mean area of its texels.

    Args:
        corners: Positions of the corners of the receiver's triangles, shape [m, 3, 3], in scene units.
        coordinates: Their (s, t), shape [m, 3, 2].
        resolution: Texels along a side of a tile.
        keeps_shape: Whether the receiver stands still or is only moved over the shutter: turned, or bent, its
            parallelogram would change.
        scale: The tracer's units in a scene unit.
    """
    size = PixelSize()
    edges, sides = corners[:, 1:] - corners[:, :1], coordinates[:, 1:] - coordinates[:, :1]
    determinant = _determinants(coordinates)
    area = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    seen = np.abs(determinant) * resolution**2 > SMALLEST_AREA
    if not seen.any():
        return size
    weight = np.abs(determinant[seen])
    # Rows are ∂P/∂s and ∂P/∂t: edges = sides · rows.
    rows = np.linalg.solve(sides[seen], edges[seen])
    mean = np.average(rows, axis=0, weights=weight)
    spread = np.sqrt(np.average(((rows - mean) ** 2).sum(axis=(1, 2)), weights=weight))
    if keeps_shape and spread < AFFINE * np.linalg.norm(mean):
        right, up = mean * scale / resolution
        size.right, size.up, size.orthographic = wp.vec3(*right), wp.vec3(*up), 1
        normal = np.cross(right, up)
        size.back = wp.vec3(*(normal / np.linalg.norm(normal)))
    else:
        size.base = scale * float(np.sqrt(area[seen].sum() / (0.5 * weight.sum()))) / resolution
    return size


def _determinants(coordinates: np.ndarray) -> np.ndarray:
    """Twice the signed areas, shape [m], of triangles in the plane with these corners [m, 3, 2]."""
    sides = coordinates[:, 1:] - coordinates[:, :1]
    return sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]
