"""One frame, as the method goes: photons, their footprints, what the camera sees, and the film.

    for each part of the exposure that the estimator gives
        look through the camera         direct light goes to the film
        gather at what it sees          light from photons goes to the film
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from tpdwarp.clock import Clock
from tpdwarp.estimators import estimator_of
from tpdwarp.estimators.estimator import Part
from tpdwarp.footprints.irradiance import Lookup
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.io.image_region import ImageRegion
from tpdwarp.photons.energy import EnergyAccount
from tpdwarp.photons.lattices import EmissionPlan
from tpdwarp.photons.paths import PhotonPaths, SpreadCells, paths_of
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.photons.record import LandedPhotons, PhotonRecord
from tpdwarp.photons.thinning import thinning_ranks
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.kept_view import KeptView
from tpdwarp.rendering.light_groups import Fields
from tpdwarp.scene.description import CameraAtShutter, Shutter
from tpdwarp.scene.device.loading import LoadedScene
from tpdwarp.view.camera import camera_of, pixel_size
from tpdwarp.view.film import Film
from tpdwarp.view.queries import CameraView
from tpdwarp.view.query_batches import QueryBatch, SeenPoints
from tpdwarp.view.sampling import region_order

# So many times as many cells are tried as paths are wanted, for many miss what is specular. Chosen, not derived.
MISSES = 4


@dataclass
class Traced:
    """Photons of one shutter.

    Attributes:
        landed: The photons that landed.
        energy: Where the flux went [W].
        seconds: Wall time by stage.
        paths: Paths of some of them, where these were asked for.
    """

    landed: LandedPhotons
    energy: EnergyAccount
    seconds: dict[str, float]
    paths: PhotonPaths | None = field(default=None, kw_only=True)

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
    """The photons of all parts of a frame, and the account of their flux.

    Args:
        kept: Whether the photons are; else they are counted only.
    """

    def __init__(self, *, kept: bool = True) -> None:
        self.energy = EnergyAccount()
        self._kept, self._count = kept, 0
        self._maps: list[tuple[PhotonMap, EmissionPlan]] = []

    def add(self, part: Part) -> None:
        self.energy.add(part.energy)
        self._count += sum(map(len, part.maps))
        if self._kept:
            self._maps += zip(part.maps, part.lattices or [part.plan] * len(part.maps), strict=True)

    def landed(self, scenes: list[LoadedScene]) -> LandedPhotons:
        return LandedPhotons(self._maps, scenes[0].geometry.paths, self._count)


def trace_frame(context: RenderContext, shutter: Shutter, clock: Clock | None = None, paths: int = 0) -> Traced:
    """Traces the photons of one shutter.

    Args:
        context: The animation.
        shutter: The exposure.
        clock: Measures the stages; goes on where it stands.
        paths: At most so many paths are recorded; 0 for none.

    Raises:
        InputError: The scene cannot be used there.
    """
    clock = clock or Clock()
    scenes = context.segmentation.load(shutter, clock)
    photons = FramePhotons()
    for part in estimator_of(context.settings).parts(context.tracer, shutter, scenes, None, clock):
        photons.add(part)
    shown = _traced_paths(context, scenes, paths, clock) if paths else None
    return Traced(photons.landed(scenes), photons.energy, clock.seconds, paths=shown)


def _traced_paths(context: RenderContext, scenes: list[LoadedScene], count: int, clock: Clock) -> PhotonPaths:
    """At most ``count`` paths of photons through the scene in the middle of a shutter, spread evenly over the light."""
    tracer, middle = context.tracer, scenes[len(scenes) // 2]
    plan = tracer.plan(max(1, context.settings.photons // len(scenes)), clock)
    chosen = SpreadCells(plan, MISSES * count)
    photons, _ = tracer.trace(middle, plan, clock, chosen=chosen, recording=True, seed=context.settings.seed)
    found = paths_of(photons, plan, middle.geometry.paths)
    if len(photons) <= count:
        return found
    ranks = thinning_ranks(found.photons)
    return found.rows(ranks < np.partition(ranks, count)[count])


def render_frame(
    context: RenderContext,
    shutter: Shutter,
    width: int,
    height: int,
    clock: Clock | None = None,
    paths: int = 0,
    region: ImageRegion | None = None,
    keeping: bool = True,
) -> Frame:
    """Renders one frame of ``width`` × ``height`` pixels.

    Args:
        context: The animation; its source must supply a camera.
        shutter: The exposure.
        clock: Measures the stages; goes on where it stands.
        paths: At most so many paths of photons are recorded; 0 for none.
        region: The part of the image that is rendered, as in the whole of it; None for all.
        keeping: Whether the frame keeps its photons; ten million take 2 GB.

    Raises:
        InputError: The scene cannot be used there.
    """
    clock = clock or Clock()
    settings = context.settings
    region = region or ImageRegion.whole(width, height)
    scenes = context.scenes(shutter, clock)
    camera = middle_camera(scenes)
    pixel = pixel_of(context, scenes, width, height)
    film = Film(
        *region.size,
        settings.samples,
        context.normalization,
        camera.exposure_scale,
        # A host's depth is compared with this one's.
        tuple(dict.fromkeys((*settings.aovs, "Z"))) if settings.holdout else settings.aovs,
        scenes[0].geometry.paths,
        context.light_groups.names,
    )
    photons, kept = FramePhotons(kept=keeping), KeptView()
    order = (None, None) if region.is_whole else region_order(region)

    def view_of(part: Part) -> CameraView:
        with clock.stage("view"):
            seen_by = context.normalization, context.launcher, width, height, clock
            return CameraView(part.scenes, settings, *seen_by, *order)

    for part, unshaped in context.parts(shutter, scenes, pixel, clock, (width, height)):
        fields = context.light_groups.fields(part, unshaped, context.tracer, clock)
        part.energy.add(expose(film, fields, kept.look(part, partial(view_of, part)), part.weight, clock))
        photons.add(part)
        # Ten million footprints take more memory than their photons.
        del part, fields
    shown = _traced_paths(context, scenes, paths, clock) if paths else None
    with clock.stage("film"):
        channels = film.channels()
    return Frame(photons.landed(scenes), photons.energy, clock.seconds, channels, camera, paths=shown)


def middle_camera(scenes: list[LoadedScene]) -> CameraAtShutter:
    """The camera of the segment in the middle of a shutter."""
    return scenes[len(scenes) // 2].scene.camera


def expose(
    film: Film, fields: Fields, view: Iterable[SeenPoints | QueryBatch], weight: float, clock: Clock
) -> EnergyAccount:
    """Adds to ``film`` what the camera sees: direct light as it is seen, light from photons where it is looked up.

    Args:
        fields: The light of photons by light groups, or all of it without a name.
        view: What the camera sees.
        weight: Share of the exposure that the view stands for.

    Returns:
        An account that counts what was not seen as it is.
    """
    account = EnergyAccount()
    for seen in view:
        if isinstance(seen, SeenPoints):
            # Where the photons of a shutter come in several parts, one of them has all of the view.
            if weight:
                with clock.stage("view"):
                    film.add_view(seen.points, seen.pixels, weight * seen.shares)
                    account.add(EnergyAccount(counts=seen.counts()))
            continue
        for group, light in fields.items():
            with clock.stage("gather"):
                lookup = Lookup(0.0, seen.window, seen.moves, film.wants_motion, seen.times)
                found = light.irradiance(seen.queries, lookup)
                film.add_caustic(seen.pixels, seen.weights, seen.first, found, group)
    return account


def pixel_of(context: RenderContext, scenes: list[LoadedScene], width: int, height: int) -> PixelSize:
    """What a query stands for in an image of ``width`` × ``height`` pixels over the shutter of ``scenes``."""
    camera = camera_of(middle_camera(scenes), width, height, context.normalization)
    return pixel_size(camera, context.settings.samples)
