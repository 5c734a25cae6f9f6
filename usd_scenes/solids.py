"""Scenes of moving glass, water, mirrors and boards, for the renderer (as stages) and for the oracle (as arrays).

Each is one frame whose shutter is open for all of it. Vertices and normals are rounded to the float32 that stages
store, at the shutter's opening and closing, and move linearly between (which is what USD means): so both see the
same. The camera is orthographic, looks straight down at the floor z = 0 (or a sphere on the way), and stands below the
glass, where it sees its receiver directly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from . import shapes
from .brute_force.description import DIELECTRIC, DIFFUSE, MIRROR, Camera, Light, Mesh, Scene
from .shapes import rotation
from .stage import write_stage

PIXELS = 96
GLASS = 1.5
WATER = 1.33

Vector = tuple[float, float, float]
# Length, amplitude, heading in degrees.
Wave = tuple[float, float, float]
WAVES: tuple[Wave, ...] = ((0.6, 0.025, 20.0), (0.7, 0.025, 110.0))
WATER_SIZE, WATER_CELLS = 2.4, 104


def write(name: str, folder: Path) -> Path:
    """Writes the stage of a scene into a folder; its path."""
    return write_stage(SCENES[name](), folder / f"{name}.usdc")


def ball_gliding() -> Scene:
    """A glass ball glides by half its radius under a point lamp."""
    return _scene("ball-gliding", [_floor(), _ball()], [_lamp((0.3, 0.2, 4.0), 16.0)], (-0.09, -0.06, 0.3), 1.6)


def ball_rolling() -> Scene:
    """The same ball rolls as far: its vertices go round, its shape only slides (but for the chords)."""
    ball = _ball(degrees=np.degrees(0.5))
    return _scene("ball-rolling", [_floor(), ball], [_lamp((0.3, 0.2, 4.0), 16.0)], (-0.09, -0.06, 0.3), 1.6)


def ball_in_the_sun() -> Scene:
    """A ball glides under parallel light that comes at 20 degrees."""
    ball = _ball(height=0.6)
    return _scene("ball-in-the-sun", [_floor(), ball], [_sun(20.0)], (0.22, 0.0, 0.05), 1.6)


def blob_turning() -> Scene:
    """A bumpy blob turns by 10 degrees."""
    blob = _turning("Blob", shapes.blob(), 0.5, (0.0, 0.0, 0.8), (1.0, 1.0, 2.0), 10.0)
    return _scene("blob-turning", [_floor(), blob], [_sun(0.0)], (0.0, 0.0, 0.1), 1.8)


def cube_turning() -> Scene:
    """A cube with flat faces turns by 5 degrees about a tilted axis."""
    start = rotation((1.0, 0.0, 0.0), 30.0) @ rotation((0.0, 1.0, 0.0), 20.0)
    cube = _turning("Cube", shapes.box((0.6,) * 3), 1.0, (0.0, 0.0, 0.7), (1.0, 2.0, 3.0), 5.0, start)
    return _scene("cube-turning", [_floor(), cube], [_sun(10.0)], (0.12, 0.0, 0.12), 2.0)


def torus_turning(degrees: float = 10.0) -> Scene:
    """A torus turns about a horizontal axis."""
    start = rotation((0.3, 1.0, 0.0), 25.0)
    torus = _turning("Torus", shapes.torus(0.36), 0.45, (0.0, 0.0, 0.8), (1.0, 0.0, 0.0), degrees, start)
    return _scene(f"torus-turning-{degrees:.0f}", [_floor(), torus], [_sun(0.0)], (0.0, 0.0, 0.1), 1.8)


def ball_behind_a_slab() -> Scene:
    """A ball glides below a still slab: two bodies in a row along the light."""
    slab = _still("Slab", shapes.box((1.5, 1.5, 0.12)), (0.0, 0.0, 1.6), DIELECTRIC)
    ball = _ball(radius=0.4, height=0.7)
    return _scene("ball-behind-a-slab", [_floor(), slab, ball], [_sun(5.0)], (0.05, 0.0, 0.2), 1.4)


def prism_turning() -> Scene:
    """A prism turns by 8 degrees about its length; total reflection at one leg ends on the way."""
    start = rotation((0.0, 1.0, 0.0), 1.0)
    prism = _turning("Prism", shapes.prism(0.8, 0.8), 1.0, (0.0, 0.0, 0.6), (0.0, 1.0, 0.0), 8.0, start)
    return _scene("prism-turning", [_floor(), prism], [_sun(0.0)], (0.0, 0.0, 0.2), 2.0)


def waves_over_a_sphere() -> Scene:
    """Crossing waves run over a white sphere that moves; light is seen on the sphere and on the floor beside it."""
    water = _water(WAVES, level=1.6, run=0.125)
    points, triangles, normals = shapes.sphere()
    points = points * 0.45 + [0.0, 0.0, 0.6]
    ends = (shapes.moved(points, (-0.1, 0.0, 0.0)), shapes.moved(points, (0.1, 0.0, 0.0)))
    sphere = _mesh("Sphere", ends, triangles, DIFFUSE, normals=(normals,) * 2)
    meshes = [_floor(), water, sphere]
    return _scene("waves-over-a-sphere", meshes, [_sun(10.0)], (0.0, 0.0, 1.3), 1.6, view_is_clear=False)


def cardioid() -> Scene:
    """A mirror ring on a table, and a lamp that goes round it by 7.5 degrees."""
    points, triangles, normals = shapes.ring(1.0, 0.5)
    ring = _mesh("Ring", (points,) * 2, triangles, MIRROR, normals=(normals,) * 2, tint=0.9)
    ends = [rotation((0.0, 0.0, 1.0), angle) @ [2.2, 0.0, 1.8] for angle in (40.0, 47.5)]
    lamp = Light("/World/Lamp", 13.0, position=(ends[0], ends[1]))
    return _scene("cardioid", [_floor(), ring], [lamp], (0.0, 0.0, 0.6), 2.2)


def camera_through_water() -> Scene:
    """A camera moves through the water, above its floor, under running waves."""
    water = _water(WAVES, level=1.2, run=0.125)
    scene = _scene("camera-through-water", [_floor(), water], [_sun(0.0)], (0.0, 0.0, 0.8), 1.4)
    ends = (np.array([-0.15, -0.1, 0.8]), np.array([0.15, 0.1, 0.8]))
    camera = Camera(ends, scene.camera.axes, scene.camera.size, PIXELS, PIXELS)
    return Scene(scene.name, scene.meshes, scene.lights, camera)


def board_over_water() -> Scene:
    """A board moves over still waves: its shadow's edge sweeps through their caustic."""
    water = _water(WAVES, level=1.0, run=0.0)
    points, triangles = shapes.rectangle(2.0, 4.0)
    ends = (shapes.moved(points, (-1.2, 0.0, 1.5)), shapes.moved(points, (-0.8, 0.0, 1.5)))
    board = _mesh("Board", ends, triangles, DIFFUSE)
    return _scene("board-over-water", [_floor(), water, board], [_sun(0.0)], (0.0, 0.0, 0.5), 1.6)


