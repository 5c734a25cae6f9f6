"""Emission: lattices on the lights, aimed at the specular geometry and fixed for the whole animation.

Spacing and phase of a lattice come from a few stills spread over the animation, never from the frame at hand, so that
a photon keeps its lattice coordinates (and its id) from frame to frame; each frame emits the cells that can reach
something specular during its shutter.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
import warp as wp

from tpdwarp.photons.beam import Beam
from tpdwarp.photons.lattice_aspect import elongation, specular_faces
from tpdwarp.scene.coordinate_range import require_reach
from tpdwarp.scene.description import (
    LightAtShutter,
    LightKind,
    MeshAtShutter,
    SceneAtShutter,
    SceneSource,
    reference_scenes,
)
from tpdwarp.scene.normalization import Normalization

FEWEST_ROWS = 8
FINEST_ANGLE = 0.1
WIDEST_SINGLE_PATCH = math.radians(60.0)
CUBE_FACE = math.pi / 4
# How many times the cells that the stills foresaw a frame may emit; a rod that turns takes some times as many.
MOST_GROWTH = 16
# What is specular is met from nearby where it is smaller than this part of the way from the light.
NEARBY = 1.0e-2
# Lattice coordinates are single precision: beyond this cell they no longer resolve a quarter of one.
FARTHEST_CELL = 2**22

_Bounds = tuple[float, float, float, float]


class Domain(IntEnum):
    """What the lattice of a patch lies on."""

    PLANE = 0
    DIRECTIONS = 1


@wp.struct
class Patch:
    """Cells of one lattice for one shutter, in the tracer's units. ``axis_w`` is the direction of emission.

    A plane patch emits along axis_w from points u axis_u + v axis_v; a direction patch emits from ``position`` along
    tan(u) axis_u + tan(v) axis_v + axis_w (equal angles, so that cells have nearly equal solid angle).
    ``power`` is flux per unit of plane area, or per steradian. Beams begin ``start`` along their direction: those of a
    plane through the origin, where coordinates are fine, begin beyond the scene. ``near`` is where they come near what
    is specular, ``start`` where that is no way off. ``grain`` is how large the coordinates of what is specular are.
    """

    domain: int
    position: wp.vec3
    start: float
    near: float
    grain: wp.vec3
    axis_u: wp.vec3
    axis_v: wp.vec3
    axis_w: wp.vec3
    position_motion: wp.vec3
    axis_u_motion: wp.vec3
    axis_v_motion: wp.vec3
    axis_w_motion: wp.vec3
    origin: wp.vec2
    step: wp.vec2
    first_u: int
    first_v: int
    count_u: int
    count_v: int
    power: wp.vec3


@wp.func
def emit(patch: Patch, coordinates: wp.vec2) -> Beam:
    """The beam of the photon at lattice ``coordinates``; columns are per lattice step."""
    beam = Beam()
    u = patch.origin[0] + coordinates[0] * patch.step[0]
    v = patch.origin[1] + coordinates[1] * patch.step[1]
    if patch.domain == 0:
        beam.x = patch.position + u * patch.axis_u + v * patch.axis_v
        beam.w = patch.axis_w
        beam.dxdu = patch.step[0] * patch.axis_u
        beam.dxdv = patch.step[1] * patch.axis_v
        beam.dxdt = patch.position_motion + u * patch.axis_u_motion + v * patch.axis_v_motion
        beam.dwdt = patch.axis_w_motion - patch.axis_w * wp.dot(patch.axis_w, patch.axis_w_motion)
    else:
        tan_u = wp.tan(u)
        tan_v = wp.tan(v)
        d = tan_u * patch.axis_u + tan_v * patch.axis_v + patch.axis_w
        length = wp.length(d)
        beam.x = patch.position
        beam.w = d / length
        along_u = (patch.step[0] * (1.0 + tan_u * tan_u) / length) * patch.axis_u
        along_v = (patch.step[1] * (1.0 + tan_v * tan_v) / length) * patch.axis_v
        beam.dwdu = along_u - beam.w * wp.dot(beam.w, along_u)
        beam.dwdv = along_v - beam.w * wp.dot(beam.w, along_v)
        beam.dxdt = patch.position_motion
    return beam


@wp.func
def cell_flux(patch: Patch, coordinates: wp.vec2) -> wp.vec3:
    """Flux [W] of the lattice cell around ``coordinates``."""
    cell = patch.step[0] * patch.step[1]
    if patch.domain == 1:
        tan_u = wp.tan(patch.origin[0] + coordinates[0] * patch.step[0])
        tan_v = wp.tan(patch.origin[1] + coordinates[1] * patch.step[1])
        d2 = 1.0 + tan_u * tan_u + tan_v * tan_v
        cell *= (1.0 + tan_u * tan_u) * (1.0 + tan_v * tan_v) / (d2 * wp.sqrt(d2))
    return patch.power * cell


def specular_triangles(mesh: MeshAtShutter) -> np.ndarray:
    """Vertex indices [k, 3] of the triangles that reflect or refract."""
    return mesh.triangles[specular_faces(mesh)]


def specular_corners(
    scene: SceneAtShutter, normalization: Normalization, taken: Callable[[str], bool] | None = None
) -> np.ndarray:
    """Corners [k, 3, 3] of the specular triangles in the tracer's units, at mid shutter: that is where photons go.

    Args:
        taken: Tells by a mesh's path whether it counts; None for all.
    """
    meshes = [mesh for mesh in scene.meshes if mesh.specular and (taken is None or taken(mesh.path))]
    corners = [normalization.points(mesh.points)[specular_triangles(mesh)] for mesh in meshes]
    return np.concatenate(corners).astype(np.float64) if corners else np.zeros((0, 3, 3))


@dataclass(frozen=True)
class Lattice:
    """One lattice of one light, fixed for the animation.

    Attributes:
        light: Prim path of the light.
        face: Face of the direction cube (0 for a plane or a single direction patch).
        axes: Rows are the patch's u, v, w axes; None for distant lights, whose patch turns with them.
        limit: Largest |u|, |v| of a direction patch [rad].
        origin, step: Lower corner of cell (0, 0) and the size of a cell, in patch coordinates.
        wrap: Cells per side after which ids repeat.
        first_id: Id of cell (0, 0).
    """

    light: str
    face: int
    axes: np.ndarray | None
    limit: float
    origin: tuple[float, float]
    step: tuple[float, float]
    wrap: tuple[int, int]
    first_id: int


@dataclass(frozen=True)
class EmissionPlan:
    """The lattices of all lights that the stills show.

    Attributes:
        lattices: One or more a light.
        planned_ids: Ids that these lattices use together.
        photons: Photons a frame.
        normalization: The tracer's units.
        candidates: What the stills showed, from which lattices for any number of photons are laid out.
    """

    lattices: tuple[Lattice, ...]
    planned_ids: int
    photons: int
    normalization: Normalization
    candidates: tuple[_Candidate, ...] = ()

    def with_photons(self, photons: int) -> EmissionPlan:
        """The lattices of another number of photons over the same stills, which are not read again."""
        return _planned(self.candidates, photons, self.normalization)

    def paths_of(self, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Path mask of each photon, index of its lattice in ``lattices``, and whether that one was planned."""
        mask, number = np.divmod(ids, self.id_count)
        lattice = np.searchsorted([entry.first_id for entry in self.lattices], number, side="right") - 1
        return mask, lattice, number < self.planned_ids

    @property
    def id_count(self) -> int:
        """Ids in all: room is kept for lattices of lights that no still shows."""
        return self.planned_ids + 8 * self.photons + 64

    def patches(
        self, scene: SceneAtShutter, taken: Callable[[str], bool] | None = None
    ) -> list[tuple[Lattice, Patch]]:
        """The cells of each lattice that this shutter emits, towards all specular meshes or those that are ``taken``.

        Lights that the stills show otherwise (a flash between two of them, a body that leaves the patch or turns a
        broader side to the light) get lattices of this shutter's own, and as many photons as all others together;
        their ids do not last.
        """
        corners = specular_corners(scene, self.normalization)
        if not len(corners):
            return []
        norm = self.normalization
        lights = {light.path: light for light in scene.lights if any(light.power)}
        foreseen: list[tuple[Lattice, _Bounds | None]] = []
        unforeseen: list[_Candidate] = []
        for light in lights.values():
            planned = [lattice for lattice in self.lattices if lattice.light == light.path]
            bounds = [_bounds(light, lattice.axes, lattice.limit, corners, norm) for lattice in planned]
            pairs = list(zip(planned, bounds, strict=True))
            if pairs and all(self._holds(light, corners, *pair) for pair in pairs):
                foreseen += pairs
            else:
                unforeseen += [c for c in _candidates(light.path, [(light, corners)], norm) if not c.spare]
        made = _lattices(unforeseen, self.photons, self.planned_ids)
        if taken is not None:
            corners = specular_corners(scene, norm, taken)
            foreseen = [(one, _bounds(lights[one.light], one.axes, one.limit, corners, norm)) for one, _ in foreseen]
        found = [_bounds(lights[lattice.light], lattice.axes, lattice.limit, corners, norm) for lattice in made]
        behind = 2.0 * _farthest(scene, norm) + 1.0
        grain = np.abs(corners).max(axis=(0, 1))
        return [
            (lattice, _patch(lattice, lights[lattice.light], bounds, behind, grain, norm))
            for lattice, bounds in (*foreseen, *zip(made, found, strict=True))
            if bounds is not None
        ]

    def _holds(self, light: LightAtShutter, corners: np.ndarray, lattice: Lattice, bounds: _Bounds | None) -> bool:
        """Whether ``lattice`` suits what ``light`` sees: nothing outside of it, and not far more than was foreseen."""
        if bounds is not None:
            cells = _cells(lattice, bounds)
            foreseen = lattice.wrap[0] * lattice.wrap[1] // 4
            if math.prod(count for _, count in cells) > MOST_GROWTH * foreseen:
                return False
            if any(max(abs(first), abs(first + count)) > FARTHEST_CELL for first, count in cells):
                return False
        if lattice.limit != WIDEST_SINGLE_PATCH:
            return True
        return _spread(light, corners, lattice.axes[2], self.normalization) <= WIDEST_SINGLE_PATCH


