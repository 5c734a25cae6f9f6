"""Nested dielectrics: which solids lie in each other or touch, and which of two holds where both are.

Ice in water, water in a glass, bubbles: a stage models each as a closed mesh, whose index of refraction is that of what
is inside. Where solids overlap, the one of higher priority is there, and the other is not (Schmidt & Budge, *Simple
Nested Dielectrics in Ray Traced Images*, 2002). Priorities are authored, or follow from how solids lie in each other:

- What lies in another by a good part of its volume displaces it: ice, bubbles, a rod that dips into water.
- Of two that overlap by little, or just touch, the one that surrounds the other is a vessel, and holds; where neither
  does, the one of higher index.

Open sheets, as the surface of a sea, bound what is below them; they take part where they go through a solid, as the sea
does through ice. They are nothing to each other, nor to solids of their own index: they may be sides of one body. Left
alone are meshes of several indices, of an index below one (relative to
what surrounds them), thin walls, and closed ones that are inside out (cavities of what surrounds them).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.scene.description import Interaction, Material, MeshAtShutter, SceneAtShutter

# A closed mesh's area vectors add up to zero; below this part of its area they do.
CLOSED = 1e-3
# In units of the solids' coordinates: surfaces that are closer touch. As in contact: twice what rays cannot separate.
TOUCHING = 2.0e-5
# Places on the surfaces of a pair that are looked at, and within both of their boxes. Chosen, not derived.
SURFACE_POINTS, VOLUME_POINTS = 128, 512
# From this part of its volume on, a solid lies in another. Chosen, not derived: a wall that water was grown into to
# close the gap takes less.
GOOD_PART = 0.25
# A solid surrounds another whose box lies within its own by more than this part.
SURROUNDED = 0.5
# Bits of a path's mask of the media that it is in, a sign aside.
MOST_MEDIA = 31

# A distance in which nothing is met.
NOWHERE = wp.constant(1.0e6)
# Directions to look along from a point for what it is in: those of no usual edge or face.
_ALONG = np.array([0.31830989, 0.57721566, 0.75202734])


@dataclass(frozen=True, eq=False)
class Nesting:
    """The solids that lie in each other or touch.

    Attributes:
        media: Number of the medium in each mesh of a scene, −1 for those that take no part, shape [m] int32. Where
            several are, the highest holds. Solids that do not overlap may share a number.
        materials: What each medium is made of.
        box: What is in a medium lies within it, [2, 3]; unbounded where an open sheet bounds one.
    """

    media: np.ndarray
    materials: tuple[Material, ...]
    box: np.ndarray

    @property
    def indices(self) -> np.ndarray:
        """Index of refraction of each medium, shape [k]."""
        return np.array([material.ior for material in self.materials])


_found: WeakKeyDictionary[SceneAtShutter, Nesting | None] = WeakKeyDictionary()
_solids: WeakKeyDictionary[MeshAtShutter, _Solid | None] = WeakKeyDictionary()


def nesting_of(scene: SceneAtShutter) -> Nesting | None:
    """How the dielectric solids of ``scene`` lie in each other at mid shutter; None where none do, nor touch."""
    if scene not in _found:
        _found[scene] = _nesting_of(scene.meshes)
    return _found[scene]


def _nesting_of(meshes: tuple[MeshAtShutter, ...]) -> Nesting | None:
    glass = [number for number, mesh in enumerate(meshes) if _index_of(mesh) is not None]
    boxes = {number: _box_over(meshes[number]) for number in glass} if len(glass) > 1 else {}
    meeting = [pair for pair in itertools.combinations(boxes, 2) if _meet(*map(boxes.get, pair))]
    glass = sorted(set(itertools.chain.from_iterable(meeting)))
    if not glass:
        return None
    solids = {number: solid for number in glass if (solid := _solid_of(meshes[number])) is not None}
    pairs = [
        (a, b)
        for a, b in itertools.combinations(solids, 2)
        if solids[a].may_meet(solids[b])
    ]
    if not pairs:
        return None
    near = sorted({number for pair in pairs for number in pair})
    ground = _Ground({number: solids[number] for number in near})
    # From the one that gives way to the one that holds.
    order = [found for a, b in pairs if (found := _ordered(a, b, solids, ground)) is not None]
    if not order:
        return None
    return _numbered(order, solids, len(meshes))


def _index_of(mesh: MeshAtShutter) -> float | None:
    """The index of refraction of a mesh that may be a solid; None for others."""
    glass = [m for m in mesh.materials if m.interaction == Interaction.DIELECTRIC]
    indices = {m.ior for m in glass}
    if len(indices) != 1 or not len(mesh.triangles) or any(m.thin_walled for m in glass):
        return None
    index = next(iter(indices))
    return index if index >= 1.0 else None


def _inside(material: Material) -> tuple[object, ...]:
    """What light inside of a dielectric meets: solids that agree in this may be one medium."""
    return material.ior, material.absorption, material.abbe


@dataclass(frozen=True, eq=False)
class _Solid:
    """A mesh that may lie in others, and the box [2, 3] that it stays in.

    ``up`` points off an open one to its front; along it, and back, others are looked through.
    """

    mesh: MeshAtShutter
    index: float
    box: np.ndarray
    volume: float
    up: np.ndarray
    is_open: bool

    def may_meet(self, other: _Solid) -> bool:
        if (self.is_open or other.is_open) and (self.is_open == other.is_open or self.index == other.index):
            return False
        return _meet(self.box, other.box)

    def share_of_box_in(self, other: _Solid) -> float:
        """Part of its box that lies in the other's."""
        common = np.minimum(self.box[1], other.box[1]) - np.maximum(self.box[0], other.box[0])
        return float(np.prod(np.maximum(common, 0.0)) / max(np.prod(np.ptp(self.box, axis=0)), np.finfo(float).tiny))