def board_under_a_lens() -> Scene:
    """A board moves under a still lens: it cuts off converging light."""
    lens = _still("Lens", shapes.lens(0.5, 1.2), (0.0, 0.0, 0.7), DIELECTRIC)
    points, triangles = shapes.rectangle(1.0, 2.0)
    ends = (shapes.moved(points, (-0.6, 0.0, 0.35)), shapes.moved(points, (-0.4, 0.0, 0.35)))
    board = _mesh("Board", ends, triangles, DIFFUSE)
    return _scene("board-under-a-lens", [_floor(), lens, board], [_sun(0.0)], (0.0, 0.0, 0.2), 0.6)


def two_lights(ratio: float) -> Scene:
    """A lamp's caustic through a lens that a roof keeps the sun from, while the sun lights a ball elsewhere."""
    points, triangles, normals = shapes.lens(0.4, 0.9)
    points = shapes.moved(points, (-3.0, 0.0, 0.8))
    ends = (shapes.moved(points, (0.0, -0.08, 0.0)), shapes.moved(points, (0.0, 0.08, 0.0)))
    lens = _mesh("Lens", ends, triangles, DIELECTRIC, normals=(normals,) * 2)
    roof = _still("Roof", shapes.rectangle(2.4, 2.4), (-3.0, 0.0, 2.2), DIFFUSE)
    wall_points, wall_triangles = shapes.rectangle(2.0, 8.0)
    upright = shapes.moved(wall_points @ rotation((0.0, 1.0, 0.0), 90.0).T, (0.0, 0.0, 1.0))
    wall = _mesh("Wall", (upright,) * 2, wall_triangles, DIFFUSE)
    ball = _ball(radius=0.4, height=0.8, x=3.0)
    lamp = Light("/World/Lamp", 1.0, position=(np.array([-3.0, 0.1, 1.9]),) * 2, aim=("/World/Lens",), share=15.0)
    sun = Light("/World/Sun", ratio, direction=np.array([0.0, 0.0, -1.0]), aim=("/World/Ball",), share=1.0)
    meshes = [_floor(16.0), lens, roof, wall, ball]
    return _scene(f"two-lights-{ratio:.0f}", meshes, [lamp, sun], (-3.0, 0.0, 0.3), 1.2)


def folded_wave() -> Scene:
    """Still crossing waves whose light has folded before it reaches the floor."""
    water = _water([(0.65, 0.05, 20.0), (0.8, 0.05, 110.0)], level=1.6, run=0.0)
    return _scene("folded-wave", [_floor(), water], [_sun(5.0)], (0.14, 0.0, 1.2), 1.4)


