"""How the power of a light changes while the shutter is open, and the lines that stand for it.

Beyond the paper, whose lights do not change.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

# The power of lights is asked for over this many parts of the shutter, and of a piece of it that is halved.
SHUTTER_PARTS, PIECE_PARTS = 16, 4
# Pieces are halved so many times at most.
MOST_HALVINGS = 6
# Light that is misplaced, as a part of that of a light's mean, times how long it is: what a light's power is off the
# line that stands for it (root mean square) times the length of the piece. Chosen, not derived: that of a light that
# brightens by half a stop.
LARGEST_BEND = 0.005


@dataclass(frozen=True, eq=False)
class PowerPiece:
    """A part of the shutter, and of the colours, in which the power of a light goes along a line.

    Attributes:
        time: Middle of the part, −½ … ½.
        duration: Its length.
        power: Mean over it as a part of the mean over the whole shutter, by colour, shape [3].
        gain: Change from its beginning to its end as a part of that.
        image: What the light's size along a and b is meanwhile, by that over the whole shutter.
    """

    time: float
    duration: float
    power: np.ndarray
    gain: float
    image: tuple[float, float] = (1.0, 1.0)

    @property
    def center(self) -> float:
        """The time of its light on average."""
        return self.time + self.duration * self.gain / 12.0


@dataclass(frozen=True, eq=False)
class PowerCurve:
    """How the power of a light changes over the shutter.

    Attributes:
        pieces: What stands for it; they have all of its light.
    """

    pieces: tuple[PowerPiece, ...]

    @classmethod
    def of(cls, power: Callable[[float, float], np.ndarray]) -> PowerCurve:
        """The one that follows a light.

        Args:
            power: Its mean from one part of the shutter, 0 … 1, to another, shape [3].
        """
        whole = _parts_of(power, 0.0, 1.0, SHUTTER_PARTS).mean(axis=0)
        shining = whole > 0.0

        def share(begin: float, end: float) -> np.ndarray:
            """The power as a part of the mean; nothing in a colour that the light does not have."""
            return np.divide(power(begin, end), whole, out=np.zeros(3), where=shining)

        return cls(tuple(_pieces_of(share, whole / whole.sum(), 0.0, 1.0, 0)))


def _pieces_of(
    share: Callable[[float, float], np.ndarray], weights: np.ndarray, begin: float, end: float, halvings: int
) -> list[PowerPiece]:
    """What stands for a light from ``begin`` to ``end``: one line for all colours, or one for each, or those of halves.

    Args:
        share: Its power as a part of the mean.
        weights: How much of its light is red, green and blue, shape [3].
        begin, end: Parts of the shutter, 0 … 1.
        halvings: How many times the shutter was halved for it.
    """
    length = end - begin
    parts = _parts_of(share, begin, end, max(SHUTTER_PARTS >> halvings, PIECE_PARTS))
    time = (np.arange(len(parts)) + 0.5) / len(parts) - 0.5
    mean = parts.mean(axis=0)
    if not mean.any():
        return []
    slope = time @ parts / np.sum(time**2)
    for colours in (np.ones((1, 3)), np.diag(weights > 0.0).astype(np.float64)):
        pieces = []
        line = np.zeros_like(parts)
        for chosen in colours:
            light = mean @ (weights * chosen)
            if light > 0.0:
                gain = float(slope @ (weights * chosen) / light)
                pieces.append(PowerPiece(0.5 * (begin + end) - 0.5, length, mean * chosen, gain))
                line += (1.0 + time * gain)[:, None] * (mean * chosen)
        bend = math.sqrt(np.mean((parts - line) ** 2, axis=0) @ weights)
        if length * bend <= LARGEST_BEND:
            return pieces
    if halvings == MOST_HALVINGS:
        return pieces
    middle = 0.5 * (begin + end)
    return [
        piece
        for half in ((begin, middle), (middle, end))
        for piece in _pieces_of(share, weights, *half, halvings + 1)
    ]


def _parts_of(power: Callable[[float, float], np.ndarray], begin: float, end: float, count: int) -> np.ndarray:
    """The power of equal parts of some time, shape [count, 3]."""
    edges = begin + (end - begin) * np.arange(count + 1) / count
    return np.array([power(float(a), float(b)) for a, b in itertools.pairwise(edges)])
