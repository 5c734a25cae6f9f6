"""Laws of the number of segments that is chosen for a number of photons."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.estimators.frames import OPEN, SETTINGS, STILL_SCENE, irradiance, rendered, traced
from tests.oracle import Wave, irradiance_average
from tests.view.scenes import SUN, WATER, Source, bumpy, floor, looking_down, wave_source
from tpdwarp.errors import InputError
from tpdwarp.estimators.base import Animation, Clock
from tpdwarp.scene.description import SceneAtShutter, Shutter
from tpdwarp.settings import Settings

FOLDED = Wave(wavelength=0.65, speed=0.65 / 8)


def chosen(source, exposure: float = 1.0, frame: float = 0.0, **changes) -> int:
    settings = Settings.of(SETTINGS, segments="auto", **changes)
    (level,) = Animation(source, settings).levels(Shutter(frame, frame, frame + exposure), Clock())
    return level.segments


def test_more_photons_are_worth_more_segments():
    counts = [chosen(wave_source(Wave()), photons=photons) for photons in (1024, 16384, 262144)]
    assert counts == sorted(counts) and counts[-1] > counts[0]
    # As the cube root of the photons, if footprints alone decided; their finer folds ask for less.
    assert counts[-1] <= 2 * (262144 / 16384) ** (1 / 3) * counts[1]


def test_a_longer_exposure_is_worth_more_segments():
    counts = [chosen(wave_source(Wave()), exposure, photons=65536) for exposure in (0.25, 1.0, 4.0)]
    assert counts == sorted(counts) and counts[-1] >= 2 * counts[0]


@pytest.mark.parametrize("exposure", [0.0, 1.0])
def test_what_stands_still_takes_one(exposure):
    assert chosen(STILL_SCENE, exposure, photons=1 << 20) == 1


def test_light_that_rides_on_what_moves_straight_on_takes_one():
    def at(shutter: Shutter) -> SceneAtShutter:
        way = np.array([0.2, 0.0, 0.0])
        water = bumpy("/water", WATER, 1.0, False)
        offset = (shutter.middle - 0.5) * way
        motions = np.tile(shutter.exposure * way, (len(water.points), 1)) if shutter.exposure else None
        water = replace(water, points=water.points + offset, motions=motions)
        return SceneAtShutter(shutter, (floor(), water), (SUN,), looking_down(height=0.6))

    assert chosen(Source(at), photons=65536) == 1
    # Seen from the light, one bump after the other passes by.
    assert chosen(Source(at), photons=65536, anchor="light") > 1


def test_few_photons_are_not_spread_thin():
    for photons in (1, 300, 1100):
        assert chosen(wave_source(Wave()), 8.0, photons=photons) <= max(1, photons // 256)


def test_all_frames_have_the_same_number():
    source = wave_source(FOLDED)
    assert len({chosen(source, frame=frame, photons=65536) for frame in (0.0, 1.0, 5.0)}) == 1


def test_other_estimators_have_one():
    assert chosen(wave_source(Wave()), photons=1 << 20, estimator="pd") == 1


@pytest.mark.parametrize(("wave", "exposure"), [(Wave(), 1), (Wave(), 2), (FOLDED, 1), (FOLDED, 2)])
def test_the_choice_is_nearly_as_good_as_the_best(wave, exposure):
    source, shutter = wave_source(wave), Shutter(0, 0, exposure)
    truth = irradiance_average(np.linspace(-1, 1, 257), wave, 0, exposure, 64 * exposure, "smooth")

    def error(segments: int | str) -> float:
        found = irradiance(rendered(source, shutter, columns=256, photons=16384, segments=segments))
        return float(np.sqrt(np.mean((found - truth) ** 2)))

    best = min(error(segments) for segments in (1, 2, 3, 4, 6))
    # Around the best K = (2τ/β)^⅓ the error τ/K² + βK is flat: an eighth more at a factor of 1.5 off.
    assert error("auto") <= 1.25 * best


def test_frames_are_rendered_with_the_number_chosen():
    source = wave_source(Wave())
    count = chosen(source, photons=16384)
    assert count > 1
    auto, given = (traced(source, OPEN, photons=16384, segments=segments).photons for segments in ("auto", count))
    np.testing.assert_array_equal(auto.positions, given.positions)


@pytest.mark.parametrize("changes", [{"segments": "many"}, {"segments": 0}, {"photons": "auto"}])
def test_other_words_are_refused(changes):
    with pytest.raises(InputError, match="must be a whole number above 0"):
        Settings(**changes)


def test_choosing_counts_as_planning_and_is_done_once():
    animation, clock = Animation(wave_source(Wave()), Settings.of(SETTINGS, segments="auto")), Clock()
    animation.levels(OPEN, clock)
    assert set(clock.seconds) == {"plan"} and clock.seconds["plan"] > 0
    again = Clock()
    animation.levels(Shutter(3, 3, 4), again)
    assert again.seconds == {}
