"""A deforming and a rigidly moving scene that are driven to extremes, and what must hold wherever they are driven."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tests.photons.shapes import ball, floor, glass, mesh, moving, quad, ripples
from tests.photons.traced import EPS, axes_along, sun
from tests.view.scenes import looking_down
from tpdwarp.photons.energy import EnergyAccount
from tpdwarp.photons.record import PhotonRecord
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import Frame, render_frame
from tpdwarp.scene.description import CameraAtShutter, LightAtShutter, LightKind, MeshAtShutter, SceneAtShutter, Shutter
from tpdwarp.settings import Settings

AOVS = ("caustic", "direct", "irradiance", "Z", "N", "P", "motion", "photons")
SETTINGS = Settings(photons=1024, samples=1, threads=2, aovs=AOVS)
SHUTTER = Shutter(0, 0, 1)
STILL = Shutter.still(0.5)
SIZE = 32
GRID = np.linspace(-1, 1, 17)

BALANCE = 1e-4
"""Part of the flux sent that may be missing in the account: sums of float32 fluxes of up to 16 interactions."""
MOST_LOST = 0.01
SAME = 64 * EPS / 0.01
"""How far frames of the same scene may differ, as a part of the brightest pixel: positions known to some ten roundings
of the scene's size, over the narrowest footprints (a hundredth of the scene)."""


def camera(eye=(0.3, -2.0, 2.5), target=(0.0, 0.0, 0.3)) -> CameraAtShutter:
    """A perspective camera above the scene."""
    eye, target = np.asarray(eye, float), np.asarray(target, float)
    return CameraAtShutter("/camera", False, eye, axes_along(target - eye), (-0.6, 0.6, -0.6, 0.6))


def scene(meshes, *lights: LightAtShutter, eye: CameraAtShutter | None = None) -> SceneAtShutter:
    return SceneAtShutter(SHUTTER, tuple(meshes), lights or (sun((0.2, 0.1, -1)),), eye or camera())


def deforming(*lights: LightAtShutter) -> SceneAtShutter:
    """Water that heaves, vertex by vertex, over a floor."""
    return scene([ripples(GRID, GRID, 1.0, 0.04, glass(1.33), True), floor(half=1.5)], *lights)


def rigid(*lights: LightAtShutter) -> SceneAtShutter:
    """A glass ball that flies over a floor."""
    body = moving(ball("/ball", (0.2, 0, 0.5), 0.3, 8, glass()), (0.1, -0.05, 0.03))
    return scene([body, floor(half=1.5)], *lights)


MOTIONS: dict[str, Callable[..., SceneAtShutter]] = {"deforming": deforming, "rigid": rigid}


def slab(direction, ior: float, motion=(0.05, 0.02, 0.03), half: float = 1.0, material=None) -> SceneAtShutter:
    """A flat water surface at z = 1 over a floor, seen from just below it."""
    water = moving(quad("/water", (0, 0, 1), (half, 0, 0), (0, half, 0), material or glass(ior)), motion)
    return scene([water, floor()], sun(direction), eye=looking_down((-2, 2, -2, 2), height=0.6))


def strip(points: np.ndarray, material, motions: np.ndarray) -> MeshAtShutter:
    """Triangles between two rows of points [n, 2, 3] that move by ``motions`` [n, 2, 3]."""
    count = len(points)
    near, far = 2 * np.arange(count - 1), 2 * np.arange(count - 1) + 1
    triangles = np.concatenate([np.stack([near, far, far + 2], 1), np.stack([near, far + 2, near + 2], 1)])
    return mesh("/strip", points.reshape(-1, 3), triangles, material, motions=motions.reshape(-1, 3))


