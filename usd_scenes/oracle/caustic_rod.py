"""The caustic of a lying glass rod that turns about the vertical, averaged over pixels and time.

Light falls straight down on a rod of radius ``RADIUS`` and length ``LENGTH`` whose axis lies ``HEIGHT`` above a white
floor, and which turns by ``DEGREES`` a frame. The floor is seen by ``PIXELS``² pixels over ±``HALF``.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from .surfaces import Ellipsoid, Plane
from .tracer import trace

HALF, PIXELS = 1.2, 128
HEIGHT, RADIUS, LENGTH = 0.4, 0.15, 2.0
DEGREES = 5.0


@cache
def profile(cells: int = 4096, rays: int = 40_001) -> np.ndarray:
    """Mean irradiance on the floor in narrow strips across a lying glass rod under vertical light, over ±HALF·√2.

    In the plane across its axis a rod bends light as a sphere does. Every path of up to six meetings is followed by
    the float64 tracer; the light between two neighbouring rays of a path lands between their images.
    """
    scene = [Ellipsoid("/rod", (0, 0, HEIGHT), (RADIUS,) * 3, ior=1.5), Plane("/floor", (0, 0, 0), (0, 0, 1))]
    reach = HALF * math.sqrt(2)
    edges = np.linspace(-reach, reach, cells + 1)
    x0 = np.linspace(-RADIUS, RADIUS, rays)[1:-1]
    origins = np.stack([x0, 0 * x0, 0 * x0 + 2], axis=1)
    landed = np.zeros(cells)
    paths = [("reflect",), *(("refract", *["reflect"] * k, "refract") for k in range(5))]
    for choices in paths:
        path = trace(scene, origins, np.broadcast_to([0.0, 0, -1], origins.shape), 0.0, choices)
        x, share = path.positions[:, 0], path.throughput
        # A reflected ray that meets the rod again, or leaves upwards, is not one of these paths.
        good = path.landed & (path.bounces == len(choices))
        pair = good[1:] & good[:-1]
        low, high = np.minimum(x[1:], x[:-1])[pair], np.maximum(x[1:], x[:-1])[pair]
        flux = (0.5 * (share[1:] + share[:-1]) * np.diff(x0))[pair]
        landed += _spread_over(edges, low, np.maximum(high, low + 1e-9), flux)
    return landed / np.diff(edges)


def _spread_over(edges: np.ndarray, low: np.ndarray, high: np.ndarray, flux: np.ndarray) -> np.ndarray:
    """Flux in each cell where each interval's is spread evenly between ``low`` and ``high``, shape [cells]."""
    step = edges[1] - edges[0]
    inside = (high > edges[0]) & (low < edges[-1])
    low, high, flux = low[inside], high[inside], flux[inside]
    density = flux / (high - low)
    cells = np.zeros(len(edges) - 1)
    first = np.floor((low - edges[0]) / step).astype(int)
    last = np.floor((high - edges[0]) / step).astype(int)
    for k in range(int((last - first).max(initial=-1)) + 1):
        cell = first + k
        rows = (cell <= last) & (cell >= 0) & (cell < len(cells))
        start = np.maximum(low[rows], edges[cell[rows]])
        end = np.minimum(high[rows], edges[cell[rows] + 1])
        np.add.at(cells, cell[rows], density[rows] * np.maximum(end - start, 0))
    return cells


def irradiance_of_rod(times: int, parts: int) -> np.ndarray:
    """Irradiance over the shutter [0, 1], pixels cut into ``parts``², ``times`` instants: the profile turned about."""
    reach = HALF * math.sqrt(2)
    edges = np.linspace(-reach, reach, len(profile()) + 1)
    cumulative = np.concatenate([[0], np.cumsum(profile())]) * (edges[1] - edges[0])
    part = 2 * HALF / (PIXELS * parts)
    at = -HALF + (np.arange(PIXELS * parts) + 0.5) * part
    x, y = np.meshgrid(at, -at)
    total = np.zeros((PIXELS, PIXELS))
    for k in range(times):
        angle = math.radians(DEGREES) * (k + 0.5) / times
        along, across = math.cos(angle) * x + math.sin(angle) * y, math.cos(angle) * y - math.sin(angle) * x
        # Each part is averaged as if it lay along the rod, from which it turns by five degrees at most.
        low, high = (np.interp(across + side * 0.5 * part, edges, cumulative) for side in (-1, 1))
        covered = np.clip((0.5 * LENGTH - np.abs(along)) / part + 0.5, 0, 1)
        total += (covered * (high - low) / part).reshape(PIXELS, parts, PIXELS, parts).mean(axis=(1, 3))
    return total / times
