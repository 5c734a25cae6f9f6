"""Random small scenes: water, glass and mirrors that move, deform and turn over a floor, under random lights."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st

from tests.photons.moving_scenes import walls
from tests.photons.shapes import MIRROR, ball, box, field, glass, moving, prism, rotation, turning
from tests.photons.traced import Traced, lamp, scene_of, sun, turning_sun
from tpdwarp.scene.description import CameraAtShutter, LightAtShutter, LightKind, MeshAtShutter, SceneAtShutter

# The same examples on every run, as they come: making them smaller takes minutes. Which are rejected or slow is a
# matter of the examples, not of the machine.
law = settings(
    derandomize=True,
    database=None,
    deadline=None,
    max_examples=40,
    suppress_health_check=list(HealthCheck),
    phases=(Phase.explicit, Phase.generate),
)


def numbers(low: float, high: float) -> st.SearchStrategy[float]:
    """Numbers of few digits, so that examples that fail can be read."""
    return st.integers(0, 1000).map(lambda k: low + (high - low) * k / 1000)


def vectors(low: float, high: float) -> st.SearchStrategy[np.ndarray]:
    return st.tuples(*[numbers(low, high)] * 3).map(np.array)


directions = vectors(-1, 1).filter(lambda v: np.linalg.norm(v) > 0.2)
iors = numbers(1.1, 1.8)


@st.composite
def rotations(draw) -> np.ndarray:
    """Rotation matrices, shape [3, 3]."""
    return rotation(draw(directions), draw(numbers(-np.pi, np.pi)))


@st.composite
def water(draw) -> MeshAtShutter:
    """An open, deforming sheet of a random wave, smooth or faceted, about one unit above the floor."""
    k = draw(vectors(-4, 4))
    amplitude, phase, rate = draw(numbers(0.0, 0.06)), draw(numbers(0, 6)), draw(vectors(-0.1, 0.1))
    cells = draw(st.sampled_from((4, 8)))
    # Sides of 11 : 9, whose lattices of light do not run along the diagonals of the mesh.
    x, y = np.linspace(-1.1, 1.1, cells + 1), np.linspace(-0.9, 0.9, cells + 1)

    def level(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return 1.0 + amplitude * np.sin(k[0] * x + k[1] * y + phase)

    def slopes(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        cosine = amplitude * np.cos(k[0] * x + k[1] * y + phase)
        return k[0] * cosine, k[1] * cosine

    sheet = field("/water", x, y, level, slopes if draw(st.booleans()) else None, glass(draw(iors)))
    wobble = np.cos(2 * sheet.points[:, :1] + phase) * rate
    normal_motions = None if sheet.normals is None else np.cross(sheet.normals, wobble)
    return replace(sheet, motions=wobble, normal_motions=normal_motions)


@st.composite
def solid(draw) -> MeshAtShutter:
    """A small closed body of glass or a mirror, that flies and turns."""
    material = draw(st.one_of(iors.map(glass), st.just(MIRROR)))
    centre = (draw(numbers(-0.3, 0.3)), draw(numbers(-0.3, 0.3)), 1.2)
    size = draw(numbers(0.2, 0.35))
    kind = draw(st.sampled_from(("ball", "box", "prism")))
    if kind == "ball":
        body = ball("/body", centre, size, draw(st.integers(2, 5)), material, draw(st.booleans()))
    elif kind == "box":
        body = box("/body", tuple(np.subtract(centre, size)), tuple(np.add(centre, size)), material)
    else:
        body = prism("/body", centre, size, size, material)
    body = turning(body, draw(directions), draw(numbers(-0.3, 0.3)), centre)
    return replace(body, motions=body.motions + draw(vectors(-0.1, 0.1)))


@st.composite
def suns(draw, path: str = "/sun") -> LightAtShutter:
    """Distant lights from above, one in three of them turning."""
    first, last = ((draw(numbers(-0.4, 0.4)), draw(numbers(-0.4, 0.4)), -1.0) for _ in range(2))
    power = draw(vectors(0.2, 3.0))
    light = turning_sun(first, last) if draw(st.integers(0, 2)) == 0 else sun(first)
    return replace(light, path=path, power=tuple(map(float, power)))


@st.composite
def lamps(draw, path: str = "/lamp") -> LightAtShutter:
    """Point lights above everything, moving."""
    position = (draw(numbers(-0.5, 0.5)), draw(numbers(-0.5, 0.5)), draw(numbers(2.6, 3.5)))
    light = lamp(position, draw(vectors(-0.1, 0.1)), path=path)
    return replace(light, power=tuple(map(float, draw(vectors(0.2, 3.0)))))


@st.composite
def scenes(draw, light: st.SearchStrategy[LightAtShutter] | None = None) -> SceneAtShutter:
    """Water, a solid or both in a room that is open at the top, under one light; the floor may move."""
    specular = draw(st.sampled_from((("water",), ("solid",), ("water", "solid"))))
    meshes = [draw(water() if kind == "water" else solid()) for kind in specular]
    if len(meshes) == 2:
        # The body dives.
        meshes[1] = replace(meshes[1], points=meshes[1].points - [0, 0, 0.4])
    floor, *sides = walls()
    if draw(st.booleans()):
        floor = moving(floor, draw(vectors(-0.1, 0.1)))
    return scene_of([*meshes, floor, *sides], draw(light if light is not None else st.one_of(suns(), lamps())))


def with_camera(scene: SceneAtShutter, height: float = 0.1) -> SceneAtShutter:
    """The scene with an orthographic camera that looks down on the floor from below everything else."""
    camera = CameraAtShutter("/camera", True, np.array([0.0, 0.0, height]), np.eye(3), (-1.0, 1.0, -1.0, 1.0))
    return replace(scene, camera=camera)


def brightened(second: LightAtShutter, alone: list[Traced], counts: tuple[int, int]) -> LightAtShutter:
    """The second light, as strong as it must be to get its count of the photons that two lights share by power."""
    a, b = (power_sent(result) / count for result, count in zip(alone, counts, strict=True))
    return replace(second, power=tuple(a / b * channel for channel in second.power))


def lattice_steps(*results: Traced) -> list[tuple[float, ...]]:
    """Sizes of a cell of every lattice of some traces, to 12 digits."""
    steps = (lattice.step for result in results for lattice in result.plan.lattices)
    return [tuple(float(f"{size:.12g}") for size in step) for step in steps]


def power_sent(result: Traced) -> float:
    """Power through the lattices of the only light, as the plan measures it: half as many cells a side as it wraps."""
    (light,) = result.scene.lights
    norm = result.plan.normalization
    unit = norm.scale**2 if light.kind == LightKind.DISTANT else 1.0
    areas = (np.prod(np.multiply(lattice.step, lattice.wrap)) / 4 for lattice in result.plan.lattices)
    return sum(light.power) * sum(areas) / unit