def in_other_units(here: SceneAtShutter, unit: float = 1.0, offset=(0.0, 0.0, 0.0)) -> SceneAtShutter:
    """The same scene, its lengths in other units and moved by ``offset``; irradiances stay."""
    offset = np.asarray(offset, float)

    def placed(mesh: MeshAtShutter) -> MeshAtShutter:
        motions = None if mesh.motions is None else unit * mesh.motions
        return replace(mesh, points=unit * mesh.points + offset, motions=motions)

    def lit(light: LightAtShutter) -> LightAtShutter:
        if light.kind == LightKind.DISTANT:
            return light
        power = tuple(unit**2 * channel for channel in light.power)
        motion = unit * light.position_motion
        return replace(light, position=unit * light.position + offset, position_motion=motion, power=power)

    eye = here.camera
    window = tuple(unit * edge for edge in eye.window) if eye.orthographic else eye.window
    eye = replace(eye, position=unit * eye.position + offset, window=window)
    return replace(here, meshes=tuple(map(placed, here.meshes)), lights=tuple(map(lit, here.lights)), camera=eye)


class Source:
    """A scene that moves on through the frames as its motions, given for one frame, say."""

    file = "written.usda"

    def __init__(self, here: SceneAtShutter) -> None:
        self._scene = here

    def at(self, shutter: Shutter) -> SceneAtShutter:
        exposure, past = shutter.exposure, shutter.middle - SHUTTER.middle

        def standing(mesh: MeshAtShutter) -> MeshAtShutter:
            if mesh.motions is None:
                return mesh
            moved = replace(
                mesh, points=mesh.points + past * mesh.motions, motions=exposure * mesh.motions if exposure else None
            )
            if mesh.normal_motions is None:
                return moved
            turned, turn = mesh.normals + past * mesh.normal_motions, mesh.normal_motions
            return replace(moved, normals=turned, normal_motions=exposure * turn if exposure else None)

        def shining(light: LightAtShutter) -> LightAtShutter:
            position = light.position + past * light.position_motion
            return replace(light, position=position, position_motion=exposure * light.position_motion)

        meshes, lights = map(standing, self._scene.meshes), map(shining, self._scene.lights)
        return replace(self._scene, shutter=shutter, meshes=tuple(meshes), lights=tuple(lights))

    def reference_shutters(self) -> list[Shutter]:
        return [STILL]

    def motion_breaks(self, shutter: Shutter) -> list[float]:
        return []


def render(here, shutter: Shutter = SHUTTER, width: int = SIZE, height: int = SIZE, **changes) -> Frame:
    """A frame of a scene or of a source, after what must hold everywhere was asserted."""
    source = here if hasattr(here, "at") else Source(here)
    most_lost = changes.pop("most_lost", MOST_LOST)
    frame = render_frame(RenderContext(source, replace(SETTINGS, **changes)), shutter, width, height)
    assert_sound(frame, most_lost)
    return frame


def assert_sound(frame: Frame, most_lost: float = MOST_LOST) -> None:
    """No NaN or infinity anywhere, and all flux accounted for."""
    for name, values in frame.channels.items():
        assert np.isfinite(values).all(), name
    assert_photons_finite(frame.photons)
    assert_balanced(frame.energy, most_lost)


def assert_photons_finite(photons: PhotonRecord) -> None:
    for name, values in vars(photons).items():
        if isinstance(values, np.ndarray):
            assert np.isfinite(values).all(), name


def assert_balanced(energy: EnergyAccount, most_lost: float = MOST_LOST) -> None:
    parts = energy.deposited, energy.escaped, energy.absorbed, energy.lost_total
    assert min(parts) >= 0
    assert abs(sum(parts) - energy.sent) <= BALANCE * energy.sent
    assert energy.lost_total <= most_lost * energy.sent


def assert_same_frame(found: Frame, expected: Frame, tolerance: float = SAME, unit: float = 1.0) -> None:
    """Radiances agree within ``tolerance`` of the brightest pixel, lengths (in units of ``found``) likewise."""
    seen = expected.channels["A"] > 0
    for group in ("R", "G", "B", "A", "caustic", "direct", "irradiance", "Z", "motion"):
        names = [name for name in expected.channels if name.split(".")[0] == group]
        ours, theirs = (np.stack([f.channels[name][seen] for name in names]).astype(float) for f in (found, expected))
        scale = unit if group in ("Z", "motion") else 1.0
        np.testing.assert_allclose(ours / scale, theirs, rtol=0, atol=tolerance * np.abs(theirs).max(), err_msg=group)
    np.testing.assert_array_equal(found.channels["A"], expected.channels["A"])
