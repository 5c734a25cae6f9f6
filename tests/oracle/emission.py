"""Emission maps (u, v, t) → rays that finite differences can be taken of."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .optics import unit
from .surfaces import Moving, at_time

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
