"""One trace for several cameras: the scene of a shutter on the device, and its photons, kept from view to view."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from tpdwarp.estimators.estimator import Part
from tpdwarp.photons.energy import EnergyAccount
from tpdwarp.scene.description import Shutter
from tpdwarp.scene.device.loading import LoadedScene
from tpdwarp.settings import Settings

# Settings that photons do not depend on.
OF_VIEWS = ("aovs", "crop", "holdout", "image_width", "product", "resolution", "samples")


def may_share(settings: Settings, others: Settings) -> bool:
    """Whether views with these settings may look at the same photons.

    Accumulation goes through instants, of which each has a scene and photons of its own: too many to keep.
    """
    of_views = {name: getattr(settings, name) for name in OF_VIEWS}
    return settings.estimator != "accumulation" and replace(others, **of_views) == settings


class SharedTrace:
    """What was loaded and traced last; views that look through other cameras at the same shutter take it from here."""

    def __init__(self) -> None:
        self._shutter: Shutter | None = None
        self._scenes: list[LoadedScene] = []
        self._traced: tuple[tuple[int, bool], list[Part]] | None = None

    def scenes(self, shutter: Shutter, load: Callable[[], list[LoadedScene]]) -> list[LoadedScene]:
        """The scenes of all segments of ``shutter``, which ``load`` loads for the first who asks."""
        if self._shutter != shutter:
            # What is let go of first makes room for the next.
            self._shutter, self._scenes, self._traced = None, [], None
            self._scenes, self._shutter = load(), shutter
        return self._scenes

    def parts(self, scenes: list[LoadedScene], trace: Callable[[], Iterator[Part]]) -> Iterator[tuple[Part, bool]]:
        """The photons of the shutter of :meth:`scenes`, which ``trace`` traces for the first who asks.

        Where one camera moves and another does not, and nothing else moves, each has its own.

        Args:
            scenes: As this view's camera sees them.
            trace: Traces them.

        Yields:
            Each part with an account of its own, and whether its light is shaped for the pixels of another view.
        """
        kind = len(scenes), any(scene.moves for scene in scenes)
        again = self._traced is not None and self._traced[0] == kind
        if self._traced is None or not again:
            self._traced = kind, list(trace())
        for part in self._traced[1]:
            energy = EnergyAccount()
            energy.add(part.energy)
            yield replace(part, energy=energy, scenes=scenes), again
