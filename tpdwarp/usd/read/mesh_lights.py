"""Meshes that shine: a few flat lights in the place of a mesh with UsdLux's MeshLightAPI.

Faces that look nearly the same way and lie side by side are one light: a parallelogram or a disk where their outline is
one, and else the rectangle of their variance; it has all of their area, so that no power is lost. Its light passes the
mesh itself. The mesh is seen as it shines.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from pxr import Usd, UsdLux

from tpdwarp.scene.description import (
    EmissionProfile,
    Extent,
    ExtentShape,
    Interaction,
    LightAtShutter,
    LightKind,
    Material,
    MeshAtShutter,
    Shutter,
)
from tpdwarp.usd.read.lights import Light
from tpdwarp.usd.read.values import number_or_fallback, text_at

# Lights that one mesh is, at most. Chosen, not derived: each takes shadow rays and a lattice of its own, and of a
# sphere they leave 30 degrees to each.
MOST_PARTS = 16
# Faces belong together while their vector area has this part of their area: cos 26° of a cone of them.
ALIKE = 0.95
# An outline is a parallelogram or a disk where its area, and that of its variance, agree within this part.
SAME_SHAPE = 0.03
# What is as wide one way as another is halved along the same one at every frame, whatever rounding says, and what
# differs by less than a part of this is the same.
EVEN = 1e-5
# A direction and its opposite are told apart by this one, to which hardly any is perpendicular.
ASKEW = np.sqrt([2.0, 3.0, 5.0, 7.0, 11.0, 13.0])
# Gaps count that leave either side so much of the area at least: a half less this.
MIDDLING = 0.3
UNEVEN = 1.0 + 0.001 * np.arange(6)


def is_mesh_light(prim: Usd.Prim) -> bool:
    """Whether a prim is a mesh that shines."""
    return prim.HasAPI(UsdLux.MeshLightAPI)


def all_parts(path: str) -> list[str]:
    """What the lights of a mesh may be called, by its path."""
    return [f"{path}/light{number}{side}" for number in range(MOST_PARTS) for side in ("", "b")]


class MeshLight(Light):
    """A mesh that shines; its :meth:`power` is its radiance (with ``normalize``, by area)."""

    def __init__(self, *arguments: object) -> None:
        super().__init__(*arguments)
        self._parts: tuple[np.ndarray, np.ndarray, list[np.ndarray]] | None = None
        self._seen: tuple[MeshAtShutter, tuple[float, ...], MeshAtShutter] | None = None

    @property
    def kind_name(self) -> str:
        return "mesh"

    def _factor(self, frame: float) -> float:
        return 1.0

    def parts(self, mesh: MeshAtShutter, shutter: Shutter) -> list[LightAtShutter]:
        """The flat lights that its mesh is over ``shutter``; none where it is dark."""
        radiance = np.array(self._radiance(mesh, shutter))
        if not radiance.any():
            return []
        clusters = self._clusters(mesh, shutter)
        double = number_or_fallback(self.prim.GetAttribute("doubleSided"), shutter.frame, self._warnings)
        sides = (1.0, -1.0) if double else (1.0,)
        found = []
        for number, faces in enumerate(clusters):
            flat = _flat(mesh, mesh.triangles[faces])
            for side in sides:
                found.append(self._light(f"{self.path}/light{number}{'b' * (side < 0)}", radiance, flat, side))
        return found

    def _clusters(self, mesh: MeshAtShutter, shutter: Shutter) -> list[np.ndarray]:
        """Numbers of the triangles of each light, by the shape at the frame: whatever frames were asked for before."""
        to_frame = (shutter.frame - shutter.middle) / shutter.exposure if shutter.exposure > 0 else 0.0
        points = mesh.points if mesh.motions is None else mesh.points + to_frame * mesh.motions
        shape = _in_own_space(points, mesh.triangles)
        known = self._parts
        same = known is not None and np.array_equal(known[0], mesh.triangles) and len(known[1]) == len(shape)
        # What only moves and turns keeps its lights; this is what is left of rounding then.
        if not same or np.abs(shape - known[1]).max() > 1e-6 * np.abs(shape).max():
            self._parts = mesh.triangles, shape, _clusters(shape, mesh.triangles)
        return self._parts[2]

    def shining(self, mesh: MeshAtShutter, shutter: Shutter) -> MeshAtShutter:
        """Its mesh as it is seen."""
        radiance = self._radiance(mesh, shutter)
        if self._seen is None or self._seen[0] is not mesh or self._seen[1] != radiance:
            materials = tuple(
                replace(material, emission=radiance, lamp=True)
                if material.interaction == Interaction.DIFFUSE
                else material
                for material in mesh.materials
            )
            if text_at(self.prim.GetAttribute("light:materialSyncMode")) == "noMaterialResponse":
                materials = (Material(color=(0.0, 0.0, 0.0), emission=radiance, lamp=True),) * len(materials)
                self._seen = mesh, radiance, replace(mesh, materials=materials, colors=None, color_indices=None)
            else:
                self._seen = mesh, radiance, replace(mesh, materials=materials)
        return self._seen[2]

    def _radiance(self, mesh: MeshAtShutter, shutter: Shutter) -> tuple[float, float, float]:
        """Its radiance; where its material glows, by that colour, unless it is to be left out."""
        power = np.array(self._mean_power(shutter))
        if text_at(self.prim.GetAttribute("light:materialSyncMode")) in ("", "materialGlowTintsLight"):
            glow = next((material.emission for material in mesh.materials if any(material.emission)), None)
            power = power if glow is None else power * glow
        if number_or_fallback(self._api.GetNormalizeAttr(), shutter.frame, self._warnings):
            power = power / max(float(_areas(mesh.points, mesh.triangles)[1].sum()), np.finfo(float).tiny)
        return tuple(map(float, power))

    def _light(self, path: str, radiance: np.ndarray, flat: _Flat, side: float) -> LightAtShutter:
        opened, axes, closed = (flat.axes(part, side) for part in (-0.5, 0.0, 0.5))
        return LightAtShutter(
            path,
            LightKind.POINT,
            tuple(map(float, radiance * flat.area)),
            flat.position,
            axes,
            flat.position_motion,
            closed - opened,
            profile=EmissionProfile.COSINE,
            extent=Extent(flat.shape, 0.0, flat.spans, flat.spans_motion),
            meshed=True,
        )


@dataclass(frozen=True, eq=False)
class _Flat:
    """A flat light: its middle [3], half of it along two axes [2, 3] (first, then turned to the left about the normal),
    how these move over the shutter, and its area."""

    shape: ExtentShape
    area: float
    position: np.ndarray
    spans: np.ndarray
    position_motion: np.ndarray
    spans_motion: np.ndarray

    def axes(self, part: float, side: float) -> np.ndarray:
        """Axes of the light, which shines along −z, at the part (−½ … ½) of the shutter, shape [3, 3]."""
        x, across = self.spans + part * self.spans_motion
        z = -side * np.cross(x, across)
        x, z = (v / max(float(np.linalg.norm(v)), np.finfo(float).tiny) for v in (x, z))
        return np.stack([x, np.cross(z, x), z])


def _areas(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vector areas [m, 3] of triangles, and areas [m]."""
    a, b, c = (points[triangles[:, corner]] for corner in range(3))
    vectors = 0.5 * np.cross(b - a, c - a)
    return vectors, np.linalg.norm(vectors, axis=1)


