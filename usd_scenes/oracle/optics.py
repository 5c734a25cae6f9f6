"""Reflection, refraction and Fresnel of unit vectors, float64."""

from __future__ import annotations

import numpy as np


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Row-wise scalar product of [n, 3] arrays, shape [n]."""
    return np.einsum("...i,...i->...", a, b)


def unit(a: np.ndarray) -> np.ndarray:
    """Rows of an [n, 3] array scaled to length one."""
    return a / np.linalg.norm(a, axis=-1, keepdims=True)


def facing(normals: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Normals [n, 3] turned against the rays [n, 3]."""
    return np.where(dot(normals, directions)[:, None] > 0, -normals, normals)


def reflected(directions: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Mirror directions, shape [n, 3]."""
    return directions - 2 * dot(directions, normals)[:, None] * normals


def refracted(directions: np.ndarray, normals: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Refracted unit directions, shape [n, 3], NaN where light is totally reflected.

    Built from the tangential part, which Snell's law scales by ``eta``; the rest of the unit length goes along −n.

    Args:
        directions: Unit directions of travel, shape [n, 3].
        normals: Unit normals against the rays, shape [n, 3].
        eta: Index before over index behind, shape [n].
    """
    tangential = eta[:, None] * (directions - dot(directions, normals)[:, None] * normals)
    rest = 1 - dot(tangential, tangential)
    with np.errstate(invalid="ignore"):
        return tangential - np.where(rest >= 0, np.sqrt(np.abs(rest)), np.nan)[:, None] * normals


def reflectance(cos_i: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Fresnel reflectance of unpolarised light, shape [n]; 1 where light is totally reflected.

    Args:
        cos_i: Cosine of incidence, shape [n].
        eta: Index before over index behind, shape [n].
    """
    sin2_t = eta**2 * (1 - cos_i**2)
    cos_t = np.sqrt(np.clip(1 - sin2_t, 0, None))
    perpendicular = (eta * cos_i - cos_t) / (eta * cos_i + cos_t)
    parallel = (eta * cos_t - cos_i) / (eta * cos_t + cos_i)
    return np.where(sin2_t >= 1, 1.0, 0.5 * (perpendicular**2 + parallel**2))
