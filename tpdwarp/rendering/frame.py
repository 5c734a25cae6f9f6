"""One frame, as the method goes: photons, their footprints, what the camera sees, and the film.

    for each part of the exposure that the estimator gives
        look through the camera         direct light goes to the film
        gather at what it sees          light from photons goes to the film
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from tpdwarp.clock import Clock
from tpdwarp.estimators import ESTIMATORS
from tpdwarp.estimators.estimator import IrradianceField, Part
from tpdwarp.footprints.irradiance import Lookup
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.photons.energy import EnergyAccount
from tpdwarp.photons.lattices import EmissionPlan
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.photons.record import LandedPhotons, PhotonRecord
from tpdwarp.rendering.context import RenderContext
from tpdwarp.scene.description import CameraAtShutter, Shutter
from tpdwarp.scene.device.loading import LoadedScene
from tpdwarp.view.camera import camera_of, pixel_size
from tpdwarp.view.film import Film
from tpdwarp.view.queries import CameraView, QueryBatch, SeenPoints


@dataclass
class Traced:
    """Photons of one shutter.

    Attributes:
        landed: The photons that landed.
        energy: Where the flux went [W].
        seconds: Wall time by stage.
    """

    landed: LandedPhotons
    energy: EnergyAccount
    seconds: dict[str, float]

    @property
    def photons(self) -> PhotonRecord:
        """The photons that landed, in scene units."""
        return self.landed.record


@dataclass
class Frame(Traced):
    """A rendered frame.

    Attributes:
        channels: ``R``, ``G``, ``B``, ``A`` and the AOVs asked for, each [height, width] float32, rows from the top.
        camera: The camera that saw it.
    """

    channels: dict[str, np.ndarray]
    camera: CameraAtShutter


class FramePhotons:
    """The photons of all parts of a frame, and the account of their flux."""

    def __init__(self) -> None:
        self.energy = EnergyAccount()
        self._maps: list[tuple[PhotonMap, EmissionPlan]] = []

    def add(self, part: Part) -> None:
        self.energy.add(part.energy)
        self._maps += [(photons, part.plan) for photons in part.maps]

    def landed(self, scenes: list[LoadedScene]) -> LandedPhotons:
        return LandedPhotons(self._maps, scenes[0].geometry.paths)


def trace_frame(context: RenderContext, shutter: Shutter, clock: Clock | None = None) -> Traced:
    """Traces the photons of one shutter; ``clock`` is as for :func:`render_frame`.

    Raises:
        InputError: The scene cannot be used there.
    """
    clock = clock or Clock()
    scenes = context.segmentation.load(shutter, clock)
    photons = FramePhotons()
    for part in ESTIMATORS[context.settings.estimator]().parts(context.tracer, shutter, scenes, None, clock):
        photons.add(part)
    return Traced(photons.landed(scenes), photons.energy, clock.seconds)


def render_frame(
    context: RenderContext, shutter: Shutter, width: int, height: int, clock: Clock | None = None
) -> Frame:
    """Renders one frame of ``width`` × ``height`` pixels.

    Args:
        context: The animation; its source must supply a camera.
        shutter: The exposure.
        clock: Measures the stages; goes on where it stands.

    Raises:
        InputError: The scene cannot be used there.
    """
    clock = clock or Clock()
    settings = context.settings
    scenes = context.segmentation.load(shutter, clock)
    camera = middle_camera(scenes)
    pixel = pixel_of(context, scenes, width, height)
    film = Film(
        width,
        height,
        settings.samples,
        context.normalization,
        camera.exposure_scale,
        settings.aovs,
        scenes[0].geometry.paths,
    )
    photons = FramePhotons()
    for part in ESTIMATORS[settings.estimator]().parts(context.tracer, shutter, scenes, pixel, clock):
        view = CameraView(part.scenes, settings, context.normalization, context.launcher, width, height, clock)
        part.energy.add(expose(film, part.light, view.look(), part.weight, clock))
        photons.add(part)
        # Ten million footprints take more memory than their photons.
        del part
    with clock.stage("film"):
        channels = film.channels()
    return Frame(photons.landed(scenes), photons.energy, clock.seconds, channels, camera)


def middle_camera(scenes: list[LoadedScene]) -> CameraAtShutter:
    """The camera of the segment in the middle of a shutter."""
    return scenes[len(scenes) // 2].scene.camera


def expose(
    film: Film, light: IrradianceField | None, view: Iterable[SeenPoints | QueryBatch], weight: float, clock: Clock
) -> EnergyAccount:
    """Adds to ``film`` what the camera sees: direct light as it is seen, light from photons where it is looked up.

    Args:
        light: The light of photons; None where there is none.
        view: What the camera sees.
        weight: Share of the exposure that the view stands for.

    Returns:
        An account that counts what was not seen as it is.
    """
    account = EnergyAccount()
    for seen in view:
        if isinstance(seen, SeenPoints):
            with clock.stage("view"):
                film.add_view(seen.points, seen.pixels, weight)
                account.add(EnergyAccount(counts=seen.counts()))
        elif light is not None:
            with clock.stage("gather"):
                lookup = Lookup(seen.time, seen.window, seen.moves, film.wants_motion)
                found = light.irradiance(seen.queries, lookup)
                film.add_caustic(seen.pixels, seen.weights, seen.first, found)
    return account


def pixel_of(context: RenderContext, scenes: list[LoadedScene], width: int, height: int) -> PixelSize:
    """What a query stands for in an image of ``width`` × ``height`` pixels over the shutter of ``scenes``."""
    camera = camera_of(middle_camera(scenes), width, height, context.normalization)
    return pixel_size(camera, context.settings.samples)
