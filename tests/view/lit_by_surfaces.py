"""Lights with extent, and what they do at a point by quadrature over their surface."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from tests.view.scenes import turned
from tpdwarp.scene.description import EmissionProfile, Extent, ExtentShape, LightAtShutter, LightKind
from tpdwarp.scene.stretched_lights import ellipsoid_of

UP = np.array([0.0, 0.0, 1.0])


def lamp(shape: ExtentShape, position, rotation=(0.0, 0.0, 1e-12), sizes=(0.4, 0.4), radius=0.0) -> LightAtShutter:
    """A lamp of intensity one that shines down if it is not turned."""
    axes = turned(rotation)
    spans = np.array([sizes[0] * axes[0], sizes[1] * axes[1]])
    profile = EmissionProfile.UNIFORM if shape == ExtentShape.ROUND else EmissionProfile.COSINE
    if shape == ExtentShape.CYLINDER:
        spans, profile = np.array([sizes[0] * axes[0], np.zeros(3)]), EmissionProfile.SINE
    return LightAtShutter(
        "/lamp", LightKind.POINT, (1.0, 2.0, 4.0), np.array(position, float), axes, profile=profile,
        extent=Extent(shape, radius, spans),
    )  # fmt: skip


def sun(degrees: float, tilt: float) -> LightAtShutter:
    extent = Extent(ExtentShape.ROUND, math.radians(0.5 * degrees))
    return LightAtShutter("/sun", LightKind.DISTANT, (1.0, 2.0, 4.0), axes=turned((0, tilt, 1e-12)), extent=extent)


def ellipsoid(position, rotation, radii) -> LightAtShutter:
    """A lamp of intensity one on average."""
    sphere = lamp(ExtentShape.ROUND, position, radius=1.0)
    return ellipsoid_of(sphere, 1.0, np.array(radii)[:, None] * turned(rotation), np.zeros((3, 3)))


LIGHTS = {
    "sphere overhead": lamp(ExtentShape.ROUND, (0.2, 0.1, 1.0), radius=0.5),
    "sphere far off": lamp(ExtentShape.ROUND, (3.0, 1.0, 20.0), radius=0.3),
    "sphere that dips below the horizon": lamp(ExtentShape.ROUND, (-1.5, 0.2, 0.2), radius=0.4),
    "small sphere that dips below the horizon": lamp(ExtentShape.ROUND, (-4.0, 0.2, 0.02), radius=0.1),
    "sphere below the horizon by its middle": lamp(ExtentShape.ROUND, (-1.5, 0.2, -0.1), radius=0.4),
    "disk overhead": lamp(ExtentShape.DISK, (0.2, 0.1, 0.5)),
    "disk far off": lamp(ExtentShape.DISK, (0.2, 0.1, 40.0)),
    "tilted disk": lamp(ExtentShape.DISK, (-0.8, 0.1, 0.7), (0.3, -0.8, 0.2)),
    "disk cut by the horizon": lamp(ExtentShape.DISK, (-1.3, 0.1, 0.2), (0.2, -1.4, 0.1)),
    "elliptical disk": lamp(ExtentShape.DISK, (0.1, 0.2, 0.6), (0.4, 0.1, 0.0), (0.5, 0.2)),
    "rectangle overhead": lamp(ExtentShape.RECT, (0.2, 0.1, 0.5), sizes=(0.6, 0.3)),
    "tilted rectangle": lamp(ExtentShape.RECT, (-0.8, 0.1, 0.7), (0.3, -0.8, 0.2), (0.6, 0.3)),
    "rectangle cut by the horizon": lamp(ExtentShape.RECT, (-1.3, 0.1, 0.2), (0.2, -1.4, 0.1), (0.6, 0.3)),
    "rectangle far off": lamp(ExtentShape.RECT, (0.2, 0.1, 40.0), sizes=(0.6, 0.3)),
    "tube": lamp(ExtentShape.CYLINDER, (0.2, 0.1, 1.2), (0.1, 0.3, 0.4), (0.6, 0.0), 0.05),
    "ellipsoid overhead": ellipsoid((0.2, 0.1, 1.0), (0.3, -0.8, 0.2), (0.6, 0.3, 0.4)),
    "ellipsoid far off": ellipsoid((0.2, 0.1, 20.0), (0.3, -0.8, 0.2), (0.6, 0.3, 0.4)),
    "flat ellipsoid aside": ellipsoid((-1.6, 0.1, 1.1), (0.3, -0.8, 0.2), (0.6, 0.5, 0.01)),
    "ellipsoid cut by the horizon": ellipsoid((-1.5, 0.2, 0.1), (0.3, -0.8, 0.2), (0.4, 0.3, 0.2)),
    "sun": sun(0.53, 0.4),
    "wide sun": sun(30.0, 0.4),
    "sun at the horizon": sun(5.0, math.pi / 2 - 0.02),
}


def grid(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Middles of the cells of the unit square, each shape [count²]."""
    middles = (np.arange(count) + 0.5) / count
    return tuple(values.ravel() for values in np.meshgrid(middles, middles))