def _meet(box: np.ndarray, other: np.ndarray) -> bool:
    """Whether boxes [2, 3] overlap or touch."""
    slack = TOUCHING * max(np.abs(box).max(), np.abs(other).max())
    return bool(np.all(box[0] <= other[1] + slack) and np.all(other[0] <= box[1] + slack))


def _box_over(mesh: MeshAtShutter) -> np.ndarray:
    """The box [2, 3] that a mesh stays in over the shutter."""
    if mesh.motions is None:
        boxes = mesh.boxes
        return np.array([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])
    # Coordinate by coordinate, which is ten times as fast.
    points, half = np.ascontiguousarray(mesh.points.T), 0.5 * np.abs(np.ascontiguousarray(mesh.motions.T))
    return np.array([(points - half).min(axis=1), (points + half).max(axis=1)])


def _solid_of(mesh: MeshAtShutter) -> _Solid | None:
    """The solid that a mesh bounds; None for closed ones that are inside out."""
    if mesh not in _solids:
        _solids[mesh] = _measured(mesh)
    return _solids[mesh]


def _measured(mesh: MeshAtShutter) -> _Solid | None:
    box = _box_over(mesh)
    a, b, c = (mesh.points[mesh.triangles[:, corner]] - box.mean(axis=0) for corner in range(3))
    normals = 0.5 * np.cross(b - a, c - a)
    area = float(np.linalg.norm(normals, axis=1).sum())
    total = normals.sum(axis=0)
    length = float(np.linalg.norm(total))
    if length > CLOSED * area:
        return _Solid(mesh, _index_of(mesh), box, np.inf, total / length, True)
    volume = float(np.einsum("ij,ij->i", a, normals).sum() / 3.0)
    return _Solid(mesh, _index_of(mesh), box, volume, _ALONG, False) if volume > 0.0 else None


