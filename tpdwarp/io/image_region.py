"""The part of an image that is rendered: EXR's data window within its display window."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class ImageRegion:
    """Columns and rows of an image, rows from the top.

    Attributes:
        width, height: Pixels of the whole image.
        first, end: First column, and the one after the last.
        above, below: First row, and the one after the last.
    """

    width: int
    height: int
    first: int
    end: int
    above: int
    below: int

    @classmethod
    def whole(cls, width: int, height: int) -> ImageRegion:
        """All of an image."""
        return cls(width, height, 0, width, 0, height)

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows that are rendered."""
        return self.end - self.first, self.below - self.above

    @property
    def is_whole(self) -> bool:
        return self.size == (self.width, self.height)

    def of_ndc(self, window: tuple[float, float, float, float]) -> ImageRegion:
        """The part within ``window``: left, bottom, right and top in 0 … 1 of the image, from its lower left.

        A pixel is rendered where its lower left corner lies within the window, as UsdRender has it; one is at least.
        """
        left, bottom, right, top = window
        first, end = (min(max(math.ceil(edge * self.width), 0), self.width) for edge in (left, right))
        low, high = (min(max(math.ceil(edge * self.height), 0), self.height) for edge in (bottom, top))
        return self.of_pixels(first, self.height - high, end, self.height - low)

    def of_pixels(self, first: int, above: int, end: int, below: int) -> ImageRegion:
        """The part of the image between these columns and rows; one pixel is at least."""
        first, above = min(max(first, 0), self.width - 1), min(max(above, 0), self.height - 1)
        end, below = min(max(end, first + 1), self.width), min(max(below, above + 1), self.height)
        return ImageRegion(self.width, self.height, first, end, above, below)
