"""Lights with extent as many smaller ones, or as points: stratified places of equal power.

A sphere of one radiance sends the same light, ray by ray, as a cloud of points that shine alike in all directions, of a
density 1/√(R² − r²) at the distance r from its middle: the integral of that along any chord is the same. So its places
lie in it, and not on it, and none of them is ever turned away. A cylinder (its side) is such a cloud about its axis.

Beyond the paper, whose lights are points or parallel.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tpdwarp.scene.description import Extent, ExtentShape, LightAtShutter, LightKind, SceneAtShutter

# Fractions of the whole by which consecutive places step, for one, two and three dimensions (Roberts 2018).
GOLDEN = 0.6180339887498949
PLASTIC = (0.7548776662466927, 0.5698402909980532)
# Steps of the table that inverts the distribution of radii in a sphere.
TABLE = np.linspace(0.0, 0.5 * math.pi, 4097)


def split_lights(scene: SceneAtShutter, count: int) -> SceneAtShutter:
    """``scene`` with each light that has an extent cut into about ``count`` smaller ones, which cover it together."""
    if count == 1 or all(light.extent is None for light in scene.lights):
        return scene
    lights: list[LightAtShutter] = []
    for light in scene.lights:
        lights += [light] if light.extent is None else parts_of(light, count)
    return replace(scene, lights=tuple(lights))


def place_lights(scene: SceneAtShutter, number: int, count: int) -> SceneAtShutter:
    """``scene`` with each light that has an extent at one of ``count`` places on it, as a point of all its power."""
    lights = [
        light if light.extent is None else _without_extent(light, _spread(light, number, count))
        for light in scene.lights
    ]
    return replace(scene, lights=tuple(lights))


def parts_of(light: LightAtShutter, count: int) -> list[LightAtShutter]:
    """About ``count`` lights of equal power and size that make up ``light``; their paths are its own with a number."""
    extent = light.extent
    if extent.shape in (ExtentShape.RECT, ExtentShape.CYLINDER):
        a, b = np.linalg.norm(extent.spans, axis=1)
        across = count
        if extent.shape == ExtentShape.RECT:
            across = round(max(1.0, min(math.sqrt(count * a / b), count)))
        down = max(1, round(count / across))
        steps = [(2.0 * np.arange(n) + 1.0) / n - 1.0 for n in (across, down)]
        places = np.array([(u, v, 0.0) for v in steps[1] for u in steps[0]])
        shrink = np.array([[1.0 / across], [1.0 / down]])
        smaller = Extent(extent.shape, extent.radius, shrink * extent.spans, shrink * extent.spans_motion)
    else:
        # Places have the variance that their own extent leaves of the whole: 1 − 1/N of it.
        places = np.array([_spread(light, number, count) for number in range(count)])
        places = math.sqrt(1.0 - 1.0 / count) * (places - places.mean(axis=0))
        shrink = 1.0 / math.sqrt(count)
        spans = shrink * extent.spans, shrink * extent.spans_motion
        smaller = Extent(extent.shape, math.asin(shrink * math.sin(extent.radius)), *spans)
        if light.kind != LightKind.DISTANT:
            smaller = replace(smaller, radius=shrink * extent.radius)
    found = []
    for number, place in enumerate(places):
        part = _without_extent(light, place)
        power = tuple(channel / len(places) for channel in part.power)
        found.append(replace(part, path=f"{light.path}[{number}]", power=power, extent=smaller))
    return found


def whole_of(path: str) -> str:
    """The path of the light that a part of one comes from."""
    whole, bracket, number = path.rpartition("[")
    return whole if bracket and number[:-1].isdigit() else path


def _without_extent(light: LightAtShutter, place: np.ndarray) -> LightAtShutter:
    """The light at one place: its coordinates [3] on a unit disc or ball, or from −1 to 1 along its spans."""
    extent = light.extent
    if light.kind == LightKind.DISTANT:
        sine = math.sin(extent.radius)
        tilts = [_tilted(light.axes + part * light.axes_motion, sine * place) for part in (-0.5, 0.0, 0.5)]
        # The same irradiance across the middle of the disc, whatever is tilted.
        cosine = math.sqrt(1.0 - sine**2 * (place[0] ** 2 + place[1] ** 2))
        power = tuple(channel / cosine for channel in light.power)
        return replace(light, power=power, axes=tilts[1], axes_motion=tilts[2] - tilts[0], extent=None)
    if extent.shape == ExtentShape.ROUND:
        return replace(light, position=light.position + extent.radius * place, extent=None)
    offset, motion = place[:2] @ extent.spans, place[:2] @ extent.spans_motion
    if extent.shape == ExtentShape.CYLINDER:
        offset = offset + extent.radius * (place[1:] @ light.axes[1:])
    return replace(
        light, position=light.position + offset, position_motion=light.position_motion + motion, extent=None
    )


def _tilted(axes: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Axes of parallel light from another place on its disc, whose x and y are sines to its middle."""
    x, y, z = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    back = z * math.sqrt(1.0 - place[0] ** 2 - place[1] ** 2) - place[0] * x - place[1] * y
    up = y - back * (back @ y)
    up /= np.linalg.norm(up)
    return np.stack([np.cross(up, back), up, back])


def _spread(light: LightAtShutter, number: int, count: int) -> np.ndarray:
    """Place ``number`` of ``count`` spread evenly over the power of a light, for :func:`_without_extent`."""
    shape = light.extent.shape
    middle = (number + 0.5) / count
    if shape == ExtentShape.RECT:
        return np.array([2.0 * middle - 1.0, 2.0 * (number * GOLDEN % 1.0) - 1.0, 0.0])
    turn = 2.0 * math.pi * (number * GOLDEN % 1.0)
    if shape == ExtentShape.DISK or light.kind == LightKind.DISTANT:
        return math.sqrt(middle) * np.array([math.cos(turn), math.sin(turn), 0.0])
    u, v = ((number + 0.5) * step % 1.0 for step in PLASTIC)
    if shape == ExtentShape.CYLINDER:
        radius, turn = math.sqrt(1.0 - (1.0 - u) ** 2), 2.0 * math.pi * v
        return np.array([2.0 * middle - 1.0, radius * math.cos(turn), radius * math.sin(turn)])
    # F(sin θ) = (2/π)(θ − sin θ cos θ) is the part of the cloud within the radius sin θ.
    radius = math.sin(np.interp(middle, (2.0 / math.pi) * (TABLE - np.sin(TABLE) * np.cos(TABLE)), TABLE))
    height, turn = 2.0 * u - 1.0, 2.0 * math.pi * v
    level = math.sqrt(1.0 - height**2)
    return radius * np.array([level * math.cos(turn), level * math.sin(turn), height])
