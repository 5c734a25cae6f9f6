"""Photons of a scene written down in code: what the renderer does for a frame, up to the photon record."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tpdwarp.device import Launcher
from tpdwarp.photons.energy import EnergyAccount
from tpdwarp.photons.lattice_shape import turned
from tpdwarp.photons.lattices import EmissionPlan, plan_emission
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.photons.record import PhotonRecord, record_of
from tpdwarp.photons.tracing import SMALLEST_BRANCH, trace_photons
from tpdwarp.scene.description import LightAtShutter, LightKind, MeshAtShutter, SceneAtShutter, Shutter
from tpdwarp.scene.device.geometry import geometry_of
from tpdwarp.scene.device.textures import TextureStore
from tpdwarp.scene.nesting import nesting_of
from tpdwarp.scene.normalization import Normalization
from tpdwarp.scene.requirements import requirements_of

SHUTTER = Shutter(3, 3, 5)
EPS = 2.0**-24
"""Half a unit in the last place of a float32 near one: the largest relative error of one operation."""


class Written:
    """A scene source that is a function of the shutter, or one scene for all shutters."""

    file = "written.usda"

    def __init__(
        self, scene: SceneAtShutter | Callable[[Shutter], SceneAtShutter], references: Sequence[float] = (4.0,)
    ) -> None:
        self._scene, self._references = scene, references

    def at(self, shutter: Shutter) -> SceneAtShutter:
        return self._scene(shutter) if callable(self._scene) else self._scene

    def reference_shutters(self) -> list[Shutter]:
        return [Shutter.still(time) for time in self._references]

    def motion_breaks(self, shutter: Shutter) -> list[float]:
        return []


@dataclass(frozen=True, eq=False)
class Traced:
    """Photons of one scene, where they come from, and where the flux went."""

    scene: SceneAtShutter
    photons: PhotonRecord
    energy: EnergyAccount
    plan: EmissionPlan
    map: PhotonMap

    @cached_property
    def masks(self) -> np.ndarray:
        """Which of the branching interactions reflected, a bit each, shape [n]."""
        return self.photons.ids // self.plan.id_count

    @cached_property
    def steps(self) -> np.ndarray:
        """A lattice step in u and v of the only lattice of a distant light, world vectors as columns, [3, 2]."""
        (light,), (lattice,) = self.scene.lights, self.plan.lattices
        return turned(light.axes, lattice.turn)[:2].T * (np.array(lattice.step) / self.plan.normalization.scale)

    def stretch(self) -> np.ndarray:
        """∂(x, y)/∂(x0, y0) on a horizontal receiver under a vertical distant light, shape [n, 2, 2]."""
        columns = np.stack([self.photons.dxdu[:, :2], self.photons.dxdv[:, :2]], axis=2)
        return columns @ np.linalg.inv(self.steps[:2])

    def origins(self) -> np.ndarray:
        """Where the photons of a distant light cross the plane through the origin across the light, [n, 3]."""
        return emission_of(self)[0]

    def pick(self, chosen: np.ndarray) -> PhotonRecord:
        """The photons of a mask or of indices."""
        return self.photons.rows(chosen)


def traced(
    scene: SceneAtShutter | Written,
    photons: int = 1024,
    *,
    anchor: str = "surface",
    shutter: Shutter = SHUTTER,
    threads: int = 1,
    jittered: bool = False,
    seed: int = 0,
    smallest_branch: float = SMALLEST_BRANCH,
    bounces: int | None = None,
    place: tuple[float, float] | None = None,
    recording: bool = False,
    **compiled: bool,
) -> Traced:
    """Traces about ``photons`` photons through a scene.

    Args:
        place: The place on lights with extent that they come from; None for all of them.
        recording: Whether the map holds the vertices of paths.
        **compiled: Requirements that the kernel is compiled for, whatever the scene has, so that tests share it.
    """
    source = scene if isinstance(scene, Written) else Written(scene)
    here = source.at(shutter)
    launcher, needs = Launcher("cpu", threads), replace(requirements_of(here, bounces), **compiled)
    normalization = Normalization.of(source.at(source.reference_shutters()[0]))
    plan = plan_emission(source, photons, normalization)
    geometry = geometry_of(here, normalization, launcher, with_motions=needs.photon_motion)
    textures = None
    if needs.material_arrays:
        nesting = nesting_of(here)
        media = () if nesting is None else nesting.materials
        scale, power = normalization.scale, normalization.power
        textures = TextureStore(launcher).arrays(here.meshes, geometry.materials, scale, power, media)
    photon_map, energy = trace_photons(
        here,
        geometry,
        plan,
        needs,
        launcher,
        riding=anchor == "surface",
        jittered=jittered,
        seed=seed,
        smallest_branch=smallest_branch,
        place=place,
        textures=textures,
        recording=recording,
    )
    return Traced(here, record_of([(photon_map, plan)], geometry.paths), energy, plan, photon_map)


def scene_of(
    meshes: Sequence[MeshAtShutter], *lights: LightAtShutter, shutter: Shutter = SHUTTER
) -> SceneAtShutter:
    """A scene without a camera."""
    return SceneAtShutter(shutter, tuple(meshes), lights)


def axes_along(direction: Sequence[float], up: Sequence[float] = (0, 1, 0)) -> np.ndarray:
    """Axes (rows) of a light that shines along ``direction``; y is as near ``up`` as it can be."""
    z = -np.asarray(direction, dtype=np.float64)
    z /= np.linalg.norm(z)
    x = np.cross(up, z)
    x /= np.linalg.norm(x)
    return np.array([x, np.cross(z, x), z])


def sun(direction: Sequence[float] = (0, 0, -1), irradiance: float = 1.0, path: str = "/sun") -> LightAtShutter:
    """A white distant light that shines along ``direction``."""
    return LightAtShutter(path, LightKind.DISTANT, (irradiance,) * 3, axes=axes_along(direction))


def turning_sun(first: Sequence[float], last: Sequence[float]) -> LightAtShutter:
    """A distant light that shines along ``first`` at shutter open and along ``last`` at its close."""
    a, b = axes_along(first), axes_along(last)
    x, _, z = 0.5 * (a + b)
    z /= np.linalg.norm(z)
    x = x - z * (x @ z)
    x /= np.linalg.norm(x)
    return LightAtShutter(
        "/sun", LightKind.DISTANT, (1.0,) * 3, axes=np.array([x, np.cross(z, x), z]), axes_motion=b - a
    )


def lamp(
    position: Sequence[float], motion: Sequence[float] = (0, 0, 0), intensity: float = 1.0, path: str = "/lamp"
) -> LightAtShutter:
    """A white point light."""
    return LightAtShutter(
        path,
        LightKind.POINT,
        (intensity,) * 3,
        position=np.asarray(position, dtype=np.float64),
        position_motion=np.asarray(motion, dtype=np.float64),
    )


def emission_of(
    result: Traced, coordinates: np.ndarray | None = None, time: float = 0.0, rows: slice | np.ndarray = slice(None)
) -> tuple[np.ndarray, np.ndarray]:
    """Origins and unit directions [n, 3], in the world and float64, of photons at ``time`` (−½ … ½) in the shutter.

    Args:
        coordinates: Lattice coordinates, shape [n, 2]; None for those of the photons.
        rows: The photons whose lattices are meant.
    """
    photons, plan = result.photons, result.plan
    coordinates = photons.emission[rows] if coordinates is None else coordinates
    cells = photons.ids[rows] % plan.id_count
    origins, directions = np.full((len(cells), 3), np.nan), np.full((len(cells), 3), np.nan)
    lights = {light.path: light for light in result.scene.lights}
    for lattice in plan.lattices:
        mine = (cells >= lattice.first_id) & (cells < lattice.first_id + lattice.wrap[0] * lattice.wrap[1])
        light = lights[lattice.light]
        uv = np.array(lattice.origin) + coordinates[mine] * np.array(lattice.step)
        if light.kind == LightKind.DISTANT:
            axes = turned(light.axes + time * light.axes_motion, lattice.turn)
            centre = np.array(plan.normalization.origin)
            origins[mine] = centre + (uv @ axes[:2] + 10.0 * axes[2]) / plan.normalization.scale
            direction = np.broadcast_to(-axes[2], (int(mine.sum()), 3))
        else:
            origins[mine] = light.position + time * light.position_motion
            direction = np.tan(uv) @ lattice.axes[:2] + lattice.axes[2]
        directions[mine] = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    return origins, directions
