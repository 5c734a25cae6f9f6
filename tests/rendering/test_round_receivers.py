"""Light that comes through flat water onto round things is that of the closed form: none is missing, at rest or not."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

import tpdwarp
from usd_scenes import shapes, solids
from usd_scenes.stage import CAMERA, FRAME, write_stage

RADIUS, HALF_LENGTH, HEIGHT = 0.45, 0.6, 0.6
PIXELS, SIZE, PER_PIXEL, TIMES = solids.PIXELS, 1.6, 6, 24
# Of the thing as it is seen: its outline is of facets.
INNER = 0.97


def light_in_water(degrees: float) -> tuple[float, np.ndarray]:
    """Irradiance across a ray of the sun of 1 W/m² in water, by Fresnel and Snell, and its direction."""
    outside = np.cos(np.radians(degrees))
    sine = np.sin(np.radians(degrees)) / solids.WATER
    cosine = np.sqrt(1.0 - sine * sine)
    across = (outside - solids.WATER * cosine) / (outside + solids.WATER * cosine)
    within = (solids.WATER * outside - cosine) / (solids.WATER * outside + cosine)
    passed = 1.0 - 0.5 * (across * across + within * within)
    return passed * outside / cosine, np.array([sine, 0.0, -cosine])


def ball(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Normals of the ball as seen from above, [..., 3]; not finite beside it."""
    with np.errstate(invalid="ignore"):
        return np.stack([x, y, np.sqrt(RADIUS**2 - x**2 - y**2)], axis=-1) / RADIUS


def bowl(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return ball(x, y) * [-1.0, -1.0, 1.0]


def cylinder(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.where(np.abs(y)[..., None] < HALF_LENGTH, ball(x, np.zeros_like(y)), np.nan)


def edge(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Of a box that shows an edge: two slopes of 45 degrees."""
    inside = (np.abs(x) < RADIUS) & (np.abs(y) < HALF_LENGTH)
    return np.where(inside[..., None], np.stack([np.sign(x), 0.0 * x, np.ones_like(x)], axis=-1) / np.sqrt(2.0), np.nan)


def mesh_of(normals: Callable, shift: float):
    """The thing as a mesh that glides by ``shift`` along x."""
    points, triangles, smooth = shapes.sphere()
    if normals is bowl:
        triangles = triangles[(points[triangles][:, :, 2] <= 1e-9).all(axis=1)][:, ::-1]
        points, smooth = shapes.moved(points, (0.0, 0.0, 0.7)), -smooth
    points = RADIUS * points
    if normals is cylinder:
        around = np.arange(96)
        smooth = np.stack([np.cos(around * np.pi / 48), 0.0 * around, np.sin(around * np.pi / 48)], axis=1)
        points = np.concatenate([RADIUS * smooth - [0, HALF_LENGTH, 0], RADIUS * smooth + [0, HALF_LENGTH, 0]])
        after = (around + 1) % 96
        triangles = np.concatenate(
            [np.stack([around, after + 96, around + 96], axis=1), np.stack([around, after, after + 96], axis=1)]
        )
        smooth = np.concatenate([smooth, smooth])
    if normals is edge:
        side = np.sqrt(2.0) * RADIUS
        points, triangles = shapes.box((side, 2.0 * HALF_LENGTH, side))
        points, smooth = points @ shapes.rotation((0.0, 1.0, 0.0), 45.0).T, None
    ends = tuple(shapes.moved(points, (part * shift, 0.0, HEIGHT)) for part in (-0.5, 0.5))
    return solids._mesh("Thing", ends, triangles, solids.DIFFUSE, normals=None if smooth is None else (smooth,) * 2)


def closed_form(normals: Callable, degrees: float, shift: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean irradiance of each pixel, and which pixels see the thing all the while."""
    flux, direction = light_in_water(degrees)
    at = ((np.arange(PIXELS * PER_PIXEL) + 0.5) / PER_PIXEL - 0.5 * PIXELS) * SIZE / PIXELS
    x, y = np.meshgrid(at, -at)
    shifts = shift * ((np.arange(TIMES) + 0.5) / TIMES - 0.5)
    light = np.mean([np.maximum(-normals(x - s, y) @ direction, 0.0) for s in shifts], axis=0)
    seen = np.all([np.isfinite(normals((x - s) / INNER, y / INNER)[..., 2]) for s in shifts], axis=0)
    shape = (PIXELS, PER_PIXEL, PIXELS, PER_PIXEL)
    return flux * light.reshape(shape).mean(axis=(1, 3)), seen.reshape(shape).all(axis=(1, 3))


@pytest.mark.parametrize(
    ("normals", "degrees", "shift", "photons"),
    [
        (ball, 25.0, 0.0, 1 << 16),
        (ball, 0.0, 0.2, 1 << 14),
        (bowl, 0.0, 0.1, 1 << 14),
        (cylinder, 25.0, 0.1, 1 << 14),
        (edge, 10.0, 0.0, 1 << 16),
    ],
)
def test_round_things_have_the_light_that_falls_on_them(normals, degrees, shift, photons, tmp_path: Path):
    meshes = [solids._floor(), solids._water((), level=1.6, run=0.0), mesh_of(normals, shift)]
    scene = solids._scene("round", meshes, [solids._sun(degrees)], (0.0, 0.0, 1.3), SIZE, view_is_clear=False)
    stage, picture = write_stage(scene, tmp_path / "round.usdc"), tmp_path / "round.exr"
    options = {"frames": FRAME, "camera": CAMERA, "image_width": PIXELS, "exposure": 1.0, "samples": 4, "segments": 1}
    tpdwarp.render(stage, picture, photons=photons, aovs=("irradiance",), **options)
    image = oiio.ImageBuf(str(picture))
    found = image.get_pixels(oiio.FLOAT)[:, :, image.spec().channelindex("irradiance.R")]
    truth, seen = closed_form(normals, degrees, shift)
    assert seen.sum() > 1000
    assert found[seen].mean() == pytest.approx(truth[seen].mean(), rel=0.003)
    assert np.sqrt(np.mean((found - truth)[seen] ** 2)) < 0.03 * truth[seen].mean()
