"""Footprint kernels by brute force: only the shapes are written down, every integral is a quadrature.

Filter space: radial kernels live on the unit disc, onto which the ellipse with semi-axes ½D_u x, ½D_v x is mapped; the
B-spline lives on the lattice, one unit a cell. ``v`` is the displacement over the whole exposure in filter space.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np

from .quadrature import integrate

SHAPES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "uniform": lambda r: np.ones_like(r),
    "cone": lambda r: 1 - r,
    "epanechnikov": lambda r: 1 - r**2,
    "quartic": lambda r: (1 - r**2) ** 2,
    "gaussian": lambda r: np.exp(-0.5 * r**2),
}
"""Radial kernels on r < 1, up to a factor."""

KERNELS = (*SHAPES, "bspline")


@cache
def peak(kernel: str) -> float:
    """The factor that makes the integral over the plane one."""
    shape = SHAPES[kernel]
    return 1 / integrate(lambda r: 2 * math.pi * r * shape(r), np.linspace(0, 1, 5), 1e-15)


@cache
def diameter_integral(kernel: str) -> float:
    """k1 = ∫ K along a diameter."""
    return peak(kernel) * integrate(lambda s: SHAPES[kernel](np.abs(s)), np.linspace(-1, 1, 9), 1e-15)


def quadratic_bspline(x: np.ndarray) -> np.ndarray:
    """The quadratic B-spline with unit knots, centred, from truncated powers; zero beyond ±3/2."""
    distance = np.minimum(np.abs(x), 1.5)
    powers = (np.clip(1.5 - distance - k, 0, None) ** 2 * (-1) ** k * math.comb(3, k) for k in range(4))
    return sum(powers) / 2


def static_kernel(kernel: str, y: np.ndarray) -> np.ndarray:
    """K at y [n, 2], shape [n]; integrates to one over filter space."""
    y = np.asarray(y, dtype=np.float64)
    if kernel == "bspline":
        return quadratic_bspline(y[:, 0]) * quadratic_bspline(y[:, 1])
    r = np.hypot(y[:, 0], y[:, 1])
    return np.where(r < 1, peak(kernel) * SHAPES[kernel](np.minimum(r, 1)), 0.0)


def swept_kernel(
    kernel: str, y: np.ndarray, v: np.ndarray, response: Callable[[np.ndarray], np.ndarray] | None = None
) -> np.ndarray:
    """K at the closest point of the path 0 → v, divided by its integral over filter space, shape [n].

    Args:
        kernel: A radial kernel.
        y: Positions relative to the footprint at shutter open, shape [n, 2].
        v: Displacement over the exposure, shape [2] or [n, 2].
        response: Time filter ω(τ) on 0 … 1 that multiplies K (Eq. 9 read as a product); None for constant.

    Raises:
        ValueError: The B-spline has no closest point.
    """
    if kernel not in SHAPES:
        raise ValueError(f"the swept footprint is defined for radial kernels, not {kernel!r}")
    y, v = np.broadcast_arrays(np.asarray(y, dtype=np.float64), np.asarray(v, dtype=np.float64))
    squared = np.sum(v**2, axis=1)
    tau = np.where(squared > 0, np.clip(np.sum(y * v, axis=1) / np.where(squared > 0, squared, 1), 0, 1), 0.0)
    sigma, k1 = np.sqrt(squared), diameter_integral(kernel)
    value = static_kernel(kernel, y - tau[:, None] * v)
    if response is None:
        return value / (1 + sigma * k1)
    # Half a disc at each end, and a band between them.
    ends = 0.5 * float(np.sum(response(np.array([0.0, 1.0]))))
    return value * response(tau) / (ends + sigma * k1 * integrate(response, np.linspace(0, 1, 33)))


def shutter_kernel(kernel: str, y: np.ndarray, v: np.ndarray, tolerance: float = 1e-12) -> np.ndarray:
    """∫₀¹ K(y − τ v) dτ by adaptive quadrature, shape [n].

    Args:
        kernel: Any kernel.
        y: Positions relative to the footprint at shutter open, shape [n, 2].
        v: Displacement over the exposure, shape [2] or [n, 2].
        tolerance: Absolute, of each interval of the quadrature.
    """
    y, v = np.broadcast_arrays(np.asarray(y, dtype=np.float64), np.asarray(v, dtype=np.float64))
    return np.array([_shutter_integral(kernel, a, b, tolerance) for a, b in zip(y, v, strict=True)])


def _shutter_integral(kernel: str, y: np.ndarray, v: np.ndarray, tolerance: float) -> float:
    sigma = float(np.hypot(*v))
    if sigma == 0:
        return float(static_kernel(kernel, y[None])[0])
    edges = _knot_times(y, v) if kernel == "bspline" else _disc_times(y, v, sigma)
    edges = np.clip(np.concatenate([[0.0], edges, [1.0]]), 0, 1)
    return integrate(lambda tau: static_kernel(kernel, y - tau[:, None] * v), edges, tolerance)


def _knot_times(y: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Times at which y − τ v crosses a knot of the B-spline: pieces between them are polynomials."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        times = (y - np.arange(-1.5, 2)[:, None]) / v
    return np.unique(times[np.isfinite(times)])


def _disc_times(y: np.ndarray, v: np.ndarray, sigma: float) -> np.ndarray:
    """Times at which y − τ v enters the unit disc, is closest to its centre and leaves, with times between them."""
    closest = float(y @ v) / sigma**2
    if np.hypot(*(y - closest * v)) >= 1:
        return np.array([closest])
    crossings = []
    for side in (-1, 1):
        inside, outside = 0.0, 1.01 / sigma
        for _ in range(60):
            middle = 0.5 * (inside + outside)
            if np.hypot(*(y - (closest + side * middle) * v)) < 1:
                inside = middle
            else:
                outside = middle
        crossings.append(closest + side * inside)
    before, after = (np.linspace(closest, crossing, 5) for crossing in crossings)
    return np.concatenate([before, after])


def footprint_weight(
    kernel: str, sweep: str, offsets: np.ndarray, dxdu: np.ndarray, dxdv: np.ndarray, dxdt: np.ndarray
) -> np.ndarray:
    """Weight of a photon per area, in the world: ∫ w dA = 1 over the tangent plane, shape [n].

    Args:
        kernel: Any kernel.
        sweep: ``static``, ``swept`` (closest point) or ``shutter`` (time average).
        offsets: Points relative to the footprint's centre at mid shutter, shape [n, 3].
        dxdu, dxdv: Footprint's full axes (smoothing included), shape [3] or [n, 3].
        dxdt: Displacement over the whole exposure; swept from −½ to +½ of it, shape [3] or [n, 3].
    """
    offsets, dxdu, dxdv, dxdt = np.broadcast_arrays(
        *(np.atleast_2d(np.asarray(a, dtype=np.float64)) for a in (offsets, dxdu, dxdv, dxdt))
    )
    cells = np.linalg.pinv(np.stack([dxdu, dxdv], axis=2))
    scale = 1.0 if kernel == "bspline" else 2.0
    y = scale * np.einsum("nij,nj->ni", cells, offsets)
    v = scale * np.einsum("nij,nj->ni", cells, dxdt)
    determinant = scale**2 / np.linalg.norm(np.cross(dxdu, dxdv), axis=1)
    if sweep == "static":
        return determinant * static_kernel(kernel, y)
    if sweep == "swept":
        return determinant * swept_kernel(kernel, y + 0.5 * v, v)
    if sweep == "shutter":
        return determinant * shutter_kernel(kernel, y + 0.5 * v, v)
    raise ValueError(f"a footprint is static, swept or shutter, not {sweep!r}")
