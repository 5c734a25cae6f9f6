"""What is traced, as arrays at the opening and at the closing of the shutter; everything moves linearly between.

That is what USD means by time samples: attributes are interpolated linearly. Lengths are scene units.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

DIFFUSE, DIELECTRIC, MIRROR = 0, 1, 2


def between(values: tuple[np.ndarray, np.ndarray], s: float) -> np.ndarray:
    """(1 − s) · values at the opening + s · values at the closing, in float64."""
    start, end = (np.asarray(value, dtype=np.float64) for value in values)
    return start + s * (end - start)


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles whose vertices move.

    Attributes:
        name: Prim path.
        points: Vertex positions at the opening and at the closing of the shutter, each [v, 3].
        triangles: Vertex indices, counter-clockwise seen from the front, shape [m, 3].
        interaction: ``DIFFUSE``, ``DIELECTRIC`` or ``MIRROR``.
        ior: Index of refraction behind the front side, relative to before it.
        tint: Share of the light that a mirror reflects.
        normals: Vertex normals at the opening and at the closing, each [v, 3]; None for flat shading. They are
            interpolated over time, scaled to unit length, interpolated over the triangle, and scaled again.
    """

    name: str
    points: tuple[np.ndarray, np.ndarray]
    triangles: np.ndarray
    interaction: int = DIFFUSE
    ior: float = 1.5
    tint: float = 1.0
    normals: tuple[np.ndarray, np.ndarray] | None = None


@dataclass(frozen=True, eq=False)
class Light:
    """A distant light, a point, or a light with extent and one radiance: a sun, sphere, rectangle, disc or cylinder.

    Attributes:
        name: Prim path.
        power: Distant: irradiance across its direction [W/m²]. Others: radiant intensity [W/sr], of what is flat along
            its normal, of a cylinder across its axis.
        direction: Unit direction of travel, shape [3], of a distant light; None for a point light.
        position: Position at the opening and at the closing of the shutter, each [3], of a point light.
        aim: Names of the specular meshes it is aimed at; None for all. Meshes left out must get no light from it.
        share: Of the photons.
        angle: Across the disc of a distant light, in radians.
        radius: Of a sphere about ``position``, or of a cylinder, which shines with its side alone.
        spans: Half of the sides a and b of a rectangle about ``position``, or of an ellipse, rows [2, 3]; it shines
            along b × a. Of a cylinder, half of its axis and anything.
        rounded: Whether what is flat is an ellipse.
    """

    name: str
    power: float
    direction: np.ndarray | None = None
    position: tuple[np.ndarray, np.ndarray] | None = None
    aim: tuple[str, ...] | None = None
    share: float = 1.0
    angle: float = 0.0
    radius: float = 0.0
    spans: np.ndarray | None = None
    rounded: bool = False

    @property
    def extended(self) -> bool:
        """Whether it is no point and not parallel."""
        return self.angle > 0.0 or self.radius > 0.0 or self.spans is not None


@dataclass(frozen=True, eq=False)
class Camera:
    """An orthographic camera with square pixels; it looks along −z of its axes, and translates only.

    Attributes:
        position: Eye at the opening and at the closing of the shutter, each [3].
        axes: Rows are the unit x (right), y (up), z (backward) axes, shape [3, 3].
        size: Width of the picture, scene units.
        width, height: Pixels.
    """

    position: tuple[np.ndarray, np.ndarray]
    axes: np.ndarray
    size: float
    width: int
    height: int

    @property
    def pixel(self) -> float:
        """Side of a pixel, scene units."""
        return self.size / self.width


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything over one shutter.

    Attributes:
        name: Of the scene.
        meshes, lights: What there is.
        camera: Sees receivers directly, not through glass.
        view_is_clear: Whether nothing stands between the camera and any receiver, so that no ray is spent on it.
    """

    name: str
    meshes: tuple[Mesh, ...]
    lights: tuple[Light, ...]
    camera: Camera
    view_is_clear: bool = True
