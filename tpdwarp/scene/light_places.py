"""Lights with extent as many smaller ones, or as points: stratified places of equal power.

A sphere of one radiance sends the same light, ray by ray, as a cloud of points that shine alike in all directions, of a
density 1/√(R² − r²) at the distance r from its middle: the integral of that along any chord is the same. So its places
lie in it, and not on it, and none of them is ever turned away. A cylinder (its side) is such a cloud about its axis.
Its parts are those of the disc as which it is seen from what is specular.

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
# Footprints from N parts of a light, whose lattices interleave, are N to this power as wide as their cells. Chosen, not
# derived: sums of them then ripple by less than two hundredths (tests/footprints/test_light_images.py).
NARROWING_POWER = -1.0 / 8.0
# Steps of the table that inverts the distribution of radii in a sphere.
TABLE = np.linspace(0.0, 0.5 * math.pi, 4097)


def split_lights(scene: SceneAtShutter, count: int) -> SceneAtShutter:
    """``scene`` with each light that has an extent cut into about ``count`` smaller ones, which cover it together."""
    if count == 1 or all(light.extent is None for light in scene.lights):
        return scene
    middle = _middle_of_glass(scene)
    lights: list[LightAtShutter] = []
    for light in scene.lights:
        lights += [light] if light.extent is None else parts_of(light, count, middle)
    return replace(scene, lights=tuple(lights))


def place_lights(scene: SceneAtShutter, number: int, count: int) -> SceneAtShutter:
    """``scene`` with each light that has an extent at one of ``count`` places on it, as a point of all its power."""
    lights = [
        light if light.extent is None else _without_extent(light, _spread(light, number, count))
        for light in scene.lights
    ]
    return replace(scene, lights=tuple(lights))


def parts_of(light: LightAtShutter, count: int, seen_from: np.ndarray | None = None) -> list[LightAtShutter]:
    """About ``count`` lights of equal power that make up ``light``; their paths are its own with a number.

    Rectangles are cut into rectangles, cylinders along their axis, and what is round into a disc in its middle and
    rings of pieces around it, nearly rectangles of its area. A sphere is the disc that is seen from ``seen_from``.
    """
    extent = light.extent
    if extent.shape in (ExtentShape.RECT, ExtentShape.CYLINDER):
        a, b = np.linalg.norm(extent.spans, axis=1)
        across = count
        if extent.shape == ExtentShape.RECT:
            across = round(max(1.0, min(math.sqrt(count * a / b), count)))
        down = max(1, round(count / across))
        steps = [(2.0 * np.arange(n) + 1.0) / n - 1.0 for n in (across, down)]
        size = np.array([[1.0 / across, 0.0], [0.0, 1.0 / down]])
        pieces = [(np.array([u, v]), size) for v in steps[1] for u in steps[0]]
        shapes = [extent.shape] * len(pieces)
    else:
        pieces = pieces_of_disc(count)
        shapes = [ExtentShape.DISK] + [ExtentShape.RECT] * (len(pieces) - 1)
    spans, motions = _spans_across(light, seen_from)
    found = []
    for number, ((place, sides), shape) in enumerate(zip(pieces, shapes, strict=True)):
        part = _at(light, place, spans, motions)
        power = tuple(channel / len(pieces) for channel in part.power)
        smaller = Extent(shape, extent.radius, sides @ spans, sides @ motions)
        found.append(replace(part, path=f"{light.path}[{number}]", power=power, extent=smaller))
    return found


def tiles_of(light: LightAtShutter, colors: np.ndarray) -> list[LightAtShutter]:
    """The lights that a rectangle with a picture is: one a pixel that is not black, their paths its own with a number.

    Args:
        light: The rectangle.
        colors: What its radiance is multiplied by, shape [h, w, 3]: from +y down, from +x on, so that it stands upright
            before who looks along +z.
    """
    extent, (rows, columns) = light.extent, colors.shape[:2]
    size = np.diag([1.0 / columns, 1.0 / rows])
    found = []
    for number, color in enumerate(colors.reshape(-1, 3)):
        row, column = divmod(number, columns)
        place = 1.0 - (2.0 * np.array([column, row]) + 1.0) / (columns, rows)
        part = _at(light, place, extent.spans, extent.spans_motion)
        power = tuple(float(channel * c) / (rows * columns) for channel, c in zip(part.power, color, strict=True))
        smaller = Extent(extent.shape, 0.0, size @ extent.spans, size @ extent.spans_motion)
        found.append(replace(part, path=f"{light.path}[{number}]", power=power, extent=smaller))
    return [tile for tile in found if any(tile.power)]


def pieces_of_disc(count: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """The middle [2] and half sides (rows of [2, 2]) of pieces of equal area that a unit disc is cut into.

    The first is a disc; ring k around it has 6 k pieces, along and across its radius. There are 1, 7, 19, … of them,
    whichever is nearest to ``count``.
    """
    rings = max(range(32), key=lambda k: (-abs(1 + 3 * k * (k + 1) - count), k))
    total = 1 + 3 * rings * (rings + 1)
    inner = 1.0 / math.sqrt(total)
    pieces = [(np.zeros(2), inner * np.eye(2))]
    for ring in range(1, rings + 1):
        outer = math.sqrt((1 + 3 * ring * (ring + 1)) / total)
        half = math.pi / (6 * ring)
        # Its centre of mass, and a rectangle of its area.
        radius = 2.0 / 3.0 * (outer**3 - inner**3) / (outer**2 - inner**2) * math.sin(half) / half
        depth = 0.5 * (outer - inner)
        width = half * (outer**2 - inner**2) / (4.0 * depth)
        for number in range(6 * ring):
            turn = 2.0 * half * number
            along = np.array([math.cos(turn), math.sin(turn)])
            pieces.append((radius * along, np.array([depth * along, width * along[::-1] * (-1.0, 1.0)])))
        inner = outer
    return pieces


def _middle_of_glass(scene: SceneAtShutter) -> np.ndarray | None:
    """The middle of what is specular; None where nothing is."""
    corners = [bound for mesh in scene.meshes if mesh.specular for bound in (mesh.points.min(0), mesh.points.max(0))]
    return 0.5 * (np.min(corners, axis=0) + np.max(corners, axis=0)) if corners else None


def _spans_across(light: LightAtShutter, seen_from: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Half of a light along two axes [2, 3] and their motion; of a sun, sines along its x and y."""
    extent = light.extent
    if light.kind == LightKind.DISTANT:
        sine = math.sin(extent.radius)
        return sine * light.axes[:2], sine * light.axes_motion[:2]
    if extent.shape != ExtentShape.ROUND:
        return extent.spans, extent.spans_motion
    direction = light.axes[2] if seen_from is None else seen_from - light.position
    w = direction / max(float(np.linalg.norm(direction)), np.finfo(float).tiny)
    u = np.cross(np.eye(3)[int(np.argmin(np.abs(w)))], w)
    u /= np.linalg.norm(u)
    return extent.radius * np.array([u, np.cross(w, u)]), np.zeros((2, 3))


