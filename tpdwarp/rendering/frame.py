"""One frame: photons, footprints, what the camera sees, and the film."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from tpdwarp.estimators import ESTIMATORS
from tpdwarp.estimators.base import Animation, Clock, LoadedScene
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.photons.emission import EmissionPlan
from tpdwarp.photons.record import EnergyAccount, PhotonRecord
from tpdwarp.photons.tracing import PhotonMap, record_of
from tpdwarp.scene.description import CameraAtShutter, SceneSource, Shutter
from tpdwarp.settings import Settings
from tpdwarp.view.film import Film
from tpdwarp.view.queries import Sight, View


@dataclass
class Traced:
    """Photons of one shutter.

    Attributes:
        photons: The photons that landed, in scene units.
        energy: Where the flux went [W].
        seconds: Wall time by stage.
    """

    photons: PhotonRecord
    energy: EnergyAccount
    seconds: dict[str, float]


@dataclass
class Frame(Traced):
    """A rendered frame.

    Attributes:
        channels: ``R``, ``G``, ``B``, ``A`` and the AOVs asked for, each [height, width] float32, rows from the top.
        camera: The camera that saw it.
    """

    channels: dict[str, np.ndarray]
    camera: CameraAtShutter


@lru_cache(maxsize=1)
def _animation(source: SceneSource, settings: Settings) -> Animation:
    return Animation(source, settings)


def trace_frame(source: SceneSource, shutter: Shutter, settings: Settings) -> Traced:
    """Traces the photons of one shutter."""
    clock = Clock()
    animation = _animation(source, settings)
    scenes = animation.load_segments(shutter, clock)
    energy = EnergyAccount()
    maps = []
    for part in ESTIMATORS[settings.estimator]().parts(animation, shutter, scenes, None, clock):
        energy.add(part.energy)
        maps += [(photons, part.plan) for photons in part.maps]
    return Traced(record_of(maps, scenes[0].geometry.paths), energy, clock.seconds)


def render_frame(
    source: SceneSource, shutter: Shutter, settings: Settings, width: int, height: int, clock: Clock | None = None
) -> Frame:
    """Renders one frame of ``width`` × ``height`` pixels.

    Args:
        source: The scene; its ``at`` must supply a camera.
        clock: Measures the stages; goes on where it stands.
    """
    clock = clock or Clock()
    return expose(_animation(source, settings), shutter, width, height, clock)


def expose(animation: Animation, shutter: Shutter, width: int, height: int, clock: Clock) -> Frame:
    """Renders one frame of an animation."""
    settings = animation.settings
    scenes = animation.load_segments(shutter, clock)
    middle = scenes[len(scenes) // 2].scene.camera
    film = Film(width, height, settings.samples, animation.normalization, middle.exposure_scale, settings.aovs)
    view = View(animation, scenes, width, height, clock, settings.estimator == "accumulation")
    energy, maps = expose_film(film, animation, shutter, scenes, view.sights, view.pixel, clock)
    record = record_of(maps, scenes[0].geometry.paths)
    return Frame(record, energy, clock.seconds, film.channels(), middle)


def expose_film(
    film: Film,
    animation: Animation,
    shutter: Shutter,
    scenes: list[LoadedScene],
    sights: Callable[[Film | None], Iterable[Sight]],
    pixel: PixelSize,
    clock: Clock,
) -> tuple[EnergyAccount, list[tuple[PhotonMap, EmissionPlan]]]:
    """Adds to ``film`` what photons leave at the ``sights`` of the scenes of a shutter.

    Args:
        sights: What the camera sees; it adds direct light to the film, if it is given one.
        pixel: What the sights stand for.

    Returns:
        Where the photons' flux went, and the photons with their lattices.
    """
    settings = animation.settings
    with_motion = bool({"motion", "photons"} & set(settings.aovs))
    energy = EnergyAccount()
    maps = []
    estimator = ESTIMATORS[settings.estimator]()
    for number, part in enumerate(estimator.parts(animation, shutter, scenes, pixel, clock)):
        for sight in sights(film if number == 0 else None):
            if part.light is None:
                continue
            with clock.stage("gather"):
                light = part.light.irradiance(
                    sight.queries,
                    time=sight.time,
                    window=sight.window,
                    query_moves=sight.moves,
                    with_motion=with_motion,
                )
                film.add_caustic(sight.pixels, sight.weights, sight.first, light)
        energy.add(part.energy)
        maps += [(photons, part.plan) for photons in part.maps]
        # Before photons are told in scene units: ten million footprints take more memory than their photons.
        del part
    return energy, maps