def plan_emission(
    source: SceneSource, photons: int, normalization: Normalization, *, square: bool = False
) -> EmissionPlan:
    """Lays out the lattices for ``photons`` photons a frame, shared between lights by the power they send.

    Args:
        square: Whether cells are square also where light varies in one direction alone.
    """
    stills = reference_scenes(source, lambda scene: require_reach(scene, normalization, source.file))
    corners = [specular_corners(scene, normalization) for scene in stills]
    paths = list(dict.fromkeys(light.path for scene in stills for light in scene.lights))
    candidates = []
    for path in paths:
        views = [
            (light, there)
            for scene, there in zip(stills, corners, strict=True)
            for light in scene.lights
            if light.path == path and len(there)
        ]
        if views:
            found = _candidates(path, views, normalization)
            if views[0][0].kind == LightKind.DISTANT and not square:
                longer = elongation((light, scene) for scene in stills for light in scene.lights if light.path == path)
                found = [replace(candidate, elongation=longer) for candidate in found]
            candidates += found
    return _planned(tuple(candidates), photons, normalization)


def _planned(candidates: tuple[_Candidate, ...], photons: int, normalization: Normalization) -> EmissionPlan:
    lattices = _lattices(candidates, photons, 0)
    used = max((lattice.first_id + lattice.wrap[0] * lattice.wrap[1] for lattice in lattices), default=0)
    return EmissionPlan(tuple(lattices), used, photons, normalization, candidates)


