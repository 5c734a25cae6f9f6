"""Laws of choosing photons and segments for a wanted error, and how near to it the true error comes."""

from __future__ import annotations

import json
import logging
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tpdwarp
from tests.small_stage import write_stage
from tests.view.scenes import Source, wave_source
from tpdwarp.errors import InputError
from tpdwarp.io.images import read_stored
from tpdwarp.jobs.opening import open_scene, shutter_of, spread_shutters
from tpdwarp.rendering import error_target
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.error_target import Choice, chosen, enough_samples, numbers_of_segments, settled
from tpdwarp.rendering.frame import render_frame
from tpdwarp.rendering.pilot import Pilot
from tpdwarp.scene.description import Shutter
from tpdwarp.settings import Settings
from usd_scenes.oracle import Wave, irradiance_average

SCENES = Path(__file__).resolve().parents[2] / "usd_scenes"
FOLDED = Wave(wavelength=0.65, speed=0.65 / 8)
OPEN = Shutter(0, 0, 1)
DOUBLED = (1, 2, 4, 8, 16, 32, 64)


class Made:
    """Pictures with errors of known size: space·m^−slope, new for each m, and time·K^−2, always of the same shape."""

    def __init__(self, space: float, slope: float, time: float = 0.0) -> None:
        self.space, self.slope, self.time = space, slope, time
        self.most = 0
        self.seen: set[tuple[int, int]] = set()

    def __call__(self, photons: int, segments: int) -> np.ndarray:
        self.most = max(self.most, photons * segments)
        self.seen.add((photons, segments))
        random = np.random.default_rng(photons)
        noise = self.space * photons**-self.slope * random.standard_normal((1, 4000, 3))
        return 1.0 + noise + self.time * segments**-2 * np.random.default_rng(1).standard_normal((1, 4000, 3))

    def keep(self, frame: int) -> None:
        assert frame == 0

    def error(self, photons: int, segments: int) -> float:
        return math.hypot(self.space * photons**-self.slope, self.time * segments**-2)


class Missing(Made):
    """Pictures whose light is far off with few photons, and then errs at edges, by the width of cells."""

    def __call__(self, photons: int, segments: int) -> np.ndarray:
        picture = super().__call__(photons, segments)
        if photons < 1000:
            picture = 0.7 * picture + 2.0 * np.random.default_rng(photons + 1).standard_normal(picture.shape)
        return picture


class Dark:
    """Pictures of nothing."""

    def __call__(self, photons: int, segments: int) -> np.ndarray:
        return np.zeros((1, 10, 3))

    def keep(self, frame: int) -> None:
        assert frame == 0


class Several:
    """Pictures of several frames of power laws of their own; how many photons were traced for each."""

    def __init__(self, *frames: Made) -> None:
        self.frames, self.traced = list(frames), [0] * len(frames)
        self._looked_at = list(range(len(frames)))

    def __call__(self, photons: int, segments: int) -> np.ndarray:
        for number in self._looked_at:
            self.traced[number] += photons * segments
        return np.concatenate([self.frames[number](photons, segments) for number in self._looked_at])

    def keep(self, frame: int) -> None:
        self._looked_at = [self._looked_at[frame]]


@pytest.mark.parametrize("wanted", [0.1, 0.05, 0.02, 0.01])
@pytest.mark.parametrize("slope", [0.5, 0.75, 1.0])
@pytest.mark.parametrize("time", [0.0, 0.02, 0.2])
def test_the_choice_errs_as_wanted_where_errors_follow_power_laws(wanted, slope, time):
    made = Made(4.0, slope, time)
    choice = chosen(made, wanted, DOUBLED)
    assert 0.5 * wanted < made.error(choice.photons, choice.segments) < 1.5 * wanted
    assert choice.error <= wanted
    # The pilot costs no more than a few frames would, of a few pixels, or than what it must see.
    assert made.most <= choice.segments * max(2 * error_target.FEWEST_SEEN, 16 * choice.photons)


@pytest.mark.parametrize("wanted", [0.2, 0.1, 0.05])
def test_light_that_few_photons_miss_does_not_tell_how_errors_fall(wanted):
    made = Missing(8.0, 0.5)
    choice = chosen(made, wanted, DOUBLED)
    assert 0.5 * wanted < made.error(choice.photons, choice.segments) < 1.5 * wanted


