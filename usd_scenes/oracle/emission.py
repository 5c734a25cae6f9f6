"""Emission maps (u, v, t) → rays that finite differences can be taken of."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tpdwarp.scene.description import Shutter

from .optics import unit
from .surfaces import Moving, Vector, at_time

Emission = Callable[[np.ndarray, np.ndarray, float], tuple[np.ndarray, np.ndarray]]


def parallel_beam(corner: Moving, step_u: Moving, step_v: Moving, direction: Moving) -> Emission:
    """Parallel rays from corner + u step_u + v step_v. All arguments are vectors, fixed or functions of time."""

    def emit(u: np.ndarray, v: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        origins = at_time(corner, t) + np.outer(u, at_time(step_u, t)) + np.outer(v, at_time(step_v, t))
        return origins, np.broadcast_to(unit(at_time(direction, t)), origins.shape)

    return emit


def central_beam(position: Moving, axis: Moving, step_u: Moving, step_v: Moving) -> Emission:
    """Rays from one point along axis + u step_u + v step_v, normalised. Vectors are fixed or functions of time."""

    def emit(u: np.ndarray, v: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        directions = at_time(axis, t) + np.outer(u, at_time(step_u, t)) + np.outer(v, at_time(step_v, t))
        return np.broadcast_to(at_time(position, t), directions.shape), unit(directions)

    return emit


def beam_around(
    origins: np.ndarray,
    directions: np.ndarray,
    dxdu: Vector,
    dxdv: Vector,
    domegadu: Vector,
    domegadv: Vector,
    dxdt: Vector = (0, 0, 0),
    domegadt: Vector = (0, 0, 0),
    shutter: Shutter | None = None,
) -> Emission:
    """Rays known only by their first-order columns: photon i is at u = v = 0 of its own emission.

    Give :func:`.finite_differences` zeros [n] for u and v. First derivatives need no more than these columns, so any
    light can be described so, whatever its map.

    Args:
        origins, directions: Rays at mid shutter, shape [n, 3].
        dxdu, dxdv, domegadu, domegadv: Their columns, shape [3] or [n, 3].
        dxdt, domegadt: Displacement and turn over the whole exposure, shape [3] or [n, 3].
        shutter: The exposure ``dxdt`` belongs to; None for a light at rest.
    """
    origins, directions = np.asarray(origins, dtype=np.float64), np.asarray(directions, dtype=np.float64)

    def emit(u: np.ndarray, v: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        moving = shutter is not None and shutter.exposure > 0
        tau = (t - shutter.middle) / shutter.exposure if moving else 0.0
        columns = ((u[:, None], dxdu, domegadu), (v[:, None], dxdv, domegadv), (tau, dxdt, domegadt))
        x = origins + sum(amount * np.asarray(column) for amount, column, _ in columns)
        return x, unit(directions + sum(amount * np.asarray(column) for amount, _, column in columns))

    return emit
