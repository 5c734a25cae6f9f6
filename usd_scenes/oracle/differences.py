"""Derivatives of a photon's landing point and direction, by finite differences of the tracer.

Along one path (the same triangles and branches) landing is a smooth function of emission coordinates and time, so
central differences converge with order 2, and Ridders' extrapolation brings them near rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tpdwarp.scene.description import Shutter

from .emission import Emission
from .surfaces import Surface
from .tracer import Choices, Path, trace

COLUMNS = ("dxdu", "dxdv", "dxdt", "domegadu", "domegadv", "domegadt", "receiver_motion")


@dataclass(frozen=True, eq=False)
class Differentials:
    """A photon at mid shutter and its columns, [n, 3] each; NaN where it did not land.

    Attributes:
        path: The photons at mid shutter.
        dxdu, dxdv: Landing point per unit of u and v.
        dxdt: Displacement of the landing point over the whole exposure, in the world.
        domegadu, domegadv, domegadt: The same of the unit direction on arrival.
        receiver_motion: Displacement of the receiver's material at the landing point over the exposure.
        errors: Estimated absolute error of each column, name → [n]; infinite for a single difference.
    """

    path: Path
    dxdu: np.ndarray
    dxdv: np.ndarray
    dxdt: np.ndarray
    domegadu: np.ndarray
    domegadv: np.ndarray
    domegadt: np.ndarray
    receiver_motion: np.ndarray
    errors: dict[str, np.ndarray]

    @property
    def dxdt_relative(self) -> np.ndarray:
        """Displacement over the receiver's material, shape [n, 3]; it lies in the receiver's tangent plane."""
        return self.dxdt - self.receiver_motion


def finite_differences(
    scene: Sequence[Surface],
    emit: Emission,
    u: np.ndarray,
    v: np.ndarray,
    shutter: Shutter,
    anchor: str = "surface",
    choices: Choices = "auto",
    steps: tuple[float, float, float] = (0.05, 0.05, 0.05),
    levels: int = 6,
    max_bounces: int = 16,
) -> Differentials:
    """Central differences around mid shutter, extrapolated to step zero.

    Args:
        scene: Surfaces.
        emit: Rays of emission coordinates at a time.
        u, v: Emission coordinates, shape [n].
        shutter: Time derivatives are taken at its middle and scaled to its duration.
        anchor: What stays the same while time varies: ``light`` the emission coordinates, ``surface`` the material
            point (triangle and barycentrics) of the first surface met, where that is specular.
        choices: Branches, as for :func:`trace`.
        steps: Largest steps in u, v and time (in exposures). They are halved from level to level.
        levels: 1 for one central difference (order 2), 2 for Richardson's extrapolation (order 4), more for Ridders'
            table, of which each photon takes the entry with the smallest estimated error.
        max_bounces: As for :func:`trace`.

    Returns:
        The differentials.

    Raises:
        ValueError: The anchor is unknown.
    """
    if anchor not in ("light", "surface"):
        raise ValueError(f"a photon rides on its light or a surface, not {anchor!r}")
    u, v = (np.array(a, dtype=np.float64).reshape(-1) for a in (u, v))
    middle, exposure = shutter.middle, shutter.exposure
    base = trace(scene, *emit(u, v, middle), middle, choices, max_bounces)

    def landing(u: np.ndarray, v: np.ndarray, t: float) -> np.ndarray:
        path = trace(scene, *emit(u, v, t), t, along=base)
        return np.stack([path.positions, path.directions], axis=1)

    def along_time(h: float) -> np.ndarray:
        t = middle + h * exposure
        moved = _riding(scene, emit, u, v, middle, t, base) if anchor == "surface" else (u, v)
        return np.concatenate([landing(*moved, t), _followed(scene, base, middle, t)[:, None]], axis=1)

    by_u, error_u = _derivative(lambda h: landing(u + h, v, middle), steps[0], levels)
    by_v, error_v = _derivative(lambda h: landing(u, v + h, middle), steps[1], levels)
    by_t, error_t = _derivative(along_time, steps[2], levels)
    def columns(u: np.ndarray, v: np.ndarray, t: np.ndarray) -> dict[str, np.ndarray]:
        return dict(zip(COLUMNS, (u[:, 0], v[:, 0], t[:, 0], u[:, 1], v[:, 1], t[:, 1], t[:, 2]), strict=True))

    return Differentials(path=base, errors=columns(error_u, error_v, error_t), **columns(by_u, by_v, by_t))


def _derivative(
    function: Callable[[float], np.ndarray], step: float, levels: int
) -> tuple[np.ndarray, np.ndarray]:
    """Derivative at zero of a function with values [n, k, 3], and its estimated error [n, k] (Ridders' method)."""
    row: list[np.ndarray] = []
    best, error = None, None
    for level in range(levels):
        h = step / 2**level
        previous, row = row, [(function(h) - function(-h)) / (2 * h)]
        if best is None:
            best, error = row[0].copy(), np.full(row[0].shape[:-1], np.inf)
        for order in range(1, level + 1):
            factor = 4.0**order
            row.append((factor * row[order - 1] - previous[order - 1]) / (factor - 1))
            estimate = np.maximum(
                np.abs(row[order] - row[order - 1]).max(axis=-1), np.abs(row[order] - previous[order - 1]).max(axis=-1)
            )
            better = estimate < error
            best[better], error[better] = row[order][better], estimate[better]
    return best, error


def _followed(scene: Sequence[Surface], base: Path, start: float, end: float) -> np.ndarray:
    """Where the receivers' material points at the landing points have gone, shape [n, 3]."""
    return _material_points(scene, base, base.bounces, base.landed, start, end)


def _material_points(
    scene: Sequence[Surface], base: Path, bounces: np.ndarray, chosen: np.ndarray, start: float, end: float
) -> np.ndarray:
    """Where the material points of hit ``bounces`` [n] have gone, for the ``chosen`` rays; NaN elsewhere."""
    moved = np.full((len(chosen), 3), np.nan)
    rays = np.flatnonzero(chosen)
    ids = base.surfaces[bounces[rays], rays]
    for index, surface in enumerate(scene):
        rows = rays[ids == index]
        if len(rows):
            hits = base.points[bounces[rows], rows]
            moved[rows] = surface.follow(hits, base.primitives[bounces[rows], rows], start, end)
    return moved


def _riding(
    scene: Sequence[Surface], emit: Emission, u: np.ndarray, v: np.ndarray, start: float, end: float, base: Path
) -> tuple[np.ndarray, np.ndarray]:
    """Emission coordinates whose rays meet, at time ``end``, the material points that u, v met first at ``start``.

    Gauss–Newton on the exact condition; nothing is linearised. NaN where no ray of the emission reaches the point.
    """
    rides = base.landed & (base.bounces > 0)
    target = _material_points(scene, base, np.zeros(len(u), dtype=int), rides, start, end)
    first = base.first(1)

    def miss(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        return (trace(scene, *emit(u, v, end), end, along=first).points[0] - target)[rides]

    a, b, h = u.copy(), v.copy(), 1e-4
    for _ in range(12):
        residual = miss(a, b)
        jacobian = np.stack([miss(a + h, b) - miss(a - h, b), miss(a, b + h) - miss(a, b - h)], axis=2) / (2 * h)
        usable = np.isfinite(jacobian).all(axis=(1, 2)) & np.isfinite(residual).all(axis=1)
        change = np.full((len(residual), 2), np.nan)
        change[usable] = -np.einsum("nij,nj->ni", np.linalg.pinv(jacobian[usable]), residual[usable])
        a[rides] += change[:, 0]
        b[rides] += change[:, 1]
        scale = np.nanmax(np.abs(change), initial=0.0)
        if scale < 1e-13 * max(1.0, float(np.nanmax(np.abs([a, b]), initial=0.0))):
            break
    return a, b
