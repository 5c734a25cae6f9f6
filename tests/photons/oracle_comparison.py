"""Photons of the renderer against finite differences of the float64 oracle, column by column.

The tolerance is the condition of the problem: the oracle is asked again with all its input (vertices, motions, normals,
rays) rounded to float32 in the renderer's units, and each operation along a path is taken to do as much harm as that
one rounding.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tpdwarp.scene.description import MeshAtShutter, SceneAtShutter
from usd_scenes.oracle import Path, finite_differences, surfaces_of
from usd_scenes.oracle.differences import Differentials

from .traced import EPS, Traced, emission_of

COLUMNS = ("positions", "dxdu", "dxdv", "dxdt")
OPERATIONS = 100
"""Roundings that add up: an interaction has about as many (intersection 30, transfer 20, normal 25, scattering 25)."""
EDGE = 2e-4
"""Photons this near (in barycentrics) to an edge may meet the neighbouring triangle in float32."""


@dataclass(frozen=True)
class Agreement:
    """How far photons are from the oracle.

    Attributes:
        compared: How many photons were compared.
        ratios: Largest error of each column, in units of its tolerance; one or less is agreement.
        errors: Largest error of each column relative to its largest value.
    """

    compared: int
    ratios: dict[str, float]
    errors: dict[str, float]


def compare(
    result: Traced, anchor: str, mask: int = 0, among: np.ndarray | bool = True, count: int = 40
) -> Agreement:
    """Compares up to ``count`` photons, spread evenly over those of one ``mask`` and ``among`` [n], with the oracle.

    Raises:
        AssertionError: The oracle follows too few of these photons along the same path.
    """
    rows = np.flatnonzero((result.masks == mask) & among)
    rows = rows[np.argsort(result.photons.ids[rows])]
    rows = rows[np.linspace(0, len(rows) - 1, min(count, len(rows))).astype(int)]
    exact, away = reference(result, rows, anchor, mask)
    rounded = _oracle(result, _rounded_scene(result), rows, anchor, mask, _float32)
    path = exact.path
    away &= path.bounces == rounded.path.bounces
    assert np.isfinite(exact.dxdt[away]).all() and path.landed[away].all()
    assert away.sum() >= 0.75 * len(rows) >= 8
    photons = result.pick(rows[away])
    np.testing.assert_array_equal(photons.bounces, path.bounces[away])
    expected, other = _columns(exact), _columns(rounded)
    ratios, errors = {}, {}
    for name in COLUMNS:
        truth = expected[name][away]
        error = np.linalg.norm(getattr(photons, name) - truth, axis=1)
        harm = np.linalg.norm(other[name][away] - truth, axis=1)
        typical = np.sqrt(np.mean(harm**2)) + EPS * np.linalg.norm(truth, axis=1)
        ratios[name] = float((error / (OPERATIONS * np.maximum(harm, typical) + 1e-12)).max())
        errors[name] = float(error.max() / max(np.linalg.norm(truth, axis=1).max(), 1e-12))
    return Agreement(int(away.sum()), ratios, errors)


def reference(
    result: Traced, rows: np.ndarray, anchor: str = "surface", mask: int = 0
) -> tuple[Differentials, np.ndarray]:
    """What the oracle makes of the photons ``rows`` of one ``mask``, and which of them it can be compared with."""
    exact = _oracle(result, result.scene, rows, anchor, mask, lambda values: values)
    path = exact.path
    margins = np.nanmin(np.where(np.isfinite(path.barycentrics), path.barycentrics, np.inf), axis=(0, 2))
    origins = emission_of(result, rows=rows)[0]
    followed = path.landed & (path.bounces == result.photons.bounces[rows])
    # Bits of a mask count decisions: those of bounces as long as no light is totally reflected before them.
    for bounce in range(mask.bit_length()):
        followed &= path.transmitted[bounce] == (not mask >> bounce & 1)
    return exact, (margins > EDGE) & followed & _consistent(result.scene, origins, path)


def _oracle(result: Traced, scene: SceneAtShutter, rows: np.ndarray, anchor: str, mask: int, rounding) -> Differentials:
    shutter = scene.shutter
    choices = ["reflect" if mask >> bounce & 1 else "auto" for bounce in range(mask.bit_length() + 1)]

    def emit(u: np.ndarray, v: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        time = (t - shutter.middle) / shutter.exposure
        origins, directions = emission_of(result, np.stack([u, v], axis=1), time, rows)
        return origins, directions

    start = result.photons.emission[rows]
    if rounding is _float32:
        exact = emit

        def emit(u: np.ndarray, v: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
            origins, directions = exact(u, v, t)
            base, towards = exact(*start.T, t)
            return origins + _shift(result, base), directions + (_float32(towards) - towards)

    return finite_differences(surfaces_of(scene), emit, *start.T, shutter, anchor, choices)


def _consistent(scene: SceneAtShutter, origins: np.ndarray, path: Path) -> np.ndarray:
    """Whether light stays on its side of the facets where it reflects, and changes it where it refracts, shape [n].

    Where interpolated normals say otherwise the renderer takes the facet's own, and the oracle does not.
    """
    points = np.concatenate([origins[None], path.points])
    consistent = np.ones(len(origins), dtype=bool)
    for index, surface in enumerate(surfaces_of(scene)):
        for bounce in range(len(path.surfaces) - 1):
            rays = np.flatnonzero((path.surfaces[bounce] == index) & (bounce < path.bounces))
            normals = surface.frame(points[bounce + 1, rays], path.primitives[bounce, rays], scene.shutter.middle)[0]
            before, after = (
                np.einsum("ij,ij->i", normals, points[k + 1, rays] - points[k, rays]) for k in (bounce, bounce + 1)
            )
            consistent[rays] &= (before * after > 0) == path.transmitted[bounce, rays]
    return consistent


def _shift(result: Traced, origins: np.ndarray) -> np.ndarray:
    norm = result.plan.normalization
    local = (origins - np.array(norm.origin)) * norm.scale
    return (_float32(local) - local) / norm.scale


def _rounded_scene(result: Traced) -> SceneAtShutter:
    norm = result.plan.normalization

    def rounded(mesh: MeshAtShutter) -> MeshAtShutter:
        changes = {"points": norm.world_points(norm.points(mesh.points))}
        for name in ("motions", "normals", "normal_motions"):
            if getattr(mesh, name) is not None:
                changes[name] = _float32(getattr(mesh, name))
        return replace(mesh, **changes)

    return replace(result.scene, meshes=tuple(rounded(mesh) for mesh in result.scene.meshes))


def _float32(values: np.ndarray) -> np.ndarray:
    return values.astype(np.float32).astype(np.float64)


def _columns(found: Differentials) -> dict[str, np.ndarray]:
    return {
        "positions": found.path.positions,
        "dxdu": found.dxdu,
        "dxdv": found.dxdv,
        "dxdt": found.dxdt_relative,
    }
