"""Choosing photons and segments for a wanted error, without a reference.

A few pixels of a few frames are rendered with more and more photons m in each of K segments. The change D from the last
picture but one to the last shows the error of the former; if errors fall by a factor r from one to the other, it is

    e = D/(1 − r²),

halfway between errors that have nothing in common, D/√(1 + r²), and errors of one shape, D/(1 − r). Errors of pictures
with fewer photons are their changes to the last one. The change from K to 2K segments shows the error in time and a
part of that in space, which is separated from it as it falls with more photons. Both add up as squares. Of the
frames looked at, the one that errs most counts; which one that is a few photons tell, and the others are left out from
then on. Where a stage's samples cut the shutter into equal parts, segments are these or 2, 4, … for each of them.
Whichever buys more accuracy for its photons, m or K, is raised until the wanted error is within reach of the power law
that the last changes make. Where the view moves, camera samples are raised last, until what they add is small.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile
from typing import Protocol

import numpy as np

from tpdwarp.errors import logger
from tpdwarp.rendering.pilot import Pilot
from tpdwarp.scene.description import SceneSource, Shutter
from tpdwarp.settings import Settings
from tpdwarp.trajectories.segments import most_breaks_inside, motion_breaks_within

# Frames that are looked at. Chosen, not derived, as is all below that does not say otherwise; what they do together is
# measured by ``scripts/benchmarks/run.py target_error``.
MOST_STILLS = 3
# Photons of the first picture, and of the least, which are looked at only where those of the first are enough.
FIRST_PHOTONS = 256
FEWEST_PHOTONS = 64
# Photons of the pictures that show which frame errs most; all others are of this one alone.
PHOTONS_OF_ALL_FRAMES = (256, 1024)
# No smaller error is believed before so many photons were seen.
FEWEST_SEEN = 4096
# What a frame may cost at most.
MOST_PHOTONS = 1 << 23
MOST_SEGMENTS = 64
# Segments are made to begin at breaks of motion where the shutter is cut into no more equal parts than these.
MOST_PARTS = 8
# How errors fall from m to 4m photons: what is believed at least and at most, and before two changes are known. On a
# lattice they fall as 1/m, to 0.25, where light is smooth, and as 1/√m where it ends at edges.
FALL = (0.15, 0.7)
FALL_AT_EDGES = UNKNOWN_FALL = 0.5
# While the mean of a picture still changes by more than this, light is not where it belongs at all: cells lie half off
# what is narrow, as steps and slats. How changes fall from there tells nothing of how errors do. Chosen: a lens over
# stairs has .68 of its light with 256 photons, .99 with 1 024, and changes by 2.9 and then by .2; with four times as
# many from then on it errs by half.
LARGEST_MISSING = 0.03
# So many times photons may be quadrupled by the power law beyond those whose error is known from the next.
LARGEST_EXTRAPOLATION = 1.5
# How errors in time fall from K to 2K segments, at least and at most: curved trajectories are right to third order, so
# that the least is 2⁻⁴.
TIME_FALL = (0.0625, 0.7)
# And from m to 4m photons: smaller footprints change less while the shutter is open, but trajectories err as much.
TIME_FALL_BY_PHOTONS = (0.75, 1.0)
# Least part of the change with the segments that counts as one in time.
LEAST_IN_TIME = 0.25
# Frames count as no darker than by this part of the light of all.
LEAST_LIGHT = 0.1
# Camera samples are raised by this factor, up to so many. Where edges move, stratified means of samples err by their
# number to the power −¾, and independently of each other: the change to four times as many is the error to 6 %.
MORE_SAMPLES, MOST_SAMPLES = 4, 64
FALL_BY_SAMPLES = MORE_SAMPLES**-0.75
# Between two numbers of photons errors go by a power law, unless they fall by more than this from one to another. Then
# up to so many pictures between them are looked at: few photons may be too few for finer cells where light is seen.
STEEP = 4.0
MOST_BETWEEN = 3
# What camera samples may err by, as a part of what is wanted: together they stay within 1.05 of it, below the warning.
LARGEST_BY_SAMPLES = 0.3
# Keeps quotients and logarithms of errors finite.
TINY = 1e-12



class Pictures(Protocol):
    """Makes pictures of some frames."""

    def __call__(self, photons: int, segments: int) -> np.ndarray:
        """Light from so many photons in each of so many segments, shape [frames, n, 3]."""
        ...

    def keep(self, frame: int) -> None:
        """From now on, pictures are of this one of the frames alone."""
        ...


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
        samples: Camera samples a pixel.
    """

    wanted: float
    expected: float
    photons: int
    segments: int
    samples: int