def _lattices(candidates: Sequence[_Candidate], photons: int, first_id: int) -> list[Lattice]:
    """Lattices with cells for ``photons`` photons, shared between candidates by power; spare ones are not counted."""
    total = sum(candidate.power for candidate in candidates if not candidate.spare)
    lattices = []
    for candidate in candidates:
        count = max(1.0, photons * candidate.power / total)
        width, height = candidate.size
        # What light grazes is a strip: cells keep their shape until one side has but one row of them.
        longer = candidate.elongation
        for axis, size in ((longer, height / width), (1.0 / longer, width / height)):
            if axis > 1.0:
                # Long cells are wide where light ends, too: some rows of them are kept.
                longer = longer ** min(1.0, math.log(max(1.0, count * size / FEWEST_ROWS**2)) / math.log(axis))
        across = max(1, round(min(math.sqrt(count * longer * width / height), count)))
        down = max(1, round(count / across))
        origin, step = candidate.origin, (width / across, height / down)
        if candidate.limit == CUBE_FACE:
            # Cells end where the face ends, so that no two faces emit the same directions.
            origin = (-CUBE_FACE, -CUBE_FACE)
            step = tuple(2.0 * CUBE_FACE / math.ceil(2.0 * CUBE_FACE / size - 1e-6) for size in step)
        wrap = (2 * across, 2 * down)
        lattices.append(
            Lattice(candidate.light, candidate.face, candidate.axes, candidate.limit, origin, step, wrap, first_id)
        )
        first_id += wrap[0] * wrap[1]
    return lattices