def test_fewer_photons_in_several_segments_than_decide_are_not_looked_at():
    """Those take longest: with cells so large light begins or ends in most of them."""
    made = Made(4.0, 0.75, 0.02)
    assert chosen(made, 0.1, DOUBLED).segments == 1
    assert min(photons for photons, segments in made.seen if segments > 1) == error_target.FEWEST_SEEN // 4


@pytest.mark.parametrize(("wanted", "looked_at"), [(0.6, True), (0.1, False)])
def test_the_fewest_photons_are_looked_at_only_where_few_are_enough(wanted, looked_at):
    made = Made(4.0, 0.5, 0.0)
    choice = chosen(made, wanted, DOUBLED)
    assert ((error_target.FEWEST_PHOTONS, 1) in made.seen) is looked_at
    assert 0.5 * wanted < made.error(choice.photons, choice.segments) < 1.5 * wanted


def test_the_cheaper_of_photons_and_segments_is_raised():
    assert chosen(Made(8.0, 1.0, 0.0), 0.01, DOUBLED).segments == 1
    assert chosen(Made(8.0, 1.0, 0.5), 0.01, DOUBLED).segments >= 4
    assert chosen(Made(8.0, 1.0, 0.5), 0.4, DOUBLED).segments == 1
    assert chosen(Made(8.0, 1.0, 0.5), 0.01, (1,)).segments == 1


@pytest.mark.parametrize("wanted", [0.1, 0.02])
def test_the_frame_that_errs_most_decides_and_the_others_are_hardly_looked_at(wanted):
    frames = Made(4.0, 0.75), Made(4.0, 0.75, 0.2), Made(1.0, 0.75, 0.02)
    pictures = Several(*frames)
    choice = chosen(pictures, wanted, DOUBLED)
    assert 0.5 * wanted < frames[1].error(choice.photons, choice.segments) < 1.5 * wanted
    others = max(pictures.traced[0], pictures.traced[2])
    assert others <= 2 * sum(error_target.PHOTONS_OF_ALL_FRAMES) < pictures.traced[1]


class Seen:
    """Pictures whose error by camera samples is that of a stratified mean."""

    def __init__(self, error: float, moves: bool) -> None:
        self.view_moves, self._error = moves, error

    def __call__(self, photons: int, segments: int, samples: int) -> np.ndarray:
        noise = np.random.default_rng(samples).standard_normal((1, 4000, 3))
        return 1.0 + self._error * samples**-0.75 * noise


@pytest.mark.parametrize(
    ("error", "moves", "samples"), [(0.5, True, 64), (0.1, True, 16), (0.03, True, 4), (0.5, False, 4)]
)
def test_samples_are_raised_until_what_moves_past_pixels_adds_little(error, moves, samples):
    wanted = 0.05
    found, by_samples = enough_samples(Seen(error, moves), Choice(4096, 1, wanted), wanted, 4)
    assert found == samples
    assert by_samples == pytest.approx(error * samples**-0.75 if moves else 0.0, rel=0.1)


@pytest.mark.parametrize("moves", [False, True])
def test_the_view_moves_where_the_camera_sees_something_move_not_where_light_does(moves):
    def at(shutter: Shutter):
        scene = wave_source(FOLDED, columns=65).at(shutter)
        camera = replace(scene.camera, position_motion=np.array([0.1 * moves * shutter.exposure, 0.0, 0.0]))
        return replace(scene, camera=camera)

    pilot = Pilot(Source(at), Settings(photons=64), [OPEN], 32, 4)
    pilot(64, 1)
    assert pilot.view_moves == moves


def test_smaller_errors_cost_more():
    choices = [chosen(Made(8.0, 0.75, 0.05), wanted, DOUBLED) for wanted in (0.2, 0.1, 0.03, 0.01)]
    costs = [choice.photons * choice.segments for choice in choices]
    assert costs == sorted(costs) and costs[0] < costs[-1]


@pytest.mark.parametrize("wanted", [1e-2, 1e-3, 1e-4])
def test_no_choice_takes_more_photons_than_there_may_be(wanted, monkeypatch):
    monkeypatch.setattr(error_target, "MOST_PHOTONS", 1 << 16)
    choice = chosen(Made(40.0, 0.5), wanted, (1,))
    assert choice.photons * choice.segments <= 1 << 16 and choice.error > wanted