def settled(
    source: SceneSource, settings: Settings, shutters: Sequence[Shutter], width: int, height: int
) -> tuple[Settings, ErrorTarget]:
    """``settings`` with the photons, segments and samples that ``settings.target_error`` asks for.

    Samples are never fewer than those of ``settings``.

    Args:
        source: The scene.
        settings: How it is rendered.
        shutters: Of frames spread over the animation, not of the frames at hand: so all have the same lattices.
        width, height: Pixels of the frames.
    """
    # The middles of equal parts of the animation.
    apart = math.ceil(len(shutters) / MOST_STILLS)
    pictures = Pilot(source, settings, shutters[(apart - 1) // 2 :: apart], width, height)
    choice = chosen(pictures, settings.target_error, numbers_of_segments(source, shutters))
    samples, by_samples = enough_samples(pictures, choice, settings.target_error, settings.samples)
    choice = replace(choice, error=math.hypot(choice.error, by_samples))
    if choice.error > 1.05 * settings.target_error:
        logger.warning(
            f"--target-error {settings.target_error:g} is out of reach: {choice.photons * choice.segments} photons in "
            f"{choice.segments} segments are expected to err by {choice.error:.2g}"
        )
    photons = choice.photons * choice.segments
    target = ErrorTarget(settings.target_error, choice.error, photons, choice.segments, samples)
    found = {"photons": photons, "segments": choice.segments, "samples": samples, "target_error": None}
    return replace(settings, **found), target


def enough_samples(pictures: Pilot, choice: Choice, wanted: float, least: int) -> tuple[int, float]:
    """Camera samples a pixel, ``least`` or more, and what they make the light err by; nothing where no view moves.

    What a pixel sees of light changes with its samples where things move past it; few photons are enough to show that.
    """
    if not pictures.view_moves:
        return least, 0.0
    photons = min(choice.photons, FEWEST_SEEN)
    samples, here = least, pictures(photons, choice.segments, least)
    while True:
        more = pictures(photons, choice.segments, MORE_SAMPLES * samples)
        error = _change(here, more)
        if error <= LARGEST_BY_SAMPLES * wanted:
            return samples, error
        samples, here = MORE_SAMPLES * samples, more
        if samples >= MOST_SAMPLES:
            return samples, FALL_BY_SAMPLES * error


def numbers_of_segments(source: SceneSource, shutters: Sequence[Shutter]) -> tuple[int, ...]:
    """Numbers of segments to choose from: one, and those that begin where motion breaks."""
    moving = [shutter for shutter in shutters if shutter.exposure > 0]
    if not moving:
        return (1,)
    breaks = set().union(*(motion_breaks_within(source, shutter) for shutter in moving))
    fewest = next((count for count in range(1, MOST_PARTS + 1) if not most_breaks_inside(breaks, count)), 1)
    doubled = takewhile(lambda count: count <= MOST_SEGMENTS, (fewest << k for k in itertools.count()))
    return tuple(sorted({1, *doubled}))


def chosen(picture: Pictures, wanted: float, numbers: Sequence[int]) -> Choice:
    """The cheapest choice expected to err by no more than ``wanted`` (relative RMSE), or the best there is.

    Args:
        picture: Makes pictures.
        wanted: The wanted error.
        numbers: Numbers of segments to choose from, from one on.
    """
    following = dict(itertools.pairwise(numbers))
    preceding = {more: fewer for fewer, more in following.items()}
    found: dict[tuple[int, int], np.ndarray] = {}

    def at(photons: int, segments: int) -> np.ndarray:
        if (photons, segments) not in found:
            found[photons, segments] = picture(photons, segments)
        return found[photons, segments]

    def in_space(photons: int, segments: int) -> _ErrorInSpace:
        counts = [m for m in (4 * photons >> 2 * k for k in range(12)) if m >= FIRST_PHOTONS][::-1]
        return _ErrorInSpace.of(counts, [at(m, segments) for m in counts])

    def in_time(photons: int, segments: int, fall: float, finest: bool = False) -> _ErrorInTime:
        if segments not in following:
            return _ErrorInTime(photons, 0.0, 1.0)
        # Fewer do not show the error in time, and take longer: their large cells are looked at part by part.
        enough = 4 * photons if finest else max(photons, FEWEST_SEEN)
        jump, coarse = (_change(at(m, segments), at(m, following[segments])) for m in (enough, enough // 4))
        # Its part in space is as much smaller with more photons as the error in space; that in time stays.
        apart = (jump**2 - (fall * coarse) ** 2) / (1.0 - fall**2)
        time_fall = TIME_FALL[0]
        if segments in preceding:
            # Light that folds while the shutter is open gains less from another segment.
            before = _change(at(enough, preceding[segments]), at(enough, segments))
            time_fall = float(np.clip(jump / max(before, TINY), *TIME_FALL))
        error = math.sqrt(max(apart, (LEAST_IN_TIME * jump) ** 2)) / (1.0 - time_fall**2)
        by_photons = float(np.clip(jump / max(coarse, TINY), *TIME_FALL_BY_PHOTONS))
        return _ErrorInTime(enough, error, by_photons)

    def the_worst() -> int:
        """The frame that changes most with photons and segments together, as few of both show it."""
        few, more = PHOTONS_OF_ALL_FRAMES
        if len(at(few, 1)) == 1:
            return 0
        pairs = [(at(few, 1), at(more, 1))]
        if 1 in following:
            pairs.append((at(few, 1), at(few, following[1])))
        return int(np.argmax(np.sum([_changes(a, b) ** 2 for a, b in pairs], axis=0)))

    frame = the_worst()
    picture.keep(frame)
    found = {key: pictures[frame : frame + 1] for key, pictures in found.items()}
    photons, segments = FIRST_PHOTONS, 1
    while True:
        # Errors of fewer photons decide nothing, and few photons in several segments take long: with cells so large
        # light begins or ends in most, and a hundred parts of the shutter are looked at.
        if 4 * photons >= FEWEST_SEEN:
            space = in_space(photons, segments)
            time = in_time(photons, segments, space.fall)
            error = _both(space, time)
            most = min(4.0**LARGEST_EXTRAPOLATION * photons, MOST_PHOTONS / segments)
            if error(most) <= wanted:
                fewest = _fewest(error, wanted, FIRST_PHOTONS, most)
                if time.photons < min(fewest, 4 * photons) and 2.0 * time(fewest) > wanted:
                    # What few photons take for an error in time may go with more of them: more are looked at.
                    time = in_time(photons, segments, space.fall, finest=True)
                    fewest = _fewest(_both(space, time), wanted, FIRST_PHOTONS, most)
                for _ in range(MOST_BETWEEN):
                    tried = fewest
                    if fewest <= space.counts[0] > FEWEST_PHOTONS:
                        tried = FEWEST_PHOTONS
                    elif not space.is_steep_at(fewest):
                        break
                    space = space.knowing(tried, _change(at(tried, segments), at(space.counts[-1], segments)))
                    fewest = _fewest(_both(space, time), wanted, min(space.counts), most)
                return Choice(fewest, segments, _both(space, time)(fewest))
            if 4 * photons * segments >= MOST_PHOTONS:
                return Choice(4 * photons, segments, error(4 * photons))
            if segments in following:
                more = following[segments]
                by_photons = math.log(error(photons) / error(4 * photons)) / math.log(4)
                with_segments = max(math.hypot(space(photons), TIME_FALL[0] * time(photons)), TINY)
                by_segments = math.log(error(photons) / with_segments) / math.log(more / segments)
                if by_segments > by_photons:
                    # Errors in space may have been those of photons that landed far off: fewer may do now.
                    photons, segments = max(FIRST_PHOTONS, photons // 16), more
                    continue
        photons *= 4


@dataclass(frozen=True)
class _ErrorInTime:
    """Error in time by the number of photons in each segment.

    Attributes:
        photons: Those that it was measured with; fewer err as much.
        error: With these.
        fall: How it falls from each number to four times as many.
    """

    photons: float
    error: float
    fall: float

    def __call__(self, photons: float) -> float:
        return self.error * self.fall ** max(0.0, math.log(photons / self.photons) / math.log(4))


@dataclass(frozen=True)
class _ErrorInSpace:
    """Error by the number of photons in each segment: a power law between those seen, and beyond them.

    Attributes:
        counts: Numbers of photons, each four times the one before.
        errors: Of these.
        fall: How errors fall from one to the next beyond the last.
    """

    counts: Sequence[int]
    errors: Sequence[float]
    fall: float

    @classmethod
    def of(cls, counts: Sequence[int], pictures: Sequence[np.ndarray]) -> _ErrorInSpace:
        steps = [_change(a, b) for a, b in itertools.pairwise(pictures)][-3:]
        means = [np.mean(picture, dtype=np.float64) for picture in pictures[-len(steps) - 1 :]]
        missing = [abs(a - b) > LARGEST_MISSING * means[-1] for a, b in itertools.pairwise(means)]
        # What is missing at edges goes with the width of cells, however fast the first of it comes back.
        least = FALL_AT_EDGES if any(missing) else FALL[0]
        if any(missing):
            steps = steps[min(len(missing) - missing[::-1].index(True), len(steps) - 1) :]
        fall = latest = UNKNOWN_FALL
        if len(steps) > 1:
            # One step alone may be small, or large, by chance.
            fall = (steps[-1] / max(steps[0], TINY)) ** (1.0 / (len(steps) - 1))
            # Once cells are finer than folds, errors fall faster and faster.
            latest = min(fall, math.sqrt(fall * steps[-1] / max(steps[-2], TINY)))
            fall, latest = (float(np.clip(value, least, FALL[1])) for value in (fall, latest))
        last = latest * steps[-1] / (1.0 - latest**2)
        before = [math.hypot(_change(picture, pictures[-1]), last) for picture in pictures[:-2]]
        return cls(counts, (*before, last / latest, last), fall)

    def is_steep_at(self, photons: float) -> bool:
        """Whether little is known of so many photons: that errors fall by ``STEEP`` from fewer to more of them."""
        number = int(np.searchsorted(self.counts, photons))
        if number in (0, len(self.counts)) or photons in self.counts:
            return False
        return self.errors[number - 1] > STEEP * self.errors[number]

    def knowing(self, photons: int, change: float) -> _ErrorInSpace:
        """The same with the change from a picture with so many photons to that with the most."""
        found = dict(zip(self.counts, self.errors, strict=True)) | {photons: math.hypot(change, self.errors[-1])}
        return replace(self, counts=sorted(found), errors=[found[count] for count in sorted(found)])

    def __call__(self, photons: float) -> float:
        errors = np.maximum(self.errors, TINY)
        beyond = max(0.0, math.log(photons / self.counts[-1]) / math.log(4))
        between = np.interp(math.log(photons), np.log(self.counts), np.log(errors))
        return math.exp(between) * self.fall**beyond


def _both(space: _ErrorInSpace, time: _ErrorInTime) -> Callable[[float], float]:
    """The error in space and in time together, by photons."""
    return lambda photons: math.hypot(space(photons), time(photons))


def _fewest(error: Callable[[float], float], wanted: float, least: int, most: float) -> int:
    """The fewest photons from ``least`` to ``most`` from which on the error stays within ``wanted``."""
    steps = least * (most / least) ** np.linspace(1.0, 0.0, 400)
    fewest = most
    for photons in steps:
        if error(photons) > wanted:
            break
        fewest = photons
    return math.ceil(fewest)


def _change(a: np.ndarray, b: np.ndarray) -> float:
    """RMS difference of the frame [f, n, 3] that differs most, by its own light: no frame is to err by more."""
    return float(_changes(a, b).max())


def _changes(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """RMS difference of each frame [f, n, 3] by its own light, shape [f]; zero where all are dark."""
    brightness = b.mean(axis=(1, 2))
    brightness = np.maximum(brightness, LEAST_LIGHT * brightness.mean())
    if not brightness.all():
        return np.zeros(len(a))
    return np.sqrt(np.mean(((a - b) / brightness[:, None, None]) ** 2, axis=(1, 2)))
