"""Lights with extent as many smaller ones, or as points: stratified places of equal power.

A sphere of one radiance sends the same light, ray by ray, as a cloud of points that shine alike in all directions, of a
density 1/√(R² − r²) at the distance r from its middle: the integral of that along any chord is the same. So its places
lie in it, and not on it, and none of them is ever turned away. Its parts are pieces of the disc as which it is seen
from what is specular, each at a depth of its own along that view, as places of the cloud are: so they have their width
from the side, too. Those of an ellipsoid are carried along from the sphere that it is made of, and shine by the area
that it shows: the cloud thins out by the same factor all over, and what is left of chords differs by direction alone. A
cylinder (its side) is such a cloud about its axis, but for its ends: so its places lie on its
surface, and so do its parts, flat ones, unless it is thin.

Beyond the paper, whose lights are points or parallel.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np

from tpdwarp.scene.crossings import is_crossed, specular_triangles
from tpdwarp.scene.description import (
    Ball,
    EmissionProfile,
    Extent,
    ExtentShape,
    LightAtShutter,
    LightKind,
    MeshAtShutter,
    SceneAtShutter,
)
from tpdwarp.scene.light_cuts import Grid, LightCuts, grid_of

# Fractions of the whole by which consecutive places step, for one, two and three dimensions (Roberts 2018).
GOLDEN = 0.6180339887498949
PLASTIC = (0.7548776662466927, 0.5698402909980532)
# Footprints from N parts of a light, whose lattices interleave, are N to this power as wide as their cells. Chosen, not
# derived: sums of them then ripple by less than two hundredths (tests/footprints/test_light_images.py).
NARROWING_POWER = -1.0 / 8.0
# Axes of the parts of a sphere that is seen along the last of them, from below and aside whether y is up or z: parts
# jump within a shutter in which it passes the opposite direction, so that is none in which a lamp stands.
FROM_ABOVE = np.array([[1.0, 0.0, 0.0], [0.0, -0.8, 0.6], [0.0, -0.6, -0.8]])
# A sphere of N pieces is a cloud where it is seen from angles apart by more than 1.5 times this over √N, and a disc
# where by less than half of it. Chosen, not derived: under a lamp a tenth as wide as it is far (10°) a ball errs by
# .008 from discs of 61 pieces, by .025 from clouds; under one close above it (37°) by .12 and .06 with 169 pieces, by
# .11 and .19 with 19.
DEPTH_SEEN = 4.0
# Parts of a light that a surface passes through are points where it passes within so many times half of their size.
# Chosen, not derived: of a rectangle and a tube half in water all parts as points err by .080 and .184 (the truths by
# .06 and .13), those so near by .087 and .174, those that are cut themselves by .094 and .234, none by .113 and .247.
TOUCHED = 4.0
# Of a box, by its lower and upper corner.
CORNERS = list(itertools.product((0, 1), repeat=3))
# Shapes whose places lie within them.
WITH_DEPTH = (ExtentShape.ROUND, ExtentShape.ELLIPSOID)
# Steps of the table that inverts the distribution of radii in a sphere.
TABLE = np.linspace(0.0, 0.5 * math.pi, 4097)


def split_lights(scene: SceneAtShutter, cuts: LightCuts) -> SceneAtShutter:
    """``scene`` with each light that has an extent cut into smaller ones, which cover it together."""
    if cuts.count == 1 or all(light.extent is None for light in scene.lights):
        return scene
    middles = _middles_of_glass(scene)
    corners = _corners_of_glass(scene) if any(map(_has_depth, scene.lights)) else []
    lights: list[LightAtShutter] = []
    for light in scene.lights:
        parts = [light]
        if light.extent is not None:
            spread = _spread_of_glass(light, middles, corners) if _has_depth(light) else math.pi
            parts = parts_of(light, cuts.count, middles, spread, cuts.grids.get(light.path))
            if light.extent.shape == ExtentShape.CYLINDER:
                parts = [part for part in parts if not _is_turned_away(part, scene)]
            parts = _points_where_touched(light, parts, scene)
        lights += parts
    return replace(scene, lights=tuple(lights))


def place_lights(scene: SceneAtShutter, number: int, count: int) -> SceneAtShutter:
    """``scene`` with each light that has an extent at one of ``count`` places on it, as a point of all its power."""
    lights = [
        light if light.extent is None else _without_extent(light, _spread(light, number, count))
        for light in scene.lights
    ]
    return replace(scene, lights=tuple(lights))


def parts_of(
    light: LightAtShutter,
    count: int,
    seen_from: np.ndarray | None = None,
    spread: float = math.pi,
    grid: Grid | None = None,
) -> list[LightAtShutter]:
    """About ``count`` lights of equal power that make up ``light``; their paths are its own with a number.

    Rectangles are cut into rectangles, cylinders into sides of a prism, or along their axis where they are thin, and
    what is round into a disc in its middle and rings of pieces around it, nearly rectangles of its area.

    Args:
        seen_from: From where a sphere or ellipsoid is seen as a disc, as the shutter opens and closes, shape [2, 3].
        spread: The largest angle [rad] between that and where else it is seen from.
        grid: Pieces of a rectangle or a cylinder (:class:`.light_cuts.LightCuts`); None for those that suit its size.
    """
    extent = light.extent
    if extent.shape == ExtentShape.CYLINDER:
        return _parts_of_cylinder(light, grid or grid_of(extent, count))
    if light.kind == LightKind.DISTANT and extent.shape == ExtentShape.ROUND:
        return _parts_of_sun(light, count)
    spans, motions = _spans(light, seen_from)
    depths: np.ndarray | None = None
    gain = 1.0
    if extent.shape == ExtentShape.RECT:
        pieces = _pieces_of_rectangle(grid or grid_of(extent, count))
        shapes = [ExtentShape.RECT] * len(pieces)
    else:
        pieces = pieces_of_disc(count)
        shapes = [ExtentShape.DISK] + [ExtentShape.RECT] * (len(pieces) - 1)
        if extent.shape in WITH_DEPTH:
            part_of_depth = _depth_seen(spread, len(pieces))
            depths = part_of_depth * _depths_in_ball(pieces)
            gain = _gain_by_depth(light, spans[2], seen_from, part_of_depth)
    found = []
    for number, ((place, sides), shape) in enumerate(zip(pieces, shapes, strict=True)):
        part = _at(light, np.append(place, 0.0 if depths is None else depths[number]), spans, motions)
        power = tuple(gain * channel / len(pieces) for channel in part.power)
        smaller = Extent(shape, extent.radius, sides @ spans[:2], sides @ motions[:2])
        ball = None if depths is None else _ball(light, part.position - light.position)
        found.append(replace(part, path=f"{light.path}[{number}]", power=power, extent=smaller, ball=ball))
    return found


def _parts_of_sun(light: LightAtShutter, count: int) -> list[LightAtShutter]:
    """Parts of a sun's disc, each as bright as all of its light together and from the direction that has on average.

    By sines a piece of the disc sends 1/cos θ of its area, θ from the sun's middle: light far from the middle of a wide
    sun takes up more of the sky than its piece does of the disc. With ∫ ω dω of a piece, its irradiance is that of the
    piece on whatever lies before all of it.
    """
    sine = math.sin(light.extent.radius)
    growth = (math.sin(light.extent.radius_at(0.5)) - math.sin(light.extent.radius_at(-0.5))) / max(sine, 1e-300)
    rings = _rings(count)
    inner = sine * rings[0][1]
    # ---- Directions by sines [2] and half of the parts along two axes [2, 3], in the frame of the light
    pieces = [(np.zeros(2), np.array([[inner, 0.0, 0.0], [0.0, inner, 0.0]]), ExtentShape.DISK)]
    for ring, (first, last) in enumerate(rings[1:], start=1):
        q, half = sine * np.array([first, last]), math.pi / (6 * ring)
        outward = math.sin(half) * float(np.diff(np.arcsin(q) - q * np.sqrt(1.0 - q**2))[0])
        along = half * float(np.diff(q**2)[0])
        place = outward / math.hypot(outward, along)
        depth, level = 0.5 * float(np.diff(np.arcsin(q))[0]), math.sqrt(1.0 - place**2)
        width = half * float(np.diff(q**2)[0]) / (2.0 * float(np.diff(q)[0]))
        for number in range(6 * ring):
            cosine, sine_of_turn = math.cos(2.0 * half * number), math.sin(2.0 * half * number)
            sides = np.array(
                [
                    [depth * level * cosine, depth * level * sine_of_turn, depth * place],
                    [-width * sine_of_turn, width * cosine, 0.0],
                ]
            )
            pieces.append((place * np.array([cosine, sine_of_turn]), sides, ExtentShape.RECT))
    parts = []
    for number, (place, sides, shape) in enumerate(pieces):
        part = _without_extent(light, np.append(place / sine, 0.0))
        power = tuple(channel / len(pieces) for channel in part.power)
        spans = sides @ light.axes
        smaller = Extent(shape, light.extent.radius, spans, sides @ light.axes_motion + growth * spans)
        parts.append(replace(part, path=f"{light.path}[{number}]", power=power, extent=smaller))
    return parts


def _pieces_of_rectangle(grid: Grid) -> list[tuple[np.ndarray, np.ndarray]]:
    """The middle [2] and half sides [2, 2] of the pieces of a rectangle."""
    across, down = grid
    steps = [(2.0 * np.arange(n) + 1.0) / n - 1.0 for n in (across, down)]
    size = np.diag([1.0 / across, 1.0 / down])
    return [(np.array([u, v]), size) for v in steps[1] for u in steps[0]]


def _parts_of_cylinder(light: LightAtShutter, grid: Grid) -> list[LightAtShutter]:
    """Parts of a cylinder.

    They are the faces of a prism that is as far around, cut along its axis: flat lights of the same radiance, which
    shine along their normals. Where that would have few faces, they are shorter cylinders, which are as wide.
    """
    extent, (around, along) = light.extent, grid
    steps = (2.0 * np.arange(along) + 1.0) / along - 1.0
    size = np.array([[1.0 / along, 0.0], [0.0, 0.0]])
    spans, motions = (np.stack([values[0], np.zeros(3)]) for values in (extent.spans, extent.spans_motion))
    parts = [
        replace(
            _at(light, np.array([step, 0.0]), spans, motions),
            power=tuple(channel / along for channel in light.power),
            extent=replace(extent, spans=size @ spans, spans_motion=size @ motions),
        )
        for step in steps
    ]
    if around > 1:
        # Turned against each other, they are together as wide from all sides.
        turns = [GOLDEN * number % 1.0 for number in range(along)]
        parts = [face for part, turn in zip(parts, turns, strict=True) for face in _faces_of(part, around, turn)]
    return [replace(part, path=f"{light.path}[{number}]") for number, part in enumerate(parts)]


def _faces_of(light: LightAtShutter, around: int, phase: float) -> list[LightAtShutter]:
    """The faces of the prism that has as much surface as a cylinder, turned by a part ``phase`` of a face."""
    extent, half = light.extent, math.pi / around
    faces = []
    for turn in 2.0 * half * (phase + np.arange(around)):
        face = _on_side(light, turn, half / math.tan(half), half / math.pi)
        spans = np.stack([extent.spans[0], extent.radius * half * face.axes[1]])
        turned = extent.radius * face.axes_motion[1] + extent.radius_motion * face.axes[1]
        motions = np.stack([extent.spans_motion[0], half * turned])
        faces.append(replace(face, extent=Extent(ExtentShape.RECT, 0.0, spans, motions)))
    return faces


def _on_side(light: LightAtShutter, turn: float, away: float, part: float) -> LightAtShutter:
    """A part of the surface of a cylinder as a flat place: it shines along its normal, −z of its frame.

    Args:
        turn: Where it lies about the axis [rad].
        away: How far from it, by the radius of the cylinder.
        part: Of the surface, which in all sends π times what is seen of it.
    """
    cosine, sine = math.cos(turn), math.sin(turn)
    turned = np.array([[1.0, 0.0, 0.0], [0.0, -sine, cosine], [0.0, -cosine, -sine]])
    axes, motions = turned @ light.axes, turned @ light.axes_motion
    radius, growth = away * light.extent.radius, away * light.extent.radius_motion
    return replace(
        light,
        power=tuple(math.pi * part * channel for channel in light.power),
        position=light.position - radius * axes[2],
        position_motion=light.position_motion - radius * motions[2] - growth * axes[2],
        axes=axes,
        axes_motion=motions,
        shaped_about=None if light.shaping is None else light.cone_axis,
        profile=EmissionProfile.COSINE,
    )


def _points_where_touched(
    light: LightAtShutter, parts: list[LightAtShutter], scene: SceneAtShutter
) -> list[LightAtShutter]:
    """``parts`` of a light, as points those that something specular that passes through the light nearly touches.

    First order has what such a part sends through one point of a surface by how the middle sends it, but parts of it
    lie in that surface, or behind it.
    """
    if light.kind == LightKind.DISTANT or len(parts) < 2:
        return parts
    ends = [_around(part) for part in parts]
    box = np.concatenate(ends)
    triangles = specular_triangles(scene, box.min(axis=0), box.max(axis=0))
    if not len(triangles) or not is_crossed(light.position, np.array([part.position for part in parts]), triangles):
        return parts
    # The faces of a tube are turned against each other, piece by piece along it.
    in_middle = light.extent.shape == ExtentShape.CYLINDER
    return [
        (replace(part, extent=None) if in_middle else _as_point(part))
        if is_crossed(part.position, near, triangles)
        else part
        for part, near in zip(parts, ends, strict=True)
    ]


def _as_point(part: LightAtShutter) -> LightAtShutter:
    """A part of a light as a point somewhere on it.

    Points in the middles of parts lie in rows, and how many of them stand above a surface that is level with these is
    known to a row alone. Those of all parts are spread evenly over the light and over its parts.
    """
    extent, (u, v) = part.extent, (phase_of(part.path) + 0.5) % 1.0
    place = np.array([2.0 * u - 1.0, 2.0 * v - 1.0])
    if extent.shape == ExtentShape.DISK:
        place = math.sqrt(u) * np.array([math.cos(2.0 * math.pi * v), math.sin(2.0 * math.pi * v)])
    point = _at(part, place, extent.spans, extent.spans_motion)
    ball = part.ball
    if ball is not None:
        ball = replace(ball, place=ball.place + point.position - part.position)
    return replace(point, extent=None, ball=ball)


def _around(light: LightAtShutter) -> np.ndarray:
    """Places around a light with extent, ``TOUCHED`` times as far off as it is large, shape [n, 3]."""
    a, b = light.extent.spans
    if light.extent.shape == ExtentShape.CYLINDER:
        b = light.extent.radius * light.axes[1]
    size = max(float(np.linalg.norm(a)), float(np.linalg.norm(b)))
    before = size * light.axes[2] if light.profile == EmissionProfile.COSINE else np.zeros(3)
    steps = np.array([a, b, a + b, a - b, before])
    return light.position + TOUCHED * np.concatenate([steps, -steps])


def _is_turned_away(light: LightAtShutter, scene: SceneAtShutter) -> bool:
    """Whether a flat light shines on nothing that is specular, as the shutter opens or closes."""
    if light.profile != EmissionProfile.COSINE:
        return False
    for part, points in _ends_of_glass(scene):
        before = -(light.axes[2] + part * light.axes_motion[2])
        reach = float(np.linalg.norm(light.extent.spans, axis=1).sum())
        heights = (points - light.position - part * light.position_motion) @ before
        if heights.max(initial=-math.inf) > -1e-3 * reach:
            return False
    return True


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
    rings = _rings(count)
    pieces = [(np.zeros(2), rings[0][1] * np.eye(2))]
    for ring, (inner, outer) in enumerate(rings[1:], start=1):
        half = math.pi / (6 * ring)
        # Its centre of mass, and a rectangle of its area.
        radius = 2.0 / 3.0 * (outer**3 - inner**3) / (outer**2 - inner**2) * math.sin(half) / half
        depth = 0.5 * (outer - inner)
        width = half * (outer**2 - inner**2) / (4.0 * depth)
        for number in range(6 * ring):
            turn = 2.0 * half * number
            along = np.array([math.cos(turn), math.sin(turn)])
            pieces.append((radius * along, np.array([depth * along, width * along[::-1] * (-1.0, 1.0)])))
    return pieces


def _rings(count: int) -> list[tuple[float, float]]:
    """Inner and outer radii of the disc and the rings of a unit disc whose pieces are of equal area."""
    most = max(range(32), key=lambda k: (-abs(1 + 3 * k * (k + 1) - count), k))
    radii = [0.0, *(math.sqrt((1 + 3 * k * (k + 1)) / (1 + 3 * most * (most + 1))) for k in range(most + 1))]
    return list(itertools.pairwise(radii))


def _depths(count: int) -> np.ndarray:
    """Depths of ``count`` pieces side by side, by half of the chords through them, shape [count].

    A cloud of the density 1/√(h² − z²) along a chord from −h to h is at h cos(π u) for u spread evenly over 0 … 1.
    """
    step = next(step for step in range(max(1, round(GOLDEN * count)), 2 * count + 1) if math.gcd(step, count) == 1)
    return np.cos(math.pi * (np.arange(count) * step % count + 0.5) / count)


def _depths_in_ball(pieces: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """Depths of the pieces of a unit disc (:func:`pieces_of_disc`) as which a ball is seen, shape [n].

    Pieces on opposite sides of a ring lie equally deep, so that no ring is tilted.
    """
    depths = [np.zeros(1)]
    while sum(map(len, depths)) < len(pieces):
        depths.append(np.tile(_depths(3 * len(depths)), 2))
    squares = np.array([place @ place + (sides**2).sum() / 3.0 for place, sides in pieces])
    return np.sqrt(np.maximum(1.0 - squares, 0.0)) * np.concatenate(depths)


def _has_depth(light: LightAtShutter) -> bool:
    """Whether a light is a body, not a surface or a part of the sky."""
    return light.extent is not None and light.extent.shape in WITH_DEPTH and light.kind != LightKind.DISTANT


def _depth_seen(spread: float, count: int) -> float:
    """The part of its depth that a sphere of ``count`` pieces has, seen within ``spread`` [rad] of one direction.

    As a flat disc it is narrower by 1 − cos from there. As a cloud it is as wide, but each piece lies aside by its
    depth times the sine, and fewer pieces are a coarser cloud.
    """
    return min(max(spread * math.sqrt(count) / DEPTH_SEEN - 0.5, 0.0), 1.0)


def _gain_by_depth(light: LightAtShutter, depth: np.ndarray, seen_from: np.ndarray | None, part: float) -> float:
    """By how much more light pieces of a sphere send that are as bright as it, but have a ``part`` of its depth alone.

    Places z before and behind the middle, d away, send 1/(d − z)², on average 1 + 3 ⟨z²⟩/d² of what the middle does. In
    a cloud as deep as the sphere, ⟨z²⟩ is a quarter of the square of its radius ``depth`` along the view.
    """
    if seen_from is None:
        return 1.0
    away = 0.5 * (seen_from[0] + seen_from[1]) - light.position
    return 1.0 + 0.75 * (1.0 - part * part) * float(depth @ depth) / max(float(away @ away), float(depth @ depth))


def _ends_of_glass(scene: SceneAtShutter) -> list[tuple[float, np.ndarray]]:
    """Vertices of what is specular, shape [n, 3], at the parts −½ and ½ of the shutter."""
    meshes = [mesh for mesh in scene.meshes if mesh.specular]
    return [(part, np.concatenate([_points_at(mesh, part) for mesh in meshes])) for part in (-0.5, 0.5) if meshes]


def _points_at(mesh: MeshAtShutter, part: float) -> np.ndarray:
    return mesh.points if mesh.motions is None else mesh.points + part * mesh.motions


def _middles_of_glass(scene: SceneAtShutter) -> np.ndarray | None:
    """The middle of what is specular as the shutter opens and closes, shape [2, 3]; None where nothing is."""
    ends = [points for _, points in _ends_of_glass(scene) if len(points)]
    return np.array([0.5 * (points.min(axis=0) + points.max(axis=0)) for points in ends], np.float64) if ends else None


def _corners_of_glass(scene: SceneAtShutter) -> list[np.ndarray]:
    """Corners of the boxes of what is specular as the shutter opens and closes, shape [n, 3] each."""
    found = []
    meshes = [mesh for mesh in scene.meshes if mesh.specular and len(mesh.points)]
    for part in (-0.5, 0.5):
        ends = [_points_at(mesh, part) for mesh in meshes]
        boxes = [np.stack([points.min(axis=0), points.max(axis=0)]) for points in ends]
        found += [np.concatenate([[np.choose(k, box) for k in CORNERS] for box in boxes])] if boxes else []
    return found


def _spread_of_glass(light: LightAtShutter, middles: np.ndarray | None, corners: list[np.ndarray]) -> float:
    """The largest angle [rad] between the middle of what is specular and any of it, seen from a light."""
    if middles is None:
        return math.pi
    least = 1.0
    for part, middle, found in zip((-0.5, 0.5), middles, corners, strict=True):
        at = light.position + part * light.position_motion
        view, ways = middle - at, found - at
        lengths = np.linalg.norm(ways, axis=1) * np.linalg.norm(view)
        least = min(least, float(np.min(ways @ view / np.maximum(lengths, np.finfo(float).tiny))))
    return math.acos(max(least, -1.0))


def _spans(light: LightAtShutter, seen_from: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Half of a light along two axes, and what its depth is measured by, [3, 3], and their motion; of a sun, sines.

    Of a sphere, they are its radius across and along the view from ``seen_from`` [2, 3] while the shutter is open; of
    an ellipsoid, what these are of the sphere that it is made of.
    """
    extent = light.extent
    if light.kind == LightKind.DISTANT:
        disc = np.diag([1.0, 1.0, 0.0])
        opened, middle, closed = (math.sin(extent.radius_at(part)) for part in (-0.5, 0.0, 0.5))
        return middle * disc @ light.axes, disc @ (middle * light.axes_motion + (closed - opened) * light.axes)
    if extent.shape in (ExtentShape.RECT, ExtentShape.DISK):
        none = np.zeros((1, 3))
        return np.concatenate([extent.spans, none]), np.concatenate([extent.spans_motion, none])
    view = motion = np.zeros(3)
    if seen_from is not None:
        view = 0.5 * (seen_from[0] + seen_from[1]) - light.position
        motion = seen_from[1] - seen_from[0] - light.position_motion
    if extent.shape == ExtentShape.ELLIPSOID:
        radii = [extent.spans + part * extent.spans_motion for part in (-0.5, 0.0, 0.5)]
        views = [view + part * motion for part in (-0.5, 0.0, 0.5)]
        opened, middle, closed = (_axes_across(v @ np.linalg.inv(r)) @ r for v, r in zip(views, radii, strict=True))
        return middle, closed - opened
    opened, middle, closed = (
        extent.radius_at(part) * _axes_across(view + part * motion) for part in (-0.5, 0.0, 0.5)
    )
    return middle, closed - opened


