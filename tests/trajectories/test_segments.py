"""Laws of the number of segments that is chosen for a number of photons."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.estimators.frames import OPEN, SETTINGS, STILL_SCENE, irradiance, rendered, traced
from tests.photons.shapes import MIRROR, ball, box, glass, moving
from tests.photons.traced import lamp, sun
from tests.view.scenes import SUN, WATER, Source, bumpy, floor, looking_down, steady, wave_source
from tpdwarp.clock import Clock
from tpdwarp.errors import InputError
from tpdwarp.jobs.opening import open_scene, shutter_of
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import SceneAtShutter, Shutter
from tpdwarp.settings import Settings
from tpdwarp.trajectories.segments import most_breaks_inside
from usd_scenes.oracle import Wave, irradiance_average
from usd_scenes.shapes import rotation
from usd_scenes.solids import write

SCENES = Path(__file__).resolve().parents[2] / "usd_scenes"
FOLDED = Wave(wavelength=0.65, speed=0.65 / 8)


def chosen(source, exposure: float = 1.0, frame: float = 0.0, **changes) -> int:
    settings = Settings.of(SETTINGS, segments="auto", **changes)
    return RenderContext(source, settings).segmentation.count(Shutter(frame, frame, frame + exposure), Clock())


def test_more_photons_are_worth_more_segments():
    counts = [chosen(wave_source(Wave()), photons=photons) for photons in (1024, 16384, 262144)]
    assert counts == sorted(counts) and counts[-1] > counts[0]
    # As the fourth root of the photons, with errors in time that fall with the third power of the segments.
    assert counts[-1] <= 1.5 * (262144 / 16384) ** (1 / 4) * counts[1]


def test_a_longer_exposure_is_worth_more_segments():
    counts = [chosen(wave_source(Wave()), exposure, photons=65536) for exposure in (0.25, 1.0, 4.0)]
    assert counts == sorted(counts) and counts[-1] >= 2 * counts[0]


def test_light_all_of_which_begins_or_ends_within_the_shutter_takes_two_segments(tmp_path):
    """A prism that turns past total reflection: keyframes know none of its photons at both ends. It errs by .034, .026,
    .033 and .033 in one to four (16 k photons), by .023, .017, .020 and .019 (65 k)."""
    stage, counts = write("prism-turning", tmp_path), []
    for photons in (16384, 65536):
        settings = Settings(photons=photons, exposure=1.0, camera="/World/Camera")
        source = open_scene(stage, settings, False)
        counts.append(RenderContext(source, settings).segmentation.count(shutter_of(source, 1.0, settings), Clock()))
    assert counts == [2, 2]


@pytest.mark.parametrize("name", ["ball-rolling", "torus-turning-45"])
def test_bodies_whose_cells_ride_apart_take_one_segment(tmp_path, name):
    """All their cells are traced in parts of the shutter in one segment: the ball errs by .029, .041 and .033 in one to
    three, the torus by .047, .057 and .058 (16 k photons; truths by .026 and .043)."""
    settings = Settings(photons=16384, exposure=1.0, camera="/World/Camera")
    source = open_scene(write(name, tmp_path), settings, False)
    shutter = shutter_of(source, 1.0, settings)
    assert RenderContext(source, settings).segmentation.count(shutter, Clock()) == 1


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
    context, clock = RenderContext(wave_source(Wave()), Settings.of(SETTINGS, segments="auto")), Clock()
    context.segmentation.count(OPEN, clock)
    assert set(clock.seconds) == {"plan"} and clock.seconds["plan"] > 0
    again = Clock()
    context.segmentation.count(Shutter(3, 3, 4), again)
    assert again.seconds == {}


@pytest.mark.parametrize(
    ("breaks", "segments", "most"),
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
def test_breaks_count_within_segments_not_where_these_begin(breaks, segments, most):
    assert most_breaks_inside(breaks, segments) == most


@pytest.mark.parametrize(("shutter", "parts"), [((-0.5, 0.5), 2), ((-0.25, 0.25), 2), ((0.0, 3.0), 3), ((0.5, 2.0), 3)])
def test_segments_begin_where_a_stage_s_samples_are(shutter, parts):
    """The shipped wave has one sample a frame, between which vertices go straight."""
    base = Settings(image_width=64, shutter=shutter, aovs=("caustic",), photons=65536, segments="auto")
    source = open_scene(SCENES / "wave.usdc", base, False)
    for frame in (3.0, 5.0):
        assert RenderContext(source, base).segmentation.count(shutter_of(source, frame, base), Clock()) % parts == 0


def test_centred_shutters_err_several_times_less_with_segments_that_begin_where_samples_are():
    base = Settings(image_width=64, shutter=(-0.5, 0.5), aovs=("irradiance",), photons=1 << 14)
    source = open_scene(SCENES / "wave.usdc", base, False)

    def light(**changes) -> np.ndarray:
        settings = Settings.of(base, **changes)
        shutter = shutter_of(source, 5.0, settings)
        return irradiance(render_frame(RenderContext(source, settings), shutter, *source.resolution()))

    # Of as many photons a segment as two of them have, so that errors in space are alike.
    truth = light(photons=1 << 17, segments=16)
    auto, one, three = (np.sqrt(np.mean((light(segments=k) - truth) ** 2)) for k in ("auto", 1, 3))
    assert 5 * auto < one and 1.2 * auto < three


def test_light_that_swings_a_whole_period_within_the_shutter_does_not_count_as_at_rest():
    """The water stands in the same place as the shutter opens, in its middle and as it closes."""

    def at(shutter: Shutter) -> SceneAtShutter:
        water = bumpy("/water", WATER, 1.0, False)
        sway = np.outer(np.sin(water.points[:, 0]), (0.1, 0, 0))
        points = water.points + np.sin(4 * np.pi * shutter.middle) * sway
        speed = 4 * np.pi * np.cos(4 * np.pi * shutter.middle) * shutter.exposure
        moved = replace(water, points=points, motions=speed * sway if shutter.exposure else None)
        return SceneAtShutter(shutter, (floor(), moved), (SUN,), looking_down(height=0.6))

    class Sampled(Source):
        def motion_breaks(self, shutter: Shutter) -> list[float]:
            return [time for time in np.arange(-8, 9) / 8 if shutter.open < time < shutter.close]

    assert chosen(Sampled(at), photons=1 << 16) >= 4


def test_light_whose_flux_changes_as_it_goes_takes_more_segments_along_straight_trajectories():
    """A ball that glides below a lamp catches more of its light the nearer it is; below a sun it catches the same.

    Along curved trajectories, flux grows.
    """
    body, way = ball("/ball", (0, 0, 0.9), 0.4, 24, glass()), np.array([0.15, 0.05, 0.0])
    still = np.zeros_like(body.normals)

    def at(light) -> Source:
        def scene(shutter: Shutter) -> SceneAtShutter:
            placed = replace(body, points=body.points + (shutter.middle - 0.5) * way)
            if shutter.exposure:
                placed = replace(placed, motions=np.tile(way * shutter.exposure, (len(still), 1)), normal_motions=still)
            return SceneAtShutter(shutter, (floor(), placed), (light,), looking_down(height=0.05))

        return Source(scene)

    far, near = at(sun()), at(lamp((0.3, 0.2, 2.5)))
    assert chosen(far, photons=1 << 16) == chosen(near, photons=1 << 16) == 1
    counts = [chosen(source, photons=1 << 16, path="straight") for source in (far, near)]
    assert counts[1] >= counts[0] + 2


@pytest.mark.parametrize("samples", [2, 5, 9])
def test_samples_of_a_motion_that_goes_on_evenly_are_worth_no_segments(samples):
    """As caches of simulations have them: a gliding ball took as many segments as it had samples, up to eight."""

    class Sampled(Source):
        def motion_breaks(self, shutter: Shutter) -> list[float]:
            return [time for time in np.linspace(0.0, 1.0, samples) if shutter.open < time < shutter.close]

    def at(shutter: Shutter) -> SceneAtShutter:
        start = moving(ball("/ball", (-0.1, 0.0, 0.8), 0.35, 12, glass()), (0.2, 0.0, 0.0))
        offset = (shutter.middle - 0.5) * start.motions
        gliding = replace(start, points=start.points + offset, motions=shutter.exposure * start.motions)
        return SceneAtShutter(shutter, (floor(), gliding), (SUN,), looking_down(height=0.2))

    assert chosen(Sampled(at), photons=1 << 14) == 1


def test_what_turns_over_takes_no_more_segments_for_the_light_that_passes():
    """Each is traced with fewer photons, and edges pass in all of them: a thin mirror would take 59, and err by ten
    times as much as in one."""
    mirror = box("/mirror", (-0.3, -0.3, 0.795), (0.3, 0.3, 0.805), MIRROR)

    def at(shutter: Shutter) -> SceneAtShutter:
        first, middle, last = (
            (mirror.points - [0, 0, 0.8]) @ rotation((0, 1.0, 0), 75.0 + 25.0 * time).T + [0, 0, 0.8]
            for time in (shutter.open, shutter.middle, shutter.close)
        )
        body = replace(mirror, points=middle, motions=last - first if shutter.exposure else None)
        return SceneAtShutter(shutter, (floor(), body), (sun(),), looking_down(height=0.05))

    settings = Settings(photons=16384, segments="auto")
    assert RenderContext(Source(at), settings).segmentation.count(Shutter(0, 0, 1), Clock()) == 2


def test_bodies_that_cross_each_other_have_a_segment_for_each_part_of_their_way():
    """By more than cells can ride along with both: two such balls err by .25 in one segment, .03 in three."""

    def balls(way: float) -> Source:
        upper, lower = (ball(f"/{z}", (0, 0, z), 0.35, 16, glass()) for z in (1.5, 0.7))
        return steady([floor(), moving(upper, (0.5 * way, 0, 0)), moving(lower, (-0.5 * way, 0, 0))], (sun(),))

    assert [chosen(balls(way), photons=16384) for way in (0.1, 1.0)] == [1, 4]
