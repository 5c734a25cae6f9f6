"""Scenes as people bring them: bodies that swing, fall, bounce and spin by transforms, floors with steps and edges.

Each is one frame whose shutter is open for all of it. Unlike :mod:`.solids`, whose vertices go straight, bodies move by
xformOps with time samples, so that what turns goes along arcs. The truth of those that glide is brute force, that of
some that turn brute force in pieces of the shutter, that of the others many instants
(``scripts/benchmarks/strangers.py``). The camera is orthographic, looks straight down, and
stands below what is specular.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pxr import Gf, Usd, UsdGeom

from . import shapes
from .brute_force.description import DIELECTRIC, DIFFUSE, MIRROR, Camera, Light, Mesh, Scene
from .stage import FRAME, write_stage

PIXELS = 64
Vector = tuple[float, float, float]
# An xformOp ("translate", "scale", "rotateX", "rotateY" or "rotateZ") with its values by time in the shutter, 0 … 1.
Op = tuple[str, dict[float, Vector | float]]
GLIDE: list[Op] = [("translate", {0.0: (-0.15, 0.0, 1.0), 1.0: (0.15, 0.0, 1.0)})]


@dataclass(frozen=True, eq=False)
class Stranger:
    """A scene whose meshes stand in the coordinates of their bodies.

    Attributes:
        scene: Meshes, lights and camera.
        moves: The xformOps of meshes by their prim path, the outermost first.
    """

    scene: Scene
    moves: dict[str, Sequence[Op]]

    @property
    def glides(self) -> bool:
        """Whether all vertices go straight, as brute force takes them."""
        ops = [op for ops in self.moves.values() for op in ops]
        return all(len(way) == 1 or (kind == "translate" and set(way) == {0.0, 1.0}) for kind, way in ops)

    def pieces(self, count: int) -> list[Scene]:
        """The scene in equal pieces of the shutter, in each of which vertices go straight from where they are as it
        opens to where they are as it closes, as brute force takes them."""
        return [self._over(number / count, (number + 1) / count) for number in range(count)]

    def _over(self, opens: float, closes: float) -> Scene:
        meshes = []
        for mesh in self.scene.meshes:
            own = [mesh.points, mesh.normals]
            for place, values in enumerate(own):
                if values is not None:
                    ends = ((1.0 - s) * values[0] + s * values[1].astype(np.float64) for s in (opens, closes))
                    moved = zip(ends, (opens, closes), strict=True)
                    ops = self.moves.get(mesh.name, ())
                    own[place] = tuple(_moved(end, ops, time, place == 1) for end, time in moved)
            meshes.append(replace(mesh, points=own[0], normals=own[1]))
        return replace(self.scene, meshes=tuple(meshes), view_is_clear=False)


def _moved(values: np.ndarray, ops: Sequence[Op], time: float, normals: bool) -> np.ndarray:
    """Points, or normals, of a body [n, 3] where its xformOps put them at a time, 0 … 1."""
    for kind, samples in reversed(ops):
        times = sorted(samples)
        tracks = np.array([np.atleast_1d(samples[at]) for at in times], dtype=float).T
        value = np.array([np.interp(time, times, track) for track in tracks])
        if kind == "translate":
            values = values if normals else values + value
        elif kind == "scale":
            values = values / value if normals else values * value
        else:
            axis = tuple(float(letter == kind[-1]) for letter in "XYZ")
            values = values @ shapes.rotation(axis, float(value[0])).T
    return values / np.linalg.norm(values, axis=1, keepdims=True) if normals else values


def write(name: str, folder: Path) -> Path:
    """Writes the stage of a scene into a folder; its path."""
    stranger = STRANGERS[name]()
    path = write_stage(stranger.scene, folder / f"{name}.usdc")
    stage = Usd.Stage.Open(str(path))
    for prim, ops in stranger.moves.items():
        body = UsdGeom.Xformable(stage.GetPrimAtPath(prim))
        for kind, samples in ops:
            op = getattr(body, f"Add{kind[0].upper()}{kind[1:]}Op")()
            for time, value in samples.items():
                op.Set(value if np.isscalar(value) else Gf.Vec3d(*value) if kind == "translate" else Gf.Vec3f(*value),
                       Usd.TimeCode(FRAME + time))  # fmt: skip
    stage.Save()
    return path


def pendulum_lens() -> Stranger:
    """A lens at the end of a rod swings by 40 degrees."""
    points, triangles, normals = shapes.lens(0.4, 0.9)
    lens = _mesh("Lens", (points - [0.0, 0.0, 0.9], triangles, normals))
    swing: list[Op] = [("translate", {0.0: (0.0, 0.0, 1.8)}), ("rotateY", {0.0: -10.0, 1.0: 30.0})]
    return _stranger("pendulum-lens", [_floor(), lens], [_sun(0.0)], {lens.name: swing}, (-0.1, 0.0, 0.2), 1.8)


def mirror_ring_turning() -> Stranger:
    """A mirror ring turns by 90 degrees about a horizontal axis under a lamp."""
    points, triangles, normals = shapes.ring(0.5, 0.3)
    ring = _mesh("Ring", (points - [0.0, 0.0, 0.15], triangles, normals), MIRROR, tint=0.9)
    moves: list[Op] = [("translate", {0.0: (0.0, 0.0, 0.8)}), ("rotateY", {0.0: 5.0, 1.0: 95.0})]
    lamp = _lamp((0.6, 0.3, 3.0))
    return _stranger("mirror-ring-90", [_floor(), ring], [lamp], {ring.name: moves}, (0.0, 0.0, 0.15), 2.4)


def plates_sliding() -> Stranger:
    """Two stacks of tilted glass plates slide over each other and apart."""
    meshes, moves = [_floor()], {}
    for number in range(4):
        plate = _mesh(f"Plate{number}", shapes.box((0.7, 0.5, 0.08)))
        way = 0.3 if number % 2 else -0.3
        x, y = 0.35 * (number - 1.5), 0.2 * (-1) ** number
        meshes.append(plate)
        places = {0.0: (x - 0.5 * way, y, 0.6 + 0.15 * number), 1.0: (x + 0.5 * way, y, 0.6 + 0.15 * number)}
        moves[plate.name] = [("translate", places), ("rotateY", {0.0: 25.0 - 15.0 * number})]
    return _stranger("plates-sliding", meshes, [_sun(10.0)], moves, (0.05, 0.0, 0.2), 2.0)


def falling_glass() -> Stranger:
    """An empty tumbler falls and turns over by 35 degrees."""
    glass = _mesh("Tumbler", tumbler(0.3, 0.7, 0.05))
    moves: list[Op] = [
        ("translate", {0.0: (-0.1, 0.0, 1.1), 0.5: (0.0, 0.0, 1.0), 1.0: (0.1, 0.0, 0.8)}),
        ("rotateX", {0.0: 20.0}),
        ("rotateY", {0.0: 30.0, 1.0: 65.0}),
    ]
    return _stranger("falling-glass", [_floor(), glass], [_sun(15.0)], {glass.name: moves}, (0.15, 0.0, 0.1), 2.0)


def ball_bouncing() -> Stranger:
    """A glass ball comes down aslant and goes up again within the shutter; its bounce is no half of it."""
    ball = _mesh("Ball", shapes.sphere())
    places = {0.0: (-0.15, 0.0, 0.75), 0.4: (0.0, 0.0, 0.5), 1.0: (0.15, 0.0, 0.8)}
    moves: list[Op] = [("translate", places), ("scale", {0.0: (0.4,) * 3})]
    return _stranger("ball-bouncing", [_floor(), ball], [_lamp((0.3, 0.2, 3.5))], {ball.name: moves}, (0, 0, 0.05), 1.6)


def curtain_waving() -> Stranger:
    """A hanging sheet of glass, waved and as thick as a finger, whose waves run sideways, in a sun that stands low."""

    def sheet(phase: float) -> tuple[np.ndarray, np.ndarray]:
        across, up = np.meshgrid(np.linspace(-0.8, 0.8, 97), np.linspace(0.0, 1.2, 13))
        bow = 0.06 * np.cos(2.0 * np.pi * across / 0.4 + phase) * (1.3 - up)
        front = np.stack([bow - 0.02, across, up], axis=-1).reshape(-1, 3)
        back = np.stack([bow + 0.02, across, up], axis=-1).reshape(-1, 3)
        return np.concatenate([front, back]), _slab_triangles(13, 97)

    (start, triangles), (end, _) = sheet(0.0), sheet(0.9)
    curtain = Mesh("/World/Curtain", (start.astype(np.float32), end.astype(np.float32)), triangles, DIELECTRIC, 1.5)
    moves: list[Op] = [("translate", {0.0: (0.0, 0.0, 0.3)})]
    sun = Light("/World/Sun", 1.0, direction=np.array([0.8, 0.1, -0.6]) / np.linalg.norm([0.8, 0.1, -0.6]))
    return _stranger("curtain-waving", [_floor(), curtain], [sun], {curtain.name: moves}, (1.2, 0.0, 0.25), 2.2)


def lens_over_stairs() -> Stranger:
    """A lens glides across five steps."""
    return _over("lens-over-stairs", _stairs(5, 0.3, 0.1), _round_lens())


def lens_over_louvres() -> Stranger:
    """A lens glides over slats that stand aslant with gaps between."""
    slats = []
    for number in range(7):
        points, triangles = shapes.box((0.16, 2.4, 0.02))
        points = points @ shapes.rotation((0.0, 1.0, 0.0), -35.0).T + [0.22 * (number - 3), 0.0, 0.15]
        slats.append(_mesh(f"Slat{number}", (points, triangles), DIFFUSE))
    return _over("lens-over-louvres", [_floor(), *slats], _round_lens())


def lens_over_a_box() -> Stranger:
    """A lens glides over a box on the floor."""
    points, triangles = shapes.box((0.4, 0.5, 0.25))
    points = points @ shapes.rotation((0.0, 0.0, 1.0), 25.0).T + [0.05, 0.0, 0.1251]
    return _over("lens-over-a-box", [_floor(), _mesh("Box", (points, triangles), DIFFUSE)], _round_lens())


def rod_over_a_fence() -> Stranger:
    """A cylindrical lens turns and glides over a fence of upright pickets."""
    pickets = []
    for number in range(9):
        points, triangles = shapes.box((0.05, 0.12, 0.3))
        points = shapes.moved(points, (0.0, 0.22 * (number - 4), 0.1501))
        pickets.append(_mesh(f"Picket{number}", (points, triangles), DIFFUSE))
    moves: list[Op] = [*GLIDE, ("rotateZ", {0.0: 60.0, 1.0: 70.0})]
    return _over("rod-over-a-fence", [_floor(), *pickets], _mesh("Rod", rod(0.25, 1.2)), moves)


def hollow_lens_over_stairs() -> Stranger:
    """A lens of air in a block of glass, which spreads light, glides across steps."""
    return _over("hollow-lens-over-stairs", _stairs(5, 0.3, 0.1), _mesh("Lens", concave_lens(0.45, 0.9, 0.06)))


def stick_over_a_bowl() -> Stranger:
    """A stick, narrower than a sixth of its way, passes above a lens whose light falls into a hollow half ball."""
    points, triangles, normals = shapes.sphere(128, 96)
    lower = triangles[np.all(points[triangles][:, :, 2] < 1e-6, axis=1)][:, ::-1]
    bowl = _mesh("Bowl", (shapes.moved(0.8 * points, (0.0, 0.0, 0.9)), lower, -normals), DIFFUSE)
    tilt = shapes.rotation((0.0, 1.0, 0.0), 10.0).T
    points, triangles, normals = shapes.lens(0.45, 0.9)
    lens = _mesh("Lens", (shapes.moved(points @ tilt, (0.0, 0.0, 1.5)), triangles, normals @ tilt))
    points, triangles = shapes.box((0.08, 2.0, 0.08))
    stick = _mesh("Stick", (points @ shapes.rotation((0.0, 0.0, 1.0), 15.0).T, triangles), DIFFUSE)
    way: list[Op] = [("translate", {0.0: (-0.3, 0.0, 2.1), 1.0: (0.2, 0.1, 2.1)})]
    meshes = [_floor(), bowl, lens, stick]
    return _stranger("stick-over-a-bowl", meshes, [_sun(8.0)], {stick.name: way}, (0.0, 0.0, 1.15), 1.4)


def mirror_beside_a_dome() -> Stranger:
    """A hollow mirror turns by 30 degrees: its light goes over a half ball and leaves the scene before mid shutter."""
    points, triangles, normals = shapes.sphere()
    dome = _mesh("Dome", (shapes.moved(0.5 * points, (0.0, 0.0, 0.1)), triangles, normals), DIFFUSE)

    def hollow(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return 0.25 * (x**2 + y**2), 0.5 * x, 0.5 * y

    mirror = _mesh("Mirror", shapes.sheet(0.9, 24, hollow), MIRROR, tint=0.9)
    turn: list[Op] = [("translate", {0.0: (1.1, 0.0, 0.7)}), ("rotateY", {0.0: -75.0, 1.0: -45.0})]
    sun = Light("/World/Sun", 1.0, direction=np.array([0.8, 0.0, -1.0]) / np.linalg.norm([0.8, 0.0, -1.0]))
    return _stranger("mirror-beside-a-dome", [_floor(), dome, mirror], [sun], {mirror.name: turn}, (0.1, 0.0, 3.0), 1.6)


def prism_spinning() -> Stranger:
    """A glass prism spins by 200 degrees about a slanting axis."""
    prism = _mesh("Prism", shapes.prism(0.5, 0.9))
    turn: list[Op] = [("rotateZ", {0.0: 0.0, 1.0: 200.0}), ("rotateX", {0.0: 20.0})]
    moves: list[Op] = [("translate", {0.0: (0.0, 0.0, 0.8)}), *turn]
    return _stranger("prism-200", [_floor(), prism], [_sun(20.0)], {prism.name: moves}, (0.1, 0.0, 0.25), 2.4)


def paddle_under_a_blob() -> Stranger:
    """A board turns by 50 degrees in the light of a bumpy glass ball that rests: what is lit turns, not what bends."""
    points, triangles, normals = shapes.blob()
    blob = _mesh("Blob", (shapes.moved(0.5 * points, (0.0, 0.0, 1.5)), triangles, normals))
    paddle = _mesh("Paddle", shapes.box((1.0, 0.5, 0.04)), DIFFUSE)
    turn: list[Op] = [("translate", {0.0: (0.0, 0.0, 0.6)}), ("rotateY", {0.0: -25.0, 1.0: 25.0})]
    meshes = [_floor(), blob, paddle]
    return _stranger("paddle-under-a-blob", meshes, [_sun(0.0)], {paddle.name: turn}, (0.0, 0.0, 0.95), 1.6)


def cloth_under_a_lens() -> Stranger:
    """A cloth waves in the light of a lens that rests, whose focus it meets now above and now below."""

    def cloth(phase: float) -> shapes.Shape:
        def height(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            rows, columns = 6.0 * x + phase, 4.0 * y - 0.5 * phase
            slopes = 0.72 * np.cos(rows) * np.cos(columns), -0.48 * np.sin(rows) * np.sin(columns)
            return 0.12 * np.sin(rows) * np.cos(columns), *slopes

        return shapes.sheet(2.4, 64, height)

    (start, triangles, first), (end, _, last) = cloth(0.0), cloth(1.4)
    ends = [tuple(np.float32(value) for value in pair) for pair in ((start, end), (first, last))]
    sheet = Mesh("/World/Cloth", ends[0], triangles.astype(np.int32), DIFFUSE, normals=ends[1])
    points, triangles, normals = shapes.lens(0.6, 0.9)
    lens = _mesh("Lens", (shapes.moved(points, (0.0, 0.0, 0.9)), triangles, normals))
    return _stranger("cloth-under-a-lens", [sheet, lens], [_sun(15.0)], {}, (0.15, 0.0, 0.5), 1.6)


def slab_under_a_lens() -> Stranger:
    """A slab of glass slides into the converging light of a lens that rests."""
    points, triangles, normals = shapes.lens(0.5, 1.0)
    lens = _mesh("Lens", (shapes.moved(points, (0.0, 0.0, 1.3)), triangles, normals))
    points, triangles = shapes.box((0.7, 0.9, 0.1))
    slab = _mesh("Slab", (points @ shapes.rotation((0.0, 0.0, 1.0), 20.0).T, triangles))
    way: list[Op] = [("translate", {0.0: (-0.65, 0.0, 0.45), 1.0: (-0.15, 0.0, 0.45)})]
    meshes = [_floor(), lens, slab]
    return _stranger("slab-under-a-lens", meshes, [_sun(6.0)], {slab.name: way}, (0.1, 0.0, 0.3), 1.4)


STRANGERS: dict[str, Callable[[], Stranger]] = {
    "pendulum-lens": pendulum_lens,
    "mirror-ring-90": mirror_ring_turning,
    "plates-sliding": plates_sliding,
    "falling-glass": falling_glass,
    "ball-bouncing": ball_bouncing,
    "curtain-waving": curtain_waving,
    "lens-over-stairs": lens_over_stairs,
    "lens-over-louvres": lens_over_louvres,
    "lens-over-a-box": lens_over_a_box,
    "rod-over-a-fence": rod_over_a_fence,
    "hollow-lens-over-stairs": hollow_lens_over_stairs,
    "stick-over-a-bowl": stick_over_a_bowl,
    "mirror-beside-a-dome": mirror_beside_a_dome,
    "prism-200": prism_spinning,
    "paddle-under-a-blob": paddle_under_a_blob,
    "cloth-under-a-lens": cloth_under_a_lens,
    "slab-under-a-lens": slab_under_a_lens,
}


def tumbler(radius: float, height: float, wall: float, around: int = 96) -> shapes.Shape:
    """An empty tumbler about z, its middle at the origin; each smooth part has vertices and normals of its own."""
    low, inner = -0.5 * height, radius - wall
    floor = low + 2.0 * wall
    outline = [
        ((0.0, low), (radius, low)),
        ((radius, low), (radius, -low)),
        ((radius, -low), (inner, -low)),
        ((inner, -low), (inner, floor)),
        ((inner, floor), (0.0, floor)),
    ]
    return _revolved(outline, around)


def concave_lens(aperture: float, radius: float, thickness: float) -> shapes.Shape:
    """A biconcave lens about z: two spherical hollows, ``thickness`` apart in the middle, and a rim."""
    tilts = np.linspace(0.0, np.arcsin(aperture / radius), 25)
    top = np.stack([radius * np.sin(tilts), 0.5 * thickness + radius * (1.0 - np.cos(tilts))], axis=1)
    slopes = np.stack([-np.sin(tilts), np.cos(tilts)], axis=1)
    down = np.array([1.0, -1.0])
    rim = [(tuple(top[-1] * down), tuple(top[-1]))]
    points, triangles, normals = _revolved(rim, 96)
    parts = [(points, triangles, normals)]
    for profile, tips in ((top[::-1], slopes[::-1]), (top * down, slopes * down)):
        parts.append(_swept(profile, tips, 96))
    return _joined(parts)


def rod(radius: float, length: float, around: int = 128) -> shapes.Shape:
    """A cylinder along y about the origin."""
    outline = [
        ((0.0, -0.5 * length), (radius, -0.5 * length)),
        ((radius, -0.5 * length), (radius, 0.5 * length)),
        ((radius, 0.5 * length), (0.0, 0.5 * length)),
    ]
    points, triangles, normals = _revolved(outline, around)
    turn = shapes.rotation((1.0, 0.0, 0.0), 90.0).T
    return points @ turn, triangles, normals @ turn


def _revolved(outline: Sequence[tuple[tuple[float, float], tuple[float, float]]], around: int) -> shapes.Shape:
    """What straight pieces of an outline (distance from z, height), outside to their right, sweep around z."""
    parts = []
    for a, b in outline:
        along = np.subtract(b, a) / np.hypot(*np.subtract(b, a))
        tips = np.array([[along[1], -along[0]]] * 2)
        parts.append(_swept(np.array([a, b]), tips, around))
    return _joined(parts)


def _swept(profile: np.ndarray, slopes: np.ndarray, around: int) -> shapes.Shape:
    """A profile [k, 2] (distance from z, height) with its normals [k, 2], swept around z."""
    azimuth = 2.0 * np.pi * np.arange(around) / around
    cosines, sines = np.cos(azimuth), np.sin(azimuth)

    def turned(values: np.ndarray) -> np.ndarray:
        out, up = values[:, :1], np.repeat(values[:, 1:], around, axis=1)
        return np.stack([out * cosines, out * sines, up], axis=-1).reshape(-1, 3)

    low = (np.arange(len(profile) - 1)[:, None] * around + np.arange(around)).ravel()
    next_low = (np.arange(len(profile) - 1)[:, None] * around + (np.arange(around) + 1) % around).ravel()
    quads = np.stack([low, next_low, next_low + around, low + around], axis=1)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    points = turned(profile)
    corners = points[triangles]
    flat = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) > 1e-12
    return points, triangles[flat], turned(slopes)


def _joined(parts: Sequence[shapes.Shape]) -> shapes.Shape:
    starts = np.cumsum([0, *(len(part[0]) for part in parts)])
    triangles = [part[1] + start for part, start in zip(parts, starts[:-1], strict=True)]
    return np.concatenate([part[0] for part in parts]), np.concatenate(triangles), np.concatenate([p[2] for p in parts])


def _slab_triangles(rows: int, columns: int) -> np.ndarray:
    """The closed surface between two grids of points, of which the first looks towards −x."""
    count = rows * columns
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).reshape(-1, 1)
    front = corner + np.array([0, columns, columns + 1, 1])
    quads = [front, front[:, ::-1] + count]
    i, j = np.arange(columns - 1), np.arange(rows - 1) * columns
    for a, b in (
        (i, i + 1),
        (i + 1 + (rows - 1) * columns, i + (rows - 1) * columns),
        (j + columns, j),
        (j + columns - 1, j + 2 * columns - 1),
    ):
        quads.append(np.stack([a, b, b + count, a + count], axis=1))
    quads = np.concatenate(quads)
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32)


def _over(name: str, ground: Sequence[Mesh], glass: Mesh, moves: Sequence[Op] = ()) -> Stranger:
    """Glass that glides by .3 above what is not flat, in a sun that stands aslant."""
    return _stranger(name, [*ground, glass], [_sun(10.0)], {glass.name: moves or GLIDE}, (0.1, 0.0, 0.6), 1.6)


def _round_lens() -> Mesh:
    return _mesh("Lens", shapes.lens(0.45, 0.9))


def _stairs(count: int, depth: float, height: float) -> list[Mesh]:
    """Steps that rise along x, in one mesh, and the floor around them."""
    parts = []
    for number in range(count):
        box, triangles = shapes.box((depth * (count - number), 2.4, height))
        x = 0.5 * depth * number
        parts.append((shapes.moved(box, (x, 0.0, height * (number + 0.5))), triangles))
    points, triangles, _ = _joined([(*part, part[0]) for part in parts])
    return [_floor(), _mesh("Stairs", (points, triangles), DIFFUSE)]


def _mesh(name: str, shape: tuple[np.ndarray, ...], kind: int = DIELECTRIC, tint: float = 1.0) -> Mesh:
    points = shape[0].astype(np.float32)
    normals = (shape[2].astype(np.float32),) * 2 if len(shape) == 3 else None
    return Mesh(f"/World/{name}", (points,) * 2, shape[1].astype(np.int32), kind, 1.5, tint, normals)


def _floor() -> Mesh:
    return _mesh("Floor", shapes.rectangle(10.0, 10.0), DIFFUSE)


def _sun(degrees: float) -> Light:
    angle = np.radians(degrees)
    return Light("/World/Sun", 1.0, direction=np.array([np.sin(angle), 0.0, -np.cos(angle)]))


def _lamp(position: Vector) -> Light:
    return Light("/World/Lamp", 10.0, position=(np.array(position),) * 2)


def _stranger(
    name: str, meshes: Sequence[Mesh], lights: Sequence[Light], moves: dict[str, Sequence[Op]], eye: Vector, size: float
) -> Stranger:
    camera = Camera((np.array(eye, dtype=float),) * 2, np.eye(3), size, PIXELS, PIXELS)
    return Stranger(Scene(name, tuple(meshes), tuple(lights), camera), moves)