def _axes_across(direction: np.ndarray) -> np.ndarray:
    """Rows are unit axes u, v across ``direction`` and w along it, shape [3, 3], which turn steadily as that does.

    They are ``FROM_ABOVE``, turned the shortest way: only where that is all the way round do they jump.
    """
    length = float(np.linalg.norm(direction))
    w = direction / length if length > 0.0 else FROM_ABOVE[2]
    along = FROM_ABOVE[2] + w
    # The turn by half of the way, twice.
    square = max(float(along @ along), np.finfo(float).tiny)
    half = 2.0 * np.outer(along, along) / square - np.eye(3)
    return np.stack([-half @ FROM_ABOVE[0], -half @ FROM_ABOVE[1], w])


def _at(light: LightAtShutter, place: np.ndarray, spans: np.ndarray, motions: np.ndarray) -> LightAtShutter:
    """The light at one place of it, by coordinates along its spans; of parallel light shape [3], the last of them 0."""
    if light.kind == LightKind.DISTANT:
        return _without_extent(light, place)
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
        tilts = [
            _tilted(light.axes + part * light.axes_motion, math.sin(extent.radius_at(part)) * place)
            for part in (-0.5, 0.0, 0.5)
        ]
        # The same irradiance across the middle of the disc, whatever is tilted.
        cosine = math.sqrt(1.0 - sine**2 * (place[0] ** 2 + place[1] ** 2))
        power = tuple(channel / cosine for channel in light.power)
        return replace(light, power=power, axes=tilts[1], axes_motion=tilts[2] - tilts[0], extent=None)
    if extent.shape == ExtentShape.ROUND:
        offset = extent.radius * place
        motion = light.position_motion + extent.radius_motion * place
        place_there = light.position + offset
        return replace(light, position=place_there, position_motion=motion, extent=None, ball=_ball(light, offset))
    if extent.shape == ExtentShape.ELLIPSOID:
        offset, motion = place @ extent.spans, light.position_motion + place @ extent.spans_motion
        place_there = light.position + offset
        return replace(light, position=place_there, position_motion=motion, extent=None, ball=_ball(light, offset))
    if extent.shape == ExtentShape.CYLINDER:
        return _on_cylinder(light, place)
    offset, motion = place[:2] @ extent.spans, place[:2] @ extent.spans_motion
    return replace(
        light, position=light.position + offset, position_motion=light.position_motion + motion, extent=None
    )


