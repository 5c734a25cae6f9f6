"""How far bodies, and lights that shine differently in different directions, turn within a shutter.

Light that a rigid body sends turns with it, and a photon goes along a curve of third order in time: where it turns far
neither the curve nor what keyframes tell apart follows. Errors measured in each photon's own light do not show that, so
that bodies that turn have at least a segment for each ``DEGREES_PER_SEGMENT``. Points of what turns go straight within
a segment besides, so that it seems to grow towards the ends of that, for the camera, for shadows, and for light that
falls on it: so what is lit through glass or by mirrors counts, too. Lights that turn have one for each half
of that: what a panel or a cone sends in one direction follows no curve of third order either, and its mean is not that
of the middle; and so have lamps that go around a body, as seen from it. Cells ride evenly: bodies that, seen from a
lamp, go or grow unevenly have as many as keep them from sliding off.

Beyond the paper, which traces once a frame.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterator, Sequence

import numpy as np

from tpdwarp.scene.description import (
    EmissionProfile,
    ExtentShape,
    LightAtShutter,
    LightKind,
    MeshAtShutter,
    SceneAtShutter,
)
from tpdwarp.scene.device.shaping import is_shaped

# Chosen, not derived (16 384 photons): a mirror ring that turns over by 90 degrees errs by .075 in three segments, .084
# in two and .122 in six, .426 in one; a tumbler that falls and turns by 35 by .023 in one and in two, .027 in three; a
# torus that turns by 45 by .048 in one, .057 in two and .066 in four (``scripts/benchmarks/strangers.py`` and
# ``solids.py`` beside it). Since light that rests is traced in parts, that ring errs less in one; but its own picture
# and its shadow err by .080 then, by .036 and .026 in two and three.
DEGREES_PER_SEGMENT = 30.0
# Of lights: a lamp that goes around a lens by 33 degrees errs by .29 in one segment, by .044 in three.
DEGREES_PER_SEGMENT_OF_LIGHTS = 15.0
# Bodies leave an even way and an even growth, as lamps see them, by no more than this part of their size. Chosen on a
# lamp that rises from 1.0 to 2.0 above a lens of radius .25, whose focus errs by 1.37 (of the mean) in one segment,
# .27 in two, .14 in three and in four (16 384 photons).
LARGEST_SLIDE = 0.015
# A mesh is rigid where its points lie within this part of its size of those that its turn leads to. Chosen, not
# derived: as far as a turn by a degree and a half moves them.
RIGID = 0.02
# Points of a mesh that are looked at, spread over it.
MOST_POINTS = 256


def segments_needed(scenes: Sequence[SceneAtShutter], part: float, lit: Collection[str] = ()) -> float:
    """How many segments the shutter has at least for what turns in it; not yet a whole number, for ``scenes`` may be
    those of a part of a longer shutter, and nothing where nothing turns.

    Args:
        scenes: The scene at consecutive times of the shutter, no more than half a turn apart.
        part: The part of the shutter between the first and the last of these.
        lit: Prim paths of what light of what is specular falls on.
    """
    of_bodies = degrees = 0.0
    for states in _bodies(scenes, lit):
        if states[0].moves:
            turns = [turn_between(*pair) for pair in itertools.pairwise(states)]
            of_bodies = max(of_bodies, math.degrees(sum(turns)))
    for light in scenes[0].lights:
        axes = [found.axes for scene in scenes for found in scene.lights if found.path == light.path]
        if len(axes) == len(scenes):
            turns = [turn_of_light(light, *pair) for pair in itertools.pairwise(axes)]
            degrees = max(degrees, math.degrees(sum(turns)))
    slide, bodies_move = 0.0, _bodies_move(scenes)
    for light in scenes[0].lights:
        places = [found.position for scene in scenes for found in scene.lights if found.path == light.path]
        if light.kind == LightKind.DISTANT or len(places) != len(scenes):
            continue
        if light.moves:
            degrees = max(degrees, math.degrees(largest_turn_about_bodies(places, scenes)))
        # Nothing slides where neither has moved.
        if len(scenes) == 3 and (bodies_move or np.ptp(places, axis=0).any()):
            slide = max(slide, largest_slide(places, scenes))
    turns = max(of_bodies / DEGREES_PER_SEGMENT, degrees / DEGREES_PER_SEGMENT_OF_LIGHTS)
    return max(turns, math.sqrt(slide / LARGEST_SLIDE)) / part


def turn_of_light(light: LightAtShutter, before: np.ndarray, after: np.ndarray) -> float:
    """The angle [rad], 0 … π, between axes [3, 3] of a light as far as it is seen in its light; 0 of what shines alike
    in all directions, and of parallel light, whose direction photons follow."""
    if light.kind == LightKind.DISTANT or not is_shaped(light):
        return 0.0
    about_two_axes = light.profile == EmissionProfile.SINE and light.shaping is not None
    about_two_axes = about_two_axes or light.profile == EmissionProfile.SHOWN
    if about_two_axes or (light.extent is not None and light.extent.shape == ExtentShape.RECT):
        cosine = 0.5 * (float(np.sum(before * after)) - 1.0)
    else:
        axis = 0 if light.profile == EmissionProfile.SINE else 2
        cosine = float(before[axis] @ after[axis])
    return math.acos(min(max(cosine, -1.0), 1.0))


def largest_turn_about_bodies(places: Sequence[np.ndarray], scenes: Sequence[SceneAtShutter]) -> float:
    """The largest angle [rad] by which a lamp that stands at ``places`` [3] turns as seen from the middle of a body.

    Cells ride along with a body evenly; as its light turns by more than it is large as seen from the lamp, they slide
    off it. What is larger, as water around a lamp, keeps them.
    """
    largest = 0.0
    for away, radius in _ways_to_bodies(places, scenes):
        distances = np.linalg.norm(away, axis=1)
        cosines = np.einsum("ij,ij->i", away[1:], away[:-1]) / (distances[1:] * distances[:-1])
        turn = float(np.arccos(np.clip(cosines, -1.0, 1.0)).sum())
        if turn > np.arctan2(radius, distances.min()):
            largest = max(largest, turn)
    return largest


def largest_slide(places: Sequence[np.ndarray], scenes: Sequence[SceneAtShutter]) -> float:
    """How far bodies leave an even way and an even growth, as a lamp at ``places`` [3, 3] sees them, by their size.

    Cells ride and grow evenly: so the rim of a lens slides over them as a lamp rises from it, though both move evenly.
    It is what the ends of the shutter deviate by from the tangent in the middle. What holds the lamp does not count.
    """
    largest = 0.0
    for away, radius in _ways_to_bodies(places, scenes):
        distances = np.linalg.norm(away, axis=1)
        if distances.min() <= radius:
            continue
        directions, radii = away / distances[:, None], np.arcsin(radius / distances)
        # Angles along great circles from where it stands in the middle.
        across = directions - (directions @ directions[1])[:, None] * directions[1]
        sines = np.linalg.norm(across, axis=1)
        angles = np.arctan2(sines, directions @ directions[1])
        at = across * np.divide(angles, sines, out=np.ones_like(angles), where=sines > 0.0)[:, None]
        bends = 0.5 * np.linalg.norm(at[0] + at[2]), 0.5 * abs(radii[0] + radii[2] - 2.0 * radii[1])
        largest = max(largest, float(sum(bends) / radii[1]))
    return largest


def _bodies_move(scenes: Sequence[SceneAtShutter]) -> bool:
    """Whether any specular body is elsewhere in one of the scenes than in the first."""
    first = {mesh.path: mesh.points for mesh in scenes[0].meshes if mesh.specular}
    return any(
        mesh.path in first and not np.array_equal(mesh.points, first[mesh.path])
        for scene in scenes[1:]
        for mesh in scene.meshes
    )


def _ways_to_bodies(
    places: Sequence[np.ndarray], scenes: Sequence[SceneAtShutter]
) -> Iterator[tuple[np.ndarray, float]]:
    """From the middle of each specular body to a lamp at ``places``, shape [k, 3], and half of the body's size."""
    for states in _bodies(scenes):
        if not all(len(mesh.points) for mesh in states):
            continue
        ends = [(mesh.points.min(axis=0), mesh.points.max(axis=0)) for mesh in states]
        away = np.array([place - 0.5 * (low + high) for place, (low, high) in zip(places, ends, strict=True)])
        if np.linalg.norm(away, axis=1).min() > 0.0:
            low, high = ends[0]
            yield away, 0.5 * float(np.linalg.norm(high - low))


