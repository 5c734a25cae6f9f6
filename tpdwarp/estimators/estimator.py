"""What all estimators of caustic irradiance share: the protocol, and the parts of a frame that they hand on."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

from tpdwarp.clock import Clock
from tpdwarp.footprints.irradiance import Irradiance, Lookup, QueryArrays
from tpdwarp.footprints.light import FootprintLight
from tpdwarp.footprints.pixel_areas import typical_pixel_area
from tpdwarp.footprints.receiver_edges import with_edges
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.footprints.weights import GatherForm
from tpdwarp.photons.energy import EnergyAccount
from tpdwarp.photons.lattices import EmissionPlan
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.photons.tracer import PhotonTracer
from tpdwarp.scene.description import Shutter
from tpdwarp.scene.device.loading import LoadedScene
from tpdwarp.trajectories.bends import with_bends
from tpdwarp.trajectories.neighbours import beside_edges


class IrradianceField(Protocol):
    """Irradiance from photons at any point.

    Attributes:
        longest_way: How far a query may move within its window [tracer's units] and be looked up at once; beyond, it is
            looked up in pieces of its way.
    """

    @property
    def longest_way(self) -> float: ...

    def irradiance(self, queries: QueryArrays, lookup: Lookup) -> Irradiance:
        """Irradiance at ``queries``."""
        ...

    def of_photons(self, maps: list[PhotonMap]) -> IrradianceField:
        """The same estimate from other photons."""
        ...


@dataclass
class Part:
    """Part of a frame's exposure: photons, their light, and what the camera looks through meanwhile.

    The film adds the parts up. Photons carry their part's share of the light already; what the camera sees besides is
    weighted by ``weight``.

    Attributes:
        maps: The photons, one map a (sub-)shutter.
        energy: Where their flux went.
        light: The irradiance they make; None where there is none, or where photons are only traced.
        plan: The lattices they come from.
        scenes: The scenes that the camera looks at, one a segment of ``shutter``.
        shutter: The part of the exposure.
        weight: Its share in the exposure.
        lattices: Those of each of ``maps``, where they are not of ``plan``.
    """

    maps: list[PhotonMap]
    energy: EnergyAccount
    light: IrradianceField | None
    plan: EmissionPlan
    scenes: list[LoadedScene]
    shutter: Shutter
    weight: float = 1.0
    lattices: Sequence[EmissionPlan] = ()


class Estimator(Protocol):
    """An estimator of caustic irradiance over one shutter."""

    def parts(
        self, tracer: PhotonTracer, shutter: Shutter, scenes: list[LoadedScene], pixel: PixelSize | None, clock: Clock
    ) -> Iterator[Part]:
        """Traces photons over ``shutter`` and shapes footprints for pixels of the given size.

        Args:
            tracer: Traces photons.
            shutter: The exposure.
            scenes: The scenes of its segments.
            pixel: What a query stands for; without it photons are only traced.
            clock: Where the time goes.
        """
        ...


def light_of(
    maps: list[PhotonMap],
    energy: EnergyAccount,
    moves: bool,
    tracer: PhotonTracer,
    pixel: PixelSize | None,
    clock: Clock,
) -> IrradianceField | None:
    """The light of photons whose footprints are shaped for ``pixel`` and evaluated as the settings say.

    Clamped footprints are counted in ``energy``.
    """
    settings = tracer.settings
    if pixel is None:
        return None
    with clock.stage("footprints"):
        form = GatherForm(settings.kernel, settings.footprint, settings.time_filter)
        light = FootprintLight(maps, form, settings.smoothing, pixel, moves, tracer.launcher)
    limits = {"footprints clamped": light.clamped, "footprints that grow too fast": light.growth_limited}
    energy.add(EnergyAccount(counts={name: count for name, count in limits.items() if count}))
    return light if light.count else None


def bent(
    photons: PhotonMap,
    plan: EmissionPlan,
    tracer: PhotonTracer,
    pixel: PixelSize | None,
    clock: Clock,
    beside: Sequence[PhotonMap] = (),
) -> PhotonMap:
    """The photons with what their neighbours know, where they have footprints and these are a lattice's own cells.

    Args:
        beside: Neighbours among other photons (:func:`tpdwarp.trajectories.bends.with_bends`).
    """
    settings = tracer.settings
    if pixel is None or settings.emission != "lattice" or settings.kernel != "bspline" or settings.smoothing != 1.0:
        return photons
    with clock.stage("footprints"):
        return with_bends(photons, plan, tracer.launcher, beside)


def at_edges(
    photons: PhotonMap,
    plan: EmissionPlan,
    loaded: LoadedScene,
    tracer: PhotonTracer,
    pixel: PixelSize | None,
    clock: Clock,
    finer: int = 1,
) -> PhotonMap:
    """Photons with the edges of receivers that their footprints reach over, where footprints are a lattice's cells.

    Args:
        photons: Of ``plan``, with the time that they have within the shutter of ``loaded``.
        finer: How many of their cells lie along either side of one whose footprint they may have.
    """
    settings = tracer.settings
    if pixel is None or settings.emission != "lattice" or settings.kernel != "bspline" or not len(photons):
        return photons
    with clock.stage("footprints"):
        # Parts of the shutter, and finer cells, are of cells beside edges.
        chosen = None if photons.part or finer > 1 else beside_edges(photons, plan)
        side = math.sqrt(typical_pixel_area(photons, pixel))
        return with_edges(photons, loaded.geometry.surfaces, side, tracer.launcher, chosen, finer)


def reshaped(part: Part, pixel: PixelSize, tracer: PhotonTracer, clock: Clock) -> IrradianceField | None:
    """The light of a part's photons for queries that stand for other areas.

    Estimates that do not average over what a query stands for are the same for all.
    """
    if not isinstance(part.light, FootprintLight):
        return part.light
    return light_of(part.maps, EnergyAccount(), part.light.moves, tracer, pixel, clock)