def _in_own_space(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Points [v, 3] as seen from the first triangle that has an area, so that what moves as a whole stays the same."""
    vectors, areas = _areas(points, triangles)
    first = int(np.argmax(areas > 1e-3 * areas.mean()))
    a, b, _ = points[triangles[first]]
    x, z = (v / max(float(np.linalg.norm(v)), np.finfo(float).tiny) for v in (b - a, vectors[first]))
    return (points - a) @ np.stack([x, np.cross(z, x), z]).T


def _clusters(points: np.ndarray, triangles: np.ndarray) -> list[np.ndarray]:
    """Numbers of the triangles of each light: halved, where their normals differ most, until they are alike."""
    vectors, areas = _areas(points, triangles)
    normals = vectors / np.maximum(areas, np.finfo(float).tiny)[:, None]
    middles = points[triangles].mean(axis=1)
    size = max(float(np.ptp(middles, axis=0).max()), np.finfo(float).tiny)
    parts = [np.flatnonzero(areas > 0)]
    done: list[np.ndarray] = []
    while parts and len(parts) + len(done) < MOST_PARTS:
        # The part that misses most.
        misses = [areas[part].sum() - float(np.linalg.norm(vectors[part].sum(axis=0))) for part in parts]
        part = parts.pop(int(np.argmax(np.array(misses) > max(misses) - EVEN * areas.sum())))
        whole = float(areas[part].sum())
        if len(part) < 2 or max(misses) <= (1.0 - ALIKE) * whole:
            done.append(part)
            continue
        features = np.concatenate([normals[part], middles[part] / size], axis=1) * UNEVEN
        weights = areas[part] / whole
        off = features - weights @ features
        spread, directions = np.linalg.eigh((off * weights[:, None]).T @ off)
        widest = directions[:, int(np.argmax(spread))]
        along = off @ (widest * np.sign(widest @ ASKEW))
        order = np.argsort(np.round(along / EVEN), kind="stable")
        half = _where_to_cut(along[order], weights[order], float(np.sqrt(spread.max())))
        parts += [np.sort(part[order[:half]]), np.sort(part[order[half:]])]
    return done + [part for part in parts if len(part)]


def _where_to_cut(along: np.ndarray, weights: np.ndarray, spread: float) -> int:
    """Where to cut triangles in a row in two: at a gap as wide as they are spread, as edges have it, or else in half.

    Args:
        along: Where they lie, increasing, shape [m], m above 1.
        weights: Their shares of the area, shape [m].
        spread: Standard deviation of ``along``.
    """
    share = np.cumsum(weights)
    gaps = np.where(np.abs(share[:-1] - 0.5) <= MIDDLING, np.diff(along), 0.0)
    widest = int(np.argmax(gaps > gaps.max() - EVEN))
    if gaps[widest] > spread:
        return widest + 1
    return int(np.searchsorted(share, 0.5 + EVEN).clip(1, len(along) - 1))


def _flat(mesh: MeshAtShutter, triangles: np.ndarray) -> _Flat:
    """The flat light that some triangles are."""
    used, local = np.unique(triangles, return_inverse=True)
    points, triangles = mesh.points[used], local.reshape(-1, 3)
    vectors, areas = _areas(points, triangles)
    area = float(areas.sum())
    spans = _parallelogram(points, area)
    shape, share = ExtentShape.RECT, np.full(len(points), 1.0 / len(points))
    if spans is None:
        share = np.bincount(triangles.ravel(), weights=np.repeat(areas / (3.0 * area), 3), minlength=len(points))
        shape, spans = _of_variance(points - share @ points, triangles, areas, vectors.sum(axis=0))
    if np.cross(*spans) @ vectors.sum(axis=0) < 0:
        spans = spans * [[1.0], [-1.0]]
    # By the points that they come from, they move as these do.
    middle = share @ points
    moves = np.zeros_like(points) if mesh.motions is None else mesh.motions[used]
    moved = share @ moves
    spans_motion = spans @ np.linalg.pinv(points - middle) @ (moves - moved)
    return _Flat(shape, area, middle, spans, moved, spans_motion)


def _of_variance(
    off: np.ndarray, triangles: np.ndarray, areas: np.ndarray, vector: np.ndarray
) -> tuple[ExtentShape, np.ndarray]:
    """The disk or rectangle, by half of it along its axes [2, 3], that has the variance and area of triangles.

    Args:
        off: Points about their middle.
        vector: Sum of the vector areas.
    """
    area = float(areas.sum())
    corners, weights = off[triangles], areas / area
    # Of a triangle with corners v about the middle: (Σ v vᵀ + (Σ v)(Σ v)ᵀ)/12.
    total = corners.sum(axis=1)
    variance = np.einsum("m,mki,mkj->ij", weights, corners, corners) + np.einsum("m,mi,mj->ij", weights, total, total)
    normal = vector / max(float(np.linalg.norm(vector)), np.finfo(float).tiny)
    flat = np.eye(3) - np.outer(normal, normal)
    squares, directions = np.linalg.eigh(flat @ (variance / 12.0) @ flat)
    one, other = np.sqrt(np.maximum(squares[[2, 1]], 1e-12 * area))
    of_disk = 4.0 * np.pi * one * other
    shape = ExtentShape.DISK if abs(of_disk - area) < SAME_SHAPE * area else ExtentShape.RECT
    scale = 2.0 * np.sqrt(area / of_disk) if shape == ExtentShape.DISK else 0.5 * np.sqrt(area / (one * other))
    return shape, scale * np.array([[one], [other]]) * directions[:, [2, 1]].T


def _parallelogram(corners: np.ndarray, area: float) -> np.ndarray | None:
    """Half sides [2, 3] of the parallelogram that four corners make; None for anything else."""
    if len(corners) != 4:
        return None
    size = float(np.ptp(corners, axis=0).max())
    for opposite, (b, c) in ((1, (2, 3)), (2, (1, 3)), (3, (1, 2))):
        if np.linalg.norm(corners[0] + corners[opposite] - corners[b] - corners[c]) < 1e-3 * size:
            spans = 0.5 * np.stack([corners[b] - corners[0], corners[c] - corners[0]])
            if abs(4.0 * float(np.linalg.norm(np.cross(*spans))) - area) < SAME_SHAPE * area:
                return spans
    return None