def above_floor(w: np.ndarray) -> np.ndarray:
    """Cosines of directions [n, 3] to a floor's normal; 0 of what lies below it."""
    return np.maximum(w @ UP, 0)


def expected(
    light: LightAtShutter,
    points: np.ndarray,
    count: int = 400,
    received: Callable[[np.ndarray], np.ndarray] = above_floor,
) -> np.ndarray:
    """What a light of one radiance does at points of a floor, shape [n], by the midpoint rule over its surface.

    Args:
        light: The light.
        points: Shape [n, 3].
        count: Points along either side of its surface.
        received: What becomes of irradiance at normal incidence from unit directions [m, 3]: its cosine for irradiance.
    """
    u, v = grid(count)
    extent, found = light.extent, []
    turn = 2 * math.pi * v
    disc = np.stack([np.sqrt(u) * np.cos(turn), np.sqrt(u) * np.sin(turn)], axis=1)
    for x in points:
        if extent.shape == ExtentShape.ROUND:
            d = light.axes[2] if light.kind == LightKind.DISTANT else light.position - x
            sine = math.sin(extent.radius) if light.kind == LightKind.DISTANT else extent.radius / np.linalg.norm(d)
            middle = d / np.linalg.norm(d)
            frame = np.linalg.svd(middle[None])[2][1:]
            forward = np.sqrt(1 - sine**2 * u)
            w = forward[:, None] * middle + sine * disc @ frame
            # Equal areas of the disc of sines are solid angles times the cosine to the middle.
            mean = np.mean(received(w) / forward)
            found.append(mean if light.kind == LightKind.DISTANT else mean / (d @ d))
            continue
        if extent.shape == ExtentShape.CYLINDER:
            # Its side, turned to x and away from it; a surface of radiance L and area A has L A/π for its intensity.
            axes = light.axes
            normal = np.cos(turn)[:, None] * axes[1] + np.sin(turn)[:, None] * axes[2]
            d = light.position + (2 * u - 1)[:, None] * extent.spans[0] + extent.radius * normal - x
            scale = math.pi
        elif extent.shape == ExtentShape.ELLIPSOID:
            # Vectors of the area of what a sphere's equal parts are.
            level = 2 * np.sqrt(u - u**2)
            outward = np.stack([level * np.cos(turn), level * np.sin(turn), 1 - 2 * u], axis=1)
            d = light.position + outward @ extent.spans - x
            normal = outward @ np.linalg.inv(extent.spans).T * abs(np.linalg.det(extent.spans))
            scale = 4.0 / extent.radius**2
        else:
            place = disc if extent.shape == ExtentShape.DISK else np.stack([2 * u - 1, 2 * v - 1], axis=1)
            d, normal, scale = light.position + place @ extent.spans - x, -light.axes[2], 1.0
        d2 = np.einsum("ni,ni->n", d, d)
        w = d / np.sqrt(d2)[:, None]
        emitted = np.maximum(-(w * normal).sum(axis=1), 0)
        found.append(scale * np.mean(received(w) * emitted / d2))
    return np.array(found)
