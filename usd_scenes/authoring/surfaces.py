"""Vertices and normals of the example surfaces, computed by Warp kernels in double precision.

Double precision, rounded once to the floats USD stores, makes the scenes the same on every machine to the last bit
or nearly so; all lengths are scene units.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

wp.config.log_level = wp.LOG_ERROR


@dataclass(frozen=True)
class PlaneWave:
    """A sinusoid ``amplitude · cos(k·(d·p − speed·t))`` with k = 2π/wavelength, running along ``direction``.

    Attributes:
        amplitude: Height of a crest over the level.
        wavelength: Distance from crest to crest.
        speed: Distance travelled in one frame.
        direction: Heading, degrees from +x towards +y.
    """

    amplitude: float
    wavelength: float
    speed: float
    direction: float = 0.0


@wp.kernel(enable_backward=False)
def water(
    level: wp.float64,
    corner: wp.vec2d,
    spacing: wp.vec2d,
    columns: int,
    amplitudes: wp.array(dtype=wp.float64),
    wave_vectors: wp.array(dtype=wp.vec2d),
    phases: wp.array(dtype=wp.float64),
    points: wp.array(dtype=wp.vec3d),
    normals: wp.array(dtype=wp.vec3d),
):
    """Sums the waves at each vertex of a grid, row by row; the normal is that of the sum itself, not of the mesh."""
    vertex = wp.tid()
    place = corner + wp.vec2d(
        spacing[0] * wp.float64(vertex % columns), spacing[1] * wp.float64(vertex // columns)
    )
    height = level
    slope = wp.vec2d(wp.float64(0.0), wp.float64(0.0))
    for wave in range(amplitudes.shape[0]):
        angle = wp.dot(wave_vectors[wave], place) - phases[wave]
        height += amplitudes[wave] * wp.cos(angle)
        slope -= amplitudes[wave] * wp.sin(angle) * wave_vectors[wave]
    points[vertex] = wp.vec3d(place[0], place[1], height)
    normals[vertex] = wp.normalize(wp.vec3d(-slope[0], -slope[1], wp.float64(1.0)))


@wp.kernel(enable_backward=False)
def tube(
    radius: wp.float64,
    height: wp.float64,
    sides: int,
    points: wp.array(dtype=wp.vec3d),
    normals: wp.array(dtype=wp.vec3d),
):
    """Two rings of vertices about the z axis, at 0 and at ``height``; normals point away from the axis."""
    vertex = wp.tid()
    angle = wp.float64(2.0) * wp.float64(wp.PI) * wp.float64(vertex % sides) / wp.float64(sides)
    outward = wp.vec3d(wp.cos(angle), wp.sin(angle), wp.float64(0.0))
    points[vertex] = radius * outward + wp.vec3d(
        wp.float64(0.0), wp.float64(0.0), height * wp.float64(vertex // sides)
    )
    normals[vertex] = outward


def water_at(
    time: float, waves: Sequence[PlaneWave], level: float, size: float, columns: int, rows: int
) -> tuple[np.ndarray, np.ndarray]:
    """Points and unit normals, shapes [rows·columns, 3] float32, of a square of water ``time`` frames after the start.

    The square has side ``size``, is centred on the z axis and faces +z.
    """
    wave_numbers = np.array([2 * np.pi / wave.wavelength for wave in waves])
    headings = np.radians([wave.direction for wave in waves])
    wave_vectors = wave_numbers[:, None] * np.stack([np.cos(headings), np.sin(headings)], axis=1)
    # Whole cycles are dropped, so that samples a period apart are equal bits, and are stored once.
    cycles = np.array([wave.speed / wave.wavelength for wave in waves]) * time
    phases = 2 * np.pi * (np.round(cycles, 12) % 1.0)
    return _computed(
        water,
        columns * rows,
        level,
        wp.vec2d(-size / 2, -size / 2),
        wp.vec2d(size / (columns - 1), size / (rows - 1)),
        columns,
        wp.array([wave.amplitude for wave in waves], dtype=wp.float64, device="cpu"),
        wp.array(wave_vectors, dtype=wp.vec2d, device="cpu"),
        wp.array(phases, dtype=wp.float64, device="cpu"),
    )


def tube_of(radius: float, height: float, sides: int) -> tuple[np.ndarray, np.ndarray]:
    """Points and outward unit normals, shapes [2·sides, 3] float32, of a tube that stands on z = 0 about the z axis."""
    return _computed(tube, 2 * sides, radius, height, sides)


def grid_quads(columns: int, rows: int) -> np.ndarray:
    """Vertex indices, shape [(rows−1)·(columns−1), 4], of a grid stored row by row; counter-clockwise seen from +z."""
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).reshape(-1, 1)
    return first + np.array([0, 1, columns + 1, columns])


def tube_quads(sides: int) -> np.ndarray:
    """Vertex indices, shape [sides, 4], of the quads of ``tube_of``; counter-clockwise seen from outside."""
    here = np.arange(sides)
    there = (here + 1) % sides
    return np.stack([here, there, there + sides, here + sides], axis=1)


def _computed(kernel: wp.Kernel, count: int, *inputs: object) -> tuple[np.ndarray, np.ndarray]:
    points = wp.empty(count, dtype=wp.vec3d, device="cpu")
    normals = wp.empty(count, dtype=wp.vec3d, device="cpu")
    wp.launch(kernel, dim=count, inputs=[*inputs, points, normals], device="cpu")
    return points.numpy().astype(np.float32), normals.numpy().astype(np.float32)
