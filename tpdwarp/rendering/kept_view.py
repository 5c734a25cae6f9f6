"""What the camera looks up, kept where photons come strip after strip (:mod:`tpdwarp.photons.strips`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from tpdwarp.estimators.estimator import Part
from tpdwarp.view.queries import CameraView
from tpdwarp.view.query_batches import QueryBatch, SeenPoints

# Of what is looked up at most so much is kept; what is more is seen again for each strip. Chosen, not derived: a
# picture of 1920 × 1080 pixels at rest takes a third of it.
MOST_BYTES = 512e6
# Of a row: place, normal, motion, shading normal and receiver; pixel, weight and time.
BYTES_OF_ROW = 88


class KeptView:
    """The view of one frame."""

    def __init__(self) -> None:
        self._batches: list[QueryBatch] = []
        self._bytes = 0
        self._whole = False

    def look(self, part: Part, view: Callable[[], CameraView]) -> Iterator[SeenPoints | QueryBatch]:
        """What the camera sees while it looks for the light of ``part``.

        Args:
            part: The photons; where it has no share of the view, and what is looked up is kept, nothing else is seen.
            view: Makes the view.
        """
        if self._whole and not part.weight:
            yield from self._batches
            return
        keeps = part.plan.strip is not None
        for seen in view().look():
            if keeps and isinstance(seen, QueryBatch):
                self._bytes += BYTES_OF_ROW * len(seen.pixels)
                keeps = self._bytes <= MOST_BYTES
                self._batches = [*self._batches, seen] if keeps else []
            yield seen
        self._whole = keeps
