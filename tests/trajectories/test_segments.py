"""Laws of the number of segments that is chosen for a number of photons."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.estimators.frames import OPEN, SETTINGS, STILL_SCENE, irradiance, rendered, traced
from tests.view.scenes import SUN, WATER, Source, bumpy, floor, looking_down, wave_source
from tpdwarp.errors import InputError
from tpdwarp.estimators.base import Animation, Clock
from tpdwarp.jobs.sequence import open_scene, shutter_of
from tpdwarp.rendering.frame import Frame, render_frame
from tpdwarp.scene.description import SceneAtShutter, Shutter
from tpdwarp.settings import Settings
from tpdwarp.trajectories.segments import most_corners
from usd_scenes.oracle import Wave, irradiance_average

SCENES = Path(__file__).resolve().parents[2] / "usd_scenes"
FOLDED = Wave(wavelength=0.65, speed=0.65 / 8)


def chosen(source, exposure: float = 1.0, frame: float = 0.0, **changes) -> int:
    settings = Settings.of(SETTINGS, segments="auto", **changes)
    (level,) = Animation(source, settings).levels(Shutter(frame, frame, frame + exposure), Clock())
    return level.segments


def test_more_photons_are_worth_more_segments():
    counts = [chosen(wave_source(Wave()), photons=photons) for photons in (1024, 16384, 262144)]
    assert counts == sorted(counts) and counts[-1] > counts[0]
    # As the fourth root of the photons, with errors in time that fall with the third power of the segments.
    assert counts[-1] <= 1.5 * (262144 / 16384) ** (1 / 4) * counts[1]


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


RIPPLES, SWELL = Wave(wavelength=0.1625, amplitude=Wave().amplitude / 64, speed=0.0), Wave(speed=1.3 / 2)


def beside_each_other() -> Source:
    """Ripples at rest (y > 0) beside a swell that passes by half its length a frame (y < 0)."""

    def at(shutter: Shutter) -> SceneAtShutter:
        sheets = []
        for wave, path, (low, high) in ((RIPPLES, "/still", (0.0, 2.0)), (SWELL, "/swell", (-2.0, 0.0))):
            scene = wave_source(wave).at(shutter)
            (sheet,) = (mesh for mesh in scene.meshes if mesh.path == "/water")
            points = sheet.points.copy()
            points[:, 1] = np.where(points[:, 1] < 0, low, high)
            motions = sheet.motions if wave.speed else None
            turns = sheet.normal_motions if wave.speed else None
            sheets.append(replace(sheet, path=path, points=points, motions=motions, normal_motions=turns))
        return replace(scene, meshes=(floor(), *sheets), camera=looking_down((-1, 1, -1.25, 1.25), height=0.75))

    return Source(at)


def beside_error(**changes) -> tuple[float, Frame]:
    """Root mean square over both halves, away from where they meet, relative to the mean."""
    frame = render_frame(beside_each_other(), OPEN, Settings.of(SETTINGS, samples=4, **changes), 256, 64)
    y = 1.25 - (np.arange(64) + 0.5) * 2.5 / 64
    edges, found = np.linspace(-1, 1, 257), irradiance(frame)
    halves = [
        found[chosen] - irradiance_average(edges, wave, 0, 1, 256, "smooth")
        for wave, chosen in ((RIPPLES, (y > 0.8) & (y < 1.2)), (SWELL, (y < -0.8) & (y > -1.2)))
    ]
    mean = irradiance_average(edges, SWELL, 0, 1, 8).mean()
    return float(np.sqrt(np.mean(np.concatenate(halves) ** 2)) / mean), frame


def test_what_is_fast_takes_segments_of_its_own_beside_what_stands_still():
    fast, still = Animation(beside_each_other(), Settings.of(SETTINGS, segments="auto")).levels(OPEN, Clock())
    assert fast.segments >= 3 and still.segments == 1
    assert still.taken("/still") and not fast.taken("/still")
    # What no still shows belongs to one level as well.
    for path in ("/swell", "/later"):
        assert fast.taken(path) and not still.taken(path)
    alone, _ = beside_error(segments="auto")
    assert alone <= 0.7 * min(beside_error(segments=segments)[0] for segments in (1, 2, 4))


def test_levels_share_the_light_and_have_photons_of_their_own():
    _, whole = beside_error(segments=4)
    _, parts = beside_error(segments="auto")
    # Each lattice counts the light on its own meshes, cell by cell at their rims.
    assert parts.energy.sent == pytest.approx(whole.energy.sent, rel=0.03)
    energy = parts.energy
    went = energy.deposited + energy.escaped + energy.absorbed + energy.lost_total
    assert went == pytest.approx(energy.sent, rel=1e-5)
    assert len(np.unique(parts.photons.ids)) == len(parts.photons)


def test_other_estimators_have_one():
    assert chosen(wave_source(Wave()), photons=1 << 20, estimator="pd") == 1


@pytest.mark.parametrize("photons", [1024, 16384])
@pytest.mark.parametrize(("wave", "exposure"), [(Wave(), 1), (Wave(), 2), (Wave(), 4), (FOLDED, 1), (FOLDED, 2)])
def test_the_choice_is_nearly_as_good_as_the_best(wave, exposure, photons):
    source, shutter = wave_source(wave), Shutter(0, 0, exposure)
    truth = irradiance_average(np.linspace(-1, 1, 257), wave, 0, exposure, 64 * exposure, "smooth")

    def error(segments: int | str) -> float:
        found = irradiance(rendered(source, shutter, columns=256, photons=photons, segments=segments))
        return float(np.sqrt(np.mean((found - truth) ** 2)))

    best = min(error(segments) for segments in (1, 2, 3, 4, 6))
    # Twice the segments, or half, are up to twenty times worse. Below 0.001 of the mean, samples decide; few photons of
    # soft light err by less than 0.01 with either.
    assert error("auto") <= max((1.5 if photons > 1024 else 2.5) * best, 0.001 * truth.mean())


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


@pytest.mark.parametrize(
    ("corners", "segments", "most"),
    [
        ((), 5, 0),
        ((0.5,), 1, 1),
        ((0.5,), 2, 0),
        ((0.5,), 3, 1),
        ((1 / 3, 2 / 3), 1, 2),
        ((1 / 3, 2 / 3), 2, 1),
        ((0.333333, 0.666667), 3, 0),
        ((0.333333, 0.666667), 48, 0),
        ((0.1, 0.2, 0.3, 0.6), 2, 3),
    ],
)
def test_corners_count_within_segments_not_where_these_begin(corners, segments, most):
    assert most_corners(corners, segments) == most


@pytest.mark.parametrize(("shutter", "parts"), [((-0.5, 0.5), 2), ((-0.25, 0.25), 2), ((0.0, 3.0), 3), ((0.5, 2.0), 3)])
def test_segments_begin_where_a_stage_s_samples_are(shutter, parts):
    """The shipped wave has one sample a frame, between which vertices go straight."""
    base = Settings(image_width=64, shutter=shutter, aovs=("caustic",), photons=65536, segments="auto")
    source = open_scene(SCENES / "wave.usdc", base, False)
    for frame in (3.0, 5.0):
        (level,) = Animation(source, base).levels(shutter_of(source, frame, base), Clock())
        assert level.segments % parts == 0


def test_centred_shutters_err_several_times_less_with_segments_that_begin_where_samples_are():
    base = Settings(image_width=64, shutter=(-0.5, 0.5), aovs=("irradiance",), photons=1 << 14)
    source = open_scene(SCENES / "wave.usdc", base, False)

    def light(**changes) -> np.ndarray:
        settings = Settings.of(base, **changes)
        return irradiance(render_frame(source, shutter_of(source, 5.0, settings), settings, *source.resolution()))

    truth = light(photons=1 << 18, segments=16)
    auto, one, three = (np.sqrt(np.mean((light(segments=k) - truth) ** 2)) for k in ("auto", 1, 3))
    assert 5 * auto < one and 1.2 * auto < three