@wp.kernel(enable_backward=False)
def first_crossings(
    base: int,
    mesh: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    direction: wp.vec3,
    distances: wp.array(dtype=wp.float32),
    from_inside: wp.array(dtype=wp.int32),
):
    """How far along ``direction`` a mesh is met from each point, and whether from its back; far off where it is not."""
    i = base + wp.tid()
    query = wp.mesh_query_ray(mesh, points[i], direction, NOWHERE)
    distances[i] = NOWHERE
    if query.result:
        distances[i] = query.t
        from_inside[i] = wp.where(wp.dot(query.normal, direction) > 0.0, 1, 0)


class _Ground:
    """Solids in units of their own size, and what points lie in."""

    def __init__(self, solids: dict[int, _Solid]) -> None:
        boxes = np.array([solid.box for solid in solids.values()])
        low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
        self._origin, self._scale = 0.5 * (low + high), 2.0 / max(float((high - low).max()), np.finfo(float).tiny)
        # A few hundred points: not worth another device, nor threads.
        self._launcher = Launcher("cpu", 1)
        self._solids = solids
        self._meshes = {
            number: wp.Mesh(
                points=wp.array(self._placed(solid.mesh.points), dtype=wp.vec3, device="cpu"),
                indices=wp.array(solid.mesh.triangles.ravel().astype(np.int32), dtype=wp.int32, device="cpu"),
            )
            for number, solid in solids.items()
        }

    def _placed(self, points: np.ndarray) -> np.ndarray:
        return ((points - self._origin) * self._scale).astype(np.float32)

    def in_solid(self, number: int, points: np.ndarray) -> np.ndarray:
        """Which of the points [n, 3] lie in a solid."""
        solid, places = self._solids[number], wp.array(self._placed(points), dtype=wp.vec3, device="cpu")
        distances, inside = self._met(number, places, solid.up)
        if not solid.is_open:
            return inside & self._met(number, places, -solid.up)[1]
        # Seen from below, unless another sheet comes first.
        for other, beside in self._solids.items():
            if beside.is_open and other != number:
                inside &= self._met(other, places, solid.up)[0] >= distances
        return inside

    def _met(self, number: int, places: wp.array, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        count = places.shape[0]
        distances, inside = (wp.zeros(count, dtype=kind, device="cpu") for kind in (wp.float32, wp.int32))
        inputs = [self._meshes[number].id, places, wp.vec3(*map(float, direction)), distances, inside]
        self._launcher(first_crossings, count, inputs)
        return distances.numpy(), inside.numpy() > 0

    def goes_through(self, number: int, sheet: int) -> bool:
        """Whether a solid lies on both sides of an open sheet."""
        points = self._surface_points(number, sheet, 0.0)
        if not len(points):
            return False
        places = wp.array(self._placed(points), dtype=wp.vec3, device="cpu")
        distances, _ = self._met(sheet, places, -self._solids[sheet].up)
        return bool(self.in_solid(sheet, points).any() and (distances < NOWHERE).any())

    def surface_in(self, number: int, other: int, offset: float) -> bool:
        """Whether a place ``offset`` off the surface of a solid lies in another, in their own units."""
        points = self._surface_points(number, other, offset)
        return len(points) > 0 and bool(self.in_solid(other, points).any())

    def _surface_points(self, number: int, other: int, offset: float) -> np.ndarray:
        """Some places ``offset`` off the surface of a solid, about where another is, shape [n, 3]."""
        there, mesh = self._solids[other], self._solids[number].mesh
        a, b, c = (mesh.points[mesh.triangles[:, corner]] for corner in range(3))
        middles = (a + b + c) / 3.0
        slack = 1.0 / self._scale * TOUCHING
        here = np.ones(len(middles), bool)
        if not there.is_open:
            here = np.all((middles >= there.box[0] - slack) & (middles <= there.box[1] + slack), axis=1)
        near = np.flatnonzero(here)
        if not len(near):
            return np.zeros((0, 3))
        rows = near[:: -(-len(near) // SURFACE_POINTS)]
        normals = np.cross(b[rows] - a[rows], c[rows] - a[rows])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
        return middles[rows] + offset / self._scale * normals

    def common_volume(self, a: int, b: int) -> float:
        """Volume where two solids are both, estimated."""
        first, second = self._solids[a], self._solids[b]
        # What an open sheet bounds has no box; it is one that the other goes through.
        boxes = [solid.box for solid in (first, second) if not solid.is_open]
        low, high = np.max([box[0] for box in boxes], axis=0), np.min([box[1] for box in boxes], axis=0)
        size = np.maximum(high - low, 0.0)
        points = low + size * np.random.default_rng(0).random((VOLUME_POINTS, 3))
        return float(np.prod(size) * np.mean(self.in_solid(a, points) & self.in_solid(b, points)))


def _ordered(a: int, b: int, solids: dict[int, _Solid], ground: _Ground) -> tuple[int, int] | None:
    """The one of two solids that gives way where both are, and the one that holds; None where they are apart.

    Solids of one index that just touch have air between them, as stacked panes have.
    """
    one, two = solids[a], solids[b]
    if one.is_open or two.is_open:
        touch, overlap = False, ground.goes_through(*((b, a) if one.is_open else (a, b)))
    else:
        overlap = ground.surface_in(a, b, -TOUCHING) or ground.surface_in(b, a, -TOUCHING)
        touch = one.index != two.index and (ground.surface_in(a, b, TOUCHING) or ground.surface_in(b, a, TOUCHING))
    if not overlap and not touch:
        return None
    if one.mesh.priority != two.mesh.priority:
        return (a, b) if one.mesh.priority < two.mesh.priority else (b, a)
    common = ground.common_volume(a, b) if overlap else 0.0
    shares = common / one.volume, common / two.volume
    if max(shares) < GOOD_PART:
        boxes = one.share_of_box_in(two), two.share_of_box_in(one)
        if max(boxes) > SURROUNDED and boxes[0] != boxes[1]:
            return (a, b) if boxes[0] > boxes[1] else (b, a)
        if one.index != two.index:
            return (a, b) if one.index < two.index else (b, a)
    return (a, b) if shares[0] < shares[1] else (b, a)


def _numbered(order: list[tuple[int, int]], solids: dict[int, _Solid], mesh_count: int) -> Nesting:
    """Media of solids, of which some give way to others."""
    below: dict[int, set[int]] = {}
    for lower, higher in order:
        below.setdefault(higher, set()).add(lower)
        below.setdefault(lower, set())
    ranked: list[int] = []
    while len(ranked) < len(below):
        # Where each gives way to another in a ring, the one with the fewest to wait for comes first.
        waiting = [number for number in below if number not in ranked]
        ranked.append(min(waiting, key=lambda number: (len(below[number].difference(ranked)), number)))
    media = np.full(mesh_count, -1, np.int32)
    materials: list[Material] = []
    beside: dict[int, set[int]] = {number: set() for number in below}
    for lower, higher in order:
        beside[lower].add(higher)
        beside[higher].add(lower)
    for number in ranked:
        # Above all that it touches and that comes before it.
        first = 1 + max((int(media[other]) for other in beside[number]), default=-1)
        own = next(m for m in solids[number].mesh.materials if m.interaction == Interaction.DIELECTRIC)
        alike = (m for m in range(first, len(materials)) if _inside(materials[m]) == _inside(own))
        medium = next(alike, len(materials))
        if medium >= MOST_MEDIA:
            break
        if medium == len(materials):
            materials.append(own)
        media[number] = medium
    taking_part = [solids[number] for number in below]
    low, high = (np.array([solid.box[side] for solid in taking_part]) for side in range(2))
    box = np.stack([low.min(axis=0), high.max(axis=0)])
    if any(solid.is_open for solid in taking_part):
        box = np.array([[-np.inf] * 3, [np.inf] * 3])
    return Nesting(media, tuple(materials), box)