# The most telling first: truths are made in this order.
SCENES: dict[str, Callable[[], Scene]] = {
    "ball-gliding": ball_gliding,
    "cube-turning": cube_turning,
    "torus-turning-10": torus_turning,
    "torus-turning-45": lambda: torus_turning(45.0),
    "blob-turning": blob_turning,
    "ball-behind-a-slab": ball_behind_a_slab,
    "ball-rolling": ball_rolling,
    "prism-turning": prism_turning,
    "board-over-water": board_over_water,
    "board-under-a-lens": board_under_a_lens,
    "waves-over-a-sphere": waves_over_a_sphere,
    "ball-in-the-sun": ball_in_the_sun,
    "two-lights-100": lambda: two_lights(100.0),
    "two-lights-1000": lambda: two_lights(1000.0),
    "cardioid": cardioid,
    "camera-through-water": camera_through_water,
    "folded-wave": folded_wave,
}


def _scene(
    name: str,
    meshes: Sequence[Mesh],
    lights: Sequence[Light],
    eye: Vector,
    size: float,
    view_is_clear: bool = True,
) -> Scene:
    camera = Camera((np.array(eye),) * 2, np.eye(3), size, PIXELS, PIXELS)
    return Scene(name, tuple(meshes), tuple(lights), camera, view_is_clear)


def _mesh(
    name: str,
    points: tuple[np.ndarray, np.ndarray],
    triangles: np.ndarray,
    interaction: int,
    ior: float = GLASS,
    normals: tuple[np.ndarray, np.ndarray] | None = None,
    tint: float = 1.0,
) -> Mesh:
    rounded = tuple(end.astype(np.float32) for end in points)
    if normals is not None:
        normals = tuple(end.astype(np.float32) for end in normals)
    # Materials store float32 too.
    return Mesh(
        f"/World/{name}",
        rounded,
        triangles.astype(np.int32),
        interaction,
        float(np.float32(ior)),
        float(np.float32(tint)),
        normals,
    )


def _floor(size: float = 10.0) -> Mesh:
    points, triangles = shapes.rectangle(size, size)
    return _mesh("Floor", (points,) * 2, triangles, DIFFUSE)


def _still(name: str, shape: tuple[np.ndarray, ...], center: Vector, interaction: int) -> Mesh:
    normals = (shape[2],) * 2 if len(shape) == 3 else None
    return _mesh(name, (shape[0] + center,) * 2, shape[1], interaction, normals=normals)


def _turning(
    name: str,
    shape: tuple[np.ndarray, ...],
    scale: float,
    center: Vector,
    axis: Vector,
    degrees: float,
    start: np.ndarray | None = None,
) -> Mesh:
    """Glass that turns from ``start`` on by some degrees about an axis through its centre."""
    turns = [rotation(axis, angle) @ (np.eye(3) if start is None else start) for angle in (0.0, degrees)]
    points = tuple(scale * shape[0] @ turn.T + center for turn in turns)
    normals = tuple(shape[2] @ turn.T for turn in turns) if len(shape) == 3 else None
    return _mesh(name, points, shape[1], DIELECTRIC, normals=normals)


def _ball(radius: float = 0.5, height: float = 0.9, x: float = 0.0, degrees: float = 0.0) -> Mesh:
    """A glass ball that glides by 0.25 along x, and rolls by some degrees meanwhile."""
    points, triangles, normals = shapes.sphere()
    # No pole where light focuses.
    turns = [rotation((0.0, 1.0, 0.0), angle) @ rotation((1.0, 0.3, 0.0), 50.0) for angle in (0.0, degrees)]
    centers = [np.array([x + shift, 0.0, height]) for shift in (-0.125, 0.125)]
    ends = tuple(radius * points @ turn.T + center for turn, center in zip(turns, centers, strict=True))
    return _mesh("Ball", ends, triangles, DIELECTRIC, normals=tuple(normals @ turn.T for turn in turns))


def _water(waves: Sequence[Wave], level: float, run: float) -> Mesh:
    """Open water: waves of length, amplitude and heading (degrees) that run by part ``run`` of their length."""

    def surface(time: float) -> Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]:
        def height(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            z, zx, zy = np.full_like(x, level), np.zeros_like(x), np.zeros_like(x)
            for length, amplitude, heading in waves:
                number = 2.0 * np.pi / length
                kx, ky = number * np.cos(np.radians(heading)), number * np.sin(np.radians(heading))
                phase = kx * x + ky * y - 2.0 * np.pi * run * time
                z += amplitude * np.cos(phase)
                zx -= amplitude * kx * np.sin(phase)
                zy -= amplitude * ky * np.sin(phase)
            return z, zx, zy

        return height

    opened, closed = (shapes.sheet(WATER_SIZE, WATER_CELLS, surface(time)) for time in (0.0, 1.0))
    return _mesh("Water", (opened[0], closed[0]), opened[1], DIELECTRIC, WATER, (opened[2], closed[2]))


def _sun(degrees: float) -> Light:
    """Parallel light of 1 W/m², so many degrees from straight down towards +x."""
    angle = np.radians(degrees)
    return Light("/World/Sun", 1.0, direction=np.array([np.sin(angle), 0.0, -np.cos(angle)]))


def _lamp(position: Vector, intensity: float) -> Light:
    return Light("/World/Lamp", intensity, position=(np.array(position),) * 2)