def _ball(light: LightAtShutter, place: np.ndarray) -> Ball:
    """The sphere or ellipsoid that a place in it, beside its middle, belongs to."""
    if light.extent.shape == ExtentShape.ELLIPSOID:
        return Ball(place, 0.0, light.extent.spans)
    return Ball(place, light.extent.radius)


def _on_cylinder(light: LightAtShutter, place: np.ndarray) -> LightAtShutter:
    """A cylinder at one place of its surface: its coordinates along the axis, and along y and z on a unit circle."""
    extent = light.extent
    side = _on_side(light, math.atan2(place[2], place[1]), 1.0, 1.0)
    return replace(
        side,
        position=side.position + place[0] * extent.spans[0],
        position_motion=side.position_motion + place[0] * extent.spans_motion[0],
        extent=None,
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
    if shape == ExtentShape.CYLINDER:
        return np.array([2.0 * middle - 1.0, math.cos(turn), math.sin(turn)])
    u, v = ((number + 0.5) * step % 1.0 for step in PLASTIC)
    # F(sin θ) = (2/π)(θ − sin θ cos θ) is the part of the cloud within the radius sin θ.
    radius = math.sin(np.interp(middle, (2.0 / math.pi) * (TABLE - np.sin(TABLE) * np.cos(TABLE)), TABLE))
    height, turn = 2.0 * u - 1.0, 2.0 * math.pi * v
    level = math.sqrt(1.0 - height**2)
    return radius * np.array([level * math.cos(turn), level * math.sin(turn), height])
