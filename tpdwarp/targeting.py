"""Choosing photons and segments for a wanted error, without a reference.

A few pixels of a few frames are rendered with more and more photons m in each of K segments. The change D from m to 4m
photons tells the error e_m of m photons; if errors fall by a factor r from one to the other,

    e_m = D/(1 − r²),

halfway between errors that have nothing in common, D/√(1 + r²), and errors of one shape, D/(1 − r). The change
from K to 2K segments tells the error in time, and a part of that in space, which is taken out. Both add up as squares.
Whichever buys more accuracy for its photons, m or K, is raised until the wanted error is within reach of the power law
that the last changes make.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tpdwarp.errors import logger
from tpdwarp.estimators.base import Animation, Clock
from tpdwarp.frame import expose
from tpdwarp.scene.description import SceneSource, Shutter
from tpdwarp.settings import Settings
from tpdwarp.view.sampling import pixel_grid

MOST_STILLS = 3
PILOT_PIXELS = 4096
FIRST_PHOTONS = 64
# No smaller error is believed before so many photons were seen.
FEWEST_SEEN = 1024
MOST_PHOTONS = 1 << 23
MOST_SEGMENTS = 64
# How errors fall from m to 4m photons: what is believed at least and at most, and before two changes are known.
FALL = (0.15, 0.85)
UNKNOWN_FALL = 0.4
# So many times photons may be quadrupled beyond those of the pilot by the power law, or quartered below them.
FARTHEST = 2.0
NEAREST = -1.0
# From K to 2K segments; footprints follow the light to second order.
TIME_FALL = 0.25
# Part of the error in space that changes with the segments, and looks like one in time.
SHARE_OF_SPACE = 0.5

Pictures = Callable[[int, int], np.ndarray]


@dataclass(frozen=True)
class Choice:
    """What reaches a wanted error.

    Attributes:
        photons: Photons of each segment.
        segments: Segments of the shutter.
        error: Relative RMSE expected of it.
    """

    photons: int
    segments: int
    error: float


@dataclass(frozen=True)
class ErrorTarget:
    """A wanted error and what was chosen for it.

    Attributes:
        wanted, expected: Relative RMSE of the light from photons.
        photons: Photons a frame.
        segments: Segments of the shutter.
    """

    wanted: float
    expected: float
    photons: int
    segments: int


def settled(
    source: SceneSource, settings: Settings, shutters: Sequence[Shutter], width: int, height: int
) -> tuple[Settings, ErrorTarget]:
    """``settings`` with the photons and segments that ``settings.target_error`` asks for.

    Args:
        source: The scene.
        settings: How it is rendered.
        shutters: Of frames spread over the animation, not of the frames at hand: so all have the same lattices.
        width, height: Pixels of the frames.
    """
    pictures = pilot(source, settings, shutters[:: math.ceil(len(shutters) / MOST_STILLS)], width, height)
    moves = any(shutter.exposure > 0 for shutter in shutters)
    choice = chosen(pictures, settings.target_error, MOST_SEGMENTS if moves else 1)
    if choice.error > 1.05 * settings.target_error:
        logger.warning(
            f"--target-error {settings.target_error:g} is out of reach: {choice.photons * choice.segments} photons in "
            f"{choice.segments} segments are expected to err by {choice.error:.2g}"
        )
    photons = choice.photons * choice.segments
    target = ErrorTarget(settings.target_error, choice.error, photons, choice.segments)
    return replace(settings, photons=photons, segments=choice.segments, target_error=None), target


def pilot(source: SceneSource, settings: Settings, shutters: Sequence[Shutter], width: int, height: int) -> Pictures:
    """Gives light from photons at some pixels of some frames, for m photons in each of K segments, shape [n, 3]."""
    pixels = pixel_grid(width, height, PILOT_PIXELS, settings.seed)

    def picture(photons: int, segments: int) -> np.ndarray:
        tried = replace(settings, photons=photons * segments, segments=segments, target_error=None, aovs=("caustic",))
        animation = Animation(source, tried)
        seen = []
        for shutter in shutters:
            channels = expose(animation, shutter, width, height, Clock(), pixels).channels
            seen.append(np.stack([channels[f"caustic.{c}"].ravel()[pixels] for c in "RGB"], axis=1))
        return np.concatenate(seen).astype(np.float64)

    return picture


def chosen(picture: Pictures, wanted: float, most_segments: int) -> Choice:
    """The cheapest choice expected to err by no more than ``wanted`` (relative RMSE), or the best there is."""
    found: dict[tuple[int, int], np.ndarray] = {}

    def at(photons: int, segments: int) -> np.ndarray:
        if (photons, segments) not in found:
            found[photons, segments] = picture(photons, segments)
        return found[photons, segments]

    def change(a: np.ndarray, b: np.ndarray) -> float:
        level = float(b.mean())
        return float(np.sqrt(np.mean((a - b) ** 2))) / level if level > 0 else 0.0

    def errors(photons: int, segments: int) -> _Errors:
        here, finer = at(photons, segments), at(4 * photons, segments)
        coarser = at(photons // 4, segments) if photons > FIRST_PHOTONS else None
        step = change(here, finer)
        fall = UNKNOWN_FALL if coarser is None else _ratio(step, change(coarser, here))
        jump = change(here, at(photons, 2 * segments)) if segments < most_segments else 0.0
        space = step / (1.0 - fall**2)
        time = math.sqrt(max(jump**2 - (SHARE_OF_SPACE * space) ** 2, 0.5 * jump**2))
        return _Errors(space, fall, time / (1.0 - TIME_FALL**2))

    photons, segments = FIRST_PHOTONS, 1
    while True:
        now = errors(photons, segments)
        if 4 * photons >= FEWEST_SEEN:
            room = math.log(MOST_PHOTONS / (photons * segments)) / math.log(4)
            if now.with_photons(min(FARTHEST, room)) <= wanted:
                quadruplings = now.quadruplings(wanted)
                return Choice(math.ceil(photons * 4.0**quadruplings), segments, now.with_photons(quadruplings))
            if 4 * photons * segments >= MOST_PHOTONS:
                return Choice(4 * photons, segments, now.with_photons(1.0))
            by_segments = math.log(now.with_photons(0.0) / now.with_segments()) / math.log(2)
            if segments < most_segments and by_segments > math.log(
                now.with_photons(0.0) / now.with_photons(1.0)
            ) / math.log(4):
                # Errors in space may have been those of photons that went far astray: fewer may do now.
                photons, segments = max(FIRST_PHOTONS, photons // 16), 2 * segments
                continue
        photons *= 4


@dataclass(frozen=True)
class _Errors:
    """Errors in space and in time of m photons in each of K segments, and how that in space falls from m to 4m."""

    space: float
    fall: float
    time: float

    def with_photons(self, quadruplings: float) -> float:
        """Error of 4^quadruplings times as many photons in each segment."""
        return math.hypot(self.space * self.fall**quadruplings, self.time)

    def with_segments(self) -> float:
        """Error of twice as many segments."""
        return max(math.hypot(self.space, TIME_FALL * self.time), 1e-12)

    def quadruplings(self, wanted: float) -> float:
        """How often photons are to be quadrupled, from ``NEAREST`` to ``FARTHEST``, for the error ``wanted``."""
        low, high = NEAREST, FARTHEST
        if self.with_photons(low) <= wanted:
            return low
        for _ in range(40):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.with_photons(middle) > wanted else (low, middle)
        return high


def _ratio(after: float, before: float) -> float:
    return float(np.clip(after / before, *FALL)) if before > 0 else FALL[0]