@dataclass(frozen=True)
class _Candidate:
    """A patch that a light could use: where it lies, the largest domain seen there and the power through it.

    A ``spare`` one is a face of the cube that nothing was seen through yet, sized like the strongest of the others.
    """

    light: str
    face: int
    axes: np.ndarray | None
    limit: float
    origin: tuple[float, float]
    size: tuple[float, float]
    power: float
    spare: bool = False
    elongation: float = 1.0


def _candidates(
    path: str, views: Sequence[tuple[LightAtShutter, np.ndarray]], normalization: Normalization
) -> list[_Candidate]:
    first, first_corners = views[0]
    if first.kind == LightKind.DISTANT:
        faces, limit = [None], math.inf
    else:
        centre = 0.5 * (first_corners.min(axis=(0, 1)) + first_corners.max(axis=(0, 1)))
        cube = _cube(centre - normalization.points(first.position[None])[0])
        spread = max(_spread(light, there, cube[0][2], normalization) for light, there in views)
        faces, limit = (cube[:1], WIDEST_SINGLE_PATCH) if spread < WIDEST_SINGLE_PATCH else (cube, CUBE_FACE)
    found = []
    for number, axes in enumerate(faces):
        bounds = [(light, _bounds(light, axes, limit, there, normalization)) for light, there in views]
        seen = [(light, b) for light, b in bounds if b is not None]
        if not seen:
            continue
        largest = max((b for _, b in seen), key=_area)
        size = (largest[1] - largest[0], largest[3] - largest[2])
        if min(size) <= 0.0:
            continue
        power = max(sum(light.power) * _area(b) for light, b in seen)
        if first.kind == LightKind.DISTANT:
            power /= normalization.scale**2
        if power > 0.0:
            found.append(_Candidate(path, number, axes, limit, (largest[0], largest[2]), size, power))
    if found and len(faces) > 1:
        strongest, seen = max(found, key=lambda candidate: candidate.power), {candidate.face for candidate in found}
        found += [
            replace(strongest, face=number, axes=axes, spare=True)
            for number, axes in enumerate(faces)
            if number not in seen
        ]
    return found


def _farthest(scene: SceneAtShutter, normalization: Normalization) -> float:
    """Radius of a sphere about the origin that holds the scene at mid shutter, in the tracer's units."""
    radius = normalization.radius
    for mesh in scene.meshes:
        reach = normalization.points(mesh.points)
        radius = max(radius, float(np.sqrt(np.einsum("ij,ij->i", reach, reach).max(initial=0.0))))
    return radius


def _area(bounds: _Bounds) -> float:
    return (bounds[1] - bounds[0]) * (bounds[3] - bounds[2])


def _cube(axis: np.ndarray) -> list[np.ndarray]:
    """Axes (rows u, v, w) of the six faces of a cube whose first face looks along ``axis``."""
    length = np.linalg.norm(axis)
    w = axis / length if length > 1e-9 else np.array([0.0, 0.0, -1.0])
    helper = np.eye(3)[int(np.argmin(np.abs(w)))]
    u = np.cross(helper, w)
    u /= np.linalg.norm(u)
    v = np.cross(w, u)
    return [np.array(face) for face in ((u, v, w), (-u, v, -w), (v, w, u), (v, -w, -u), (w, u, v), (-w, u, -v))]


def _spread(light: LightAtShutter, corners: np.ndarray, axis: np.ndarray, normalization: Normalization) -> float:
    offsets = corners.reshape(-1, 3) - normalization.points(light.position[None])[0]
    lengths = np.maximum(np.linalg.norm(offsets, axis=1), 1e-30)
    return float(np.arccos(np.clip((offsets @ axis / lengths).min(), -1.0, 1.0)))


def _bounds(
    light: LightAtShutter,
    axes: np.ndarray | None,
    limit: float,
    corners: np.ndarray,
    normalization: Normalization,
) -> _Bounds | None:
    """Patch coordinates (u0, u1, v0, v1) that reach ``corners`` at mid shutter; None if none do."""
    if light.kind == LightKind.DISTANT:
        uv = corners.reshape(-1, 3) @ light.axes[:2].T
    else:
        uv = _angles(corners - normalization.points(light.position[None])[0], axes, limit)
    if not len(uv):
        return None
    lower, upper = uv.min(axis=0), uv.max(axis=0)
    return float(lower[0]), float(upper[0]), float(lower[1]), float(upper[1])