def test_no_light_needs_few_photons():
    choice = chosen(Dark(), 0.02, DOUBLED)
    assert (choice.photons, choice.segments) == (error_target.FEWEST_PHOTONS, 1) and choice.error < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize(("wave", "exposure"), [(Wave(), 0), (Wave(), 1), (Wave(), 3), (FOLDED, 1), (FOLDED, 2)])
@pytest.mark.parametrize("wanted", [0.1, 0.05, 0.02])
def test_the_true_error_is_within_a_factor_of_two_of_what_was_asked(wave, exposure, wanted):
    source, shutter = wave_source(wave), Shutter(0, 0, exposure)
    truth = irradiance_average(np.linspace(-1, 1, 257), wave, 0, exposure, 1 + 255 * (exposure > 0), "smooth")
    settings = Settings(target_error=wanted, aovs=("irradiance",))
    resolved, target = settled(source, settings, [shutter], 256, 32)
    assert resolved.target_error is None and target.photons == resolved.photons
    found = render_frame(RenderContext(source, resolved), shutter, 256, 32).channels["irradiance.R"].astype(float)
    error = np.sqrt(np.mean((found - truth) ** 2)) / truth.mean()
    # Light that folds falls faster and faster as its cells get finer, which fewer photons do not foretell.
    least = 0.3 if wave is FOLDED and exposure == 2 else 0.5
    assert least * wanted < error < 2 * wanted
    # What is expected to err by more is warned about.
    assert target.expected <= 1.05 * wanted


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scene", "exposure", "photons", "instants"), [("sea", 1.0, 1 << 16, 32), ("mirror", 0.0, 1 << 21, 1)]
)
def test_shipped_scenes_err_as_wanted_in_frames_that_the_pilot_does_not_see(scene, exposure, photons, instants):
    wanted, frame = 0.05, 9.0
    base = Settings(image_width=48, exposure=exposure, aovs=("caustic",))
    source = open_scene(SCENES / f"{scene}.usdc", base, False)
    shutter, size = shutter_of(source, frame, base), source.resolution()

    def light(settings: Settings) -> np.ndarray:
        channels = render_frame(RenderContext(source, settings), shutter, *size).channels
        return np.stack([channels[f"caustic.{c}"] for c in "RGB"]).astype(float)

    def error(found: np.ndarray, truth: np.ndarray) -> float:
        return float(np.sqrt(np.mean((found - truth) ** 2)) / truth.mean())

    exact = Settings.of(base, estimator="accumulation")
    truth = light(Settings.of(exact, photons=photons, accumulation_times=instants))
    coarse = light(Settings.of(exact, photons=photons // 4, accumulation_times=max(1, instants // 2)))
    # Its own error falls by half or more from one to the other, so it is no larger than their difference.
    assert error(coarse, truth) < 0.5 * wanted
    seen = spread_shutters(source, base)
    assert frame not in [pilot.frame for pilot in seen]
    chosen_settings, _ = settled(source, Settings.of(base, target_error=wanted), seen, *size)
    assert 0.5 * wanted < error(light(chosen_settings), truth) < 2 * wanted


@pytest.mark.slow
def test_a_turning_cylinder_errs_as_wanted_beside_brute_force_that_took_half_an_hour():
    """Both frames of scripts/benchmarks/converged, which four million photons at each of 16 instants made."""
    wanted = 0.1
    with np.load(SCENES.parent / "scripts" / "benchmarks" / "converged" / "cylinder-from-above.npz") as kept:
        truth, own_error = kept["light"].astype(float), float(kept["error"])
    assert own_error < 0.1 * wanted
    base = Settings(image_width=64, camera="TopOrtho", exposure=1.0, aovs=("caustic",))
    source = open_scene(SCENES / "cylinder.usdc", base, False)
    seen = spread_shutters(source, base)
    assert not {5.0, 14.0} & {pilot.frame for pilot in seen}
    chosen_settings, _ = settled(source, Settings.of(base, target_error=wanted), seen, *source.resolution())
    shutters = [shutter_of(source, frame, base) for frame in (5.0, 14.0)]
    context = RenderContext(source, chosen_settings)
    frames = [render_frame(context, shutter, *source.resolution()) for shutter in shutters]
    found = np.stack([frame.channels["caustic.R"] for frame in frames]).astype(float)
    relative = (found - truth) / truth.mean(axis=(1, 2), keepdims=True)
    assert 0.5 * wanted < np.sqrt(np.mean(relative**2)) < 2 * wanted


def test_the_pilot_sees_whole_frames():
    """Between time samples vertices turn corners inside a shutter that a frame's own never sees."""
    base = Settings(exposure=1.0)
    source = open_scene(SCENES / "wave.usdc", base, False)
    assert all(shutter.frame == round(shutter.frame) for shutter in spread_shutters(source, base))


@pytest.mark.parametrize(
    ("shutter", "numbers"),
    [((0.0, 1.0), DOUBLED), ((-0.25, 0.25), DOUBLED), ((0.0, 3.0), (1, 3, 6, 12, 24, 48)), ((0.0, 0.0), (1,))],
)
def test_segments_to_choose_from_begin_where_samples_are(shutter, numbers):
    base = Settings(shutter=shutter)
    source = open_scene(SCENES / "wave.usdc", base, False)
    assert numbers_of_segments(source, spread_shutters(source, base)) == numbers


def test_the_choice_is_one_of_the_numbers_of_segments():
    made = Made(8.0, 1.0, 0.5)
    choice = chosen(made, 0.01, (1, 3, 6, 12))
    assert choice.segments in (6, 12) and made.error(choice.photons, choice.segments) < 0.015


def test_a_dark_frame_is_not_made_exact_by_a_bright_one():
    """The frame that errs most by its own light counts; one that is nearly black by no less than a tenth of all."""
    lights = np.array([1.0, 0.5, 1e-6])[:, None, None] * np.ones((3, 50, 3))
    wrong = lights + np.array([0.0, 0.05, 0.0])[:, None, None]
    assert error_target._change(wrong, lights) == pytest.approx(0.1)
    assert error_target._change(lights + 1e-6, lights) < 1e-4


def test_what_cannot_be_reached_is_said(caplog, monkeypatch):
    monkeypatch.setattr(error_target, "MOST_PHOTONS", 4096)
    with caplog.at_level(logging.WARNING):
        _, target = settled(wave_source(FOLDED), Settings(target_error=0.001), [OPEN], 64, 8)
    assert "out of reach" in caplog.text and target.expected > 0.001


def test_frames_say_what_was_wanted_and_what_is_expected(tmp_path):
    stage = write_stage(tmp_path / "small.usda")
    result = tpdwarp.render(stage, tmp_path / "f.####.exr", frames=2, target_error=0.1, stats=tmp_path / "s.json")
    metadata = read_stored(str(tmp_path / "f.0002.exr")).metadata
    used = json.loads(metadata["tpdwarp:settings"])
    assert metadata["tpdwarp:targetError"] == pytest.approx(0.1)
    assert metadata["tpdwarp:expectedError"] == pytest.approx(result.target.expected, rel=1e-6)
    assert (used["photons"], used["segments"]) == (result.target.photons, result.target.segments)
    assert json.loads((tmp_path / "s.json").read_text())["target_error"]["wanted"] == 0.1
    # Rendered with what was chosen, the same pixels come out.
    again = tpdwarp.render(stage, tmp_path / "g.####.exr", frames=2, **{n: used[n] for n in ("photons", "segments")})
    assert again.ok
    first, second = (read_stored(str(tmp_path / f"{name}.0002.exr")).pixels for name in "fg")
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"target_error": 0.0}, "must lie in"),
        ({"target_error": 2.0}, "must lie in"),
        ({"target_error": math.nan}, "must lie in"),
        ({"target_error": 0.1, "photons": 64}, "leave photons out"),
        ({"target_error": 0.1, "segments": 2}, "leave segments out"),
        ({"target_error": 0.1, "estimator": "pd"}, "leave estimator"),
        ({"target_error": 0.1, "kernel": "cone"}, "leave estimator"),
    ],
)
def test_what_does_not_go_together_is_refused(changes, words):
    with pytest.raises(InputError, match=words):
        Settings.of(**changes)


def test_presets_leave_photons_to_the_wanted_error():
    assert Settings.of(preset="final", target_error=0.1).samples == Settings.of(preset="final").samples