def _at(light: LightAtShutter, place: np.ndarray, spans: np.ndarray, motions: np.ndarray) -> LightAtShutter:
    """The light at one place of it, by coordinates [2] along its spans."""
    if light.kind == LightKind.DISTANT:
        return _without_extent(light, np.append(place, 0.0))
    return replace(
        light,
        position=light.position + place @ spans,
        position_motion=light.position_motion + place @ motions,
        extent=None,
    )


def whole_of(path: str) -> str:
    """The path of the light that a part of one comes from."""
    return _path_and_number(path)[0]


def prim_of(path: str) -> str:
    """The path of the prim that a light, or a part or tile of one, comes from."""
    while (whole := whole_of(path)) != path:
        path = whole
    return path


def phase_of(path: str) -> np.ndarray:
    """How far, in cells, the lattice of a part of a light is moved along u and v, shape [2]; none of a whole light.

    Lattices of parts side by side then interleave: light of all parts falls between the cells of one, and what one
    counts too much where glass ends others count too little.
    """
    return _path_and_number(path)[1] * np.array(PLASTIC) % 1.0


def narrowing_of(parts: int) -> float:
    """How many cells wide footprints are where ``parts`` of a light send photons from lattices that interleave."""
    return float(parts) ** NARROWING_POWER


def _path_and_number(path: str) -> tuple[str, int]:
    whole, bracket, number = path.rpartition("[")
    return (whole, int(number[:-1])) if bracket and number[:-1].isdigit() else (path, 0)


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