def _angles(corners: np.ndarray, axes: np.ndarray, limit: float) -> np.ndarray:
    """(u, v) angles of the parts of triangles [k, 3, 3] (seen from the origin) inside the patch, shape [m, 2].

    Triangles that look large from the light are cut across their longest edge until they look small, so that bounds
    stay tight where a surface surrounds the light.
    """
    found = []
    local = corners @ axes.T
    for _ in range(24):
        lengths = np.linalg.norm(local, axis=2)
        edges = np.linalg.norm(local - np.roll(local, -1, axis=1), axis=2)
        angle = edges.max(axis=1) / np.maximum(lengths.min(axis=1), 1e-9)
        centre = local.mean(axis=1)
        reach = np.arctan2(np.maximum(np.abs(centre[:, 0]), np.abs(centre[:, 1])), centre[:, 2])
        near = (reach <= limit + angle) | (angle > 1.0)
        small = angle <= FINEST_ANGLE
        found.append(local[near & small].reshape(-1, 3))
        local, edges = local[near & ~small], edges[near & ~small]
        if not len(local) or len(local) > 200_000:
            break
        rows, longest = np.arange(len(local)), edges.argmax(axis=1)
        a, b, c = (local[rows, (longest + corner) % 3] for corner in range(3))
        middle = 0.5 * (a + b)
        local = np.concatenate([np.stack(part, axis=1) for part in ((a, middle, c), (middle, b, c))])
    found.append(local.reshape(-1, 3))
    points = np.concatenate(found)
    points = points[points[:, 2] > 0.0]
    if not len(points):
        return np.zeros((0, 2))
    uv = np.arctan2(points[:, :2], points[:, 2:])
    inside = np.all(np.abs(uv) <= limit + FINEST_ANGLE, axis=1)
    return np.clip(uv[inside], -limit, limit)


def _cells(lattice: Lattice, bounds: _Bounds) -> list[tuple[int, int]]:
    """First cell and number of cells of ``lattice`` that cover ``bounds``, along u and along v."""
    cells = []
    for axis in (0, 1):
        low = (bounds[2 * axis] - lattice.origin[axis]) / lattice.step[axis]
        high = (bounds[2 * axis + 1] - lattice.origin[axis]) / lattice.step[axis]
        first = math.floor(low + 1e-4)
        cells.append((first, max(1, math.ceil(high - 1e-4) - first)))
    return cells


def _patch(
    lattice: Lattice,
    light: LightAtShutter,
    bounds: _Bounds,
    behind: float,
    grain: np.ndarray,
    normalization: Normalization,
) -> Patch:
    """The cells of ``lattice`` that cover ``bounds``; light from afar starts ``behind`` before the origin.

    ``grain`` [3] is how large the coordinates of what is specular are.
    """
    patch = Patch()
    patch.grain = wp.vec3(*(grain + 1e-3 * grain.max()))
    (patch.first_u, patch.count_u), (patch.first_v, patch.count_v) = _cells(lattice, bounds)
    patch.origin, patch.step = wp.vec2(*lattice.origin), wp.vec2(*lattice.step)
    if light.kind == LightKind.DISTANT:
        axes, motions = light.axes, light.axes_motion
        patch.domain = int(Domain.PLANE)
        patch.axis_u, patch.axis_v, patch.axis_w = wp.vec3(*axes[0]), wp.vec3(*axes[1]), wp.vec3(*-axes[2])
        patch.axis_u_motion, patch.axis_v_motion = wp.vec3(*motions[0]), wp.vec3(*motions[1])
        patch.axis_w_motion = wp.vec3(*-motions[2])
        patch.start, distance = -behind, behind
    else:
        axes = lattice.axes
        patch.domain = int(Domain.DIRECTIONS)
        patch.axis_u, patch.axis_v, patch.axis_w = wp.vec3(*axes[0]), wp.vec3(*axes[1]), wp.vec3(*axes[2])
        patch.position = wp.vec3(*normalization.points(light.position[None])[0].astype(float))
        patch.position_motion = wp.vec3(*(light.position_motion * normalization.scale))
        patch.start, distance = 0.0, float(np.linalg.norm(patch.position))
    reach = 2.0 * float(np.linalg.norm(grain))
    patch.near = patch.start + (distance - reach if reach < NEARBY * distance else 0.0)
    patch.power = wp.vec3(*normalization.light_power(light))
    return patch