def _bodies(scenes: Sequence[SceneAtShutter], besides: Collection[str] = ()) -> Iterator[list[MeshAtShutter]]:
    """Each mesh that is specular in the first of some scenes, or one of those ``besides``, in all of them; without
    those that some do not have."""
    first = {mesh.path: [mesh] for mesh in scenes[0].meshes if mesh.specular or mesh.path in besides}
    for scene in scenes[1:]:
        for mesh in scene.meshes:
            if mesh.path in first:
                first[mesh.path].append(mesh)
    return (states for states in first.values() if len(states) == len(scenes))


def turn_between(before: MeshAtShutter, after: MeshAtShutter) -> float:
    """The angle [rad], 0 … π, by which a rigid mesh turns from one state to the other; 0 where it is not rigid.

    The rotation that leads the points nearest to where they are in the mean square (Kabsch 1976).
    """
    if before.points.shape != after.points.shape:
        return 0.0
    chosen = np.unique(np.linspace(0, len(before.points) - 1, MOST_POINTS).astype(np.int64))
    first, second = (mesh.points[chosen].astype(np.float64) for mesh in (before, after))
    first, second = first - first.mean(axis=0), second - second.mean(axis=0)
    u, _, vt = np.linalg.svd(first.T @ second)
    u[:, -1] *= np.sign(np.linalg.det(u @ vt))
    rotation = u @ vt
    size, apart = np.linalg.norm(second), np.linalg.norm(first @ rotation - second)
    if apart > RIGID * size:
        return 0.0
    return float(np.arccos(np.clip(0.5 * (np.trace(rotation) - 1.0), -1.0, 1.0)))
