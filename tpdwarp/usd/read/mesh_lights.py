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


def is_mesh_light(prim: Usd.Prim) -> bool:
    """Whether a prim is a mesh that shines."""
    return prim.HasAPI(UsdLux.MeshLightAPI)


class MeshLight(Light):
    """A mesh that shines; its :meth:`power` is its radiance (with ``normalize``, by area)."""

    def __init__(self, *arguments: object) -> None:
        super().__init__(*arguments)
        self._parts: tuple[np.ndarray, list[np.ndarray]] | None = None
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
        if self._parts is None or not np.array_equal(self._parts[0], mesh.triangles):
            self._parts = mesh.triangles, _clusters(mesh)
        double = number_or_fallback(self.prim.GetAttribute("doubleSided"), shutter.frame, self._warnings)
        sides = (1.0, -1.0) if double else (1.0,)
        found = []
        for number, faces in enumerate(self._parts[1]):
            flat = _flat(mesh, mesh.triangles[faces])
            for side in sides:
                found.append(self._light(f"{self.path}/light{number}{'b' * (side < 0)}", radiance, flat, side))
        return found

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


def _clusters(mesh: MeshAtShutter) -> list[np.ndarray]:
    """Numbers of the triangles of each light: halved, where their normals differ most, until they are alike."""
    vectors, areas = _areas(mesh.points, mesh.triangles)
    normals = vectors / np.maximum(areas, np.finfo(float).tiny)[:, None]
    middles = mesh.points[mesh.triangles].mean(axis=1)
    size = max(float(np.ptp(middles, axis=0).max()), np.finfo(float).tiny)
    parts = [np.flatnonzero(areas > 0)]
    done: list[np.ndarray] = []
    while parts and len(parts) + len(done) < MOST_PARTS:
        # The part that misses most.
        misses = [areas[part].sum() - float(np.linalg.norm(vectors[part].sum(axis=0))) for part in parts]
        part = parts.pop(int(np.argmax(misses)))
        whole = float(areas[part].sum())
        if len(part) < 2 or max(misses) <= (1.0 - ALIKE) * whole:
            done.append(part)
            continue
        features = np.concatenate([normals[part], middles[part] / size], axis=1)
        weights = areas[part] / whole
        off = features - weights @ features
        spread, directions = np.linalg.eigh((off * weights[:, None]).T @ off)
        along = off @ directions[:, int(np.argmax(spread))]
        order = np.argsort(along, kind="stable")
        half = int(np.searchsorted(np.cumsum(weights[order]), 0.5).clip(1, len(part) - 1))
        parts += [np.sort(part[order[:half]]), np.sort(part[order[half:]])]
    return done + [part for part in parts if len(part)]


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
