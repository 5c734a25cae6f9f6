"""Whole studies of a small stage."""

import sys
from pathlib import Path

import numpy as np
import pytest

from tests.small_stage import write_stage
from tpdwarp.errors import FrameError, InputError
from tpdwarp.io.images import read_image, write_frame
from tpdwarp.studies import run
from tpdwarp.studies.cases import Sweep
from tpdwarp.studies.progress import StudyProgress
from tpdwarp.studies.result import rows_of
from tpdwarp.studies.run import study
from tpdwarp.studies.solutions import Renderer
from tpdwarp.studies.table import table_lines
from tpdwarp.studies.truth import TruthSettings

SWEEP = Sweep(methods=("tpd", "pd"), photons=(64, 256), segments=(1,))
TRUTH = TruthSettings(photons=512, times=4, samples=2)


class Noted(StudyProgress):
    def __init__(self):
        self.steps, self.fresh = [], []

    def start(self, count):
        self.count = count

    def step(self, label):
        self.steps.append(label)

    def done(self, label, seconds, fresh):
        self.fresh.append(fresh)


@pytest.fixture
def stage(tmp_path):
    return write_stage(tmp_path / "stage.usda")


def small(stage, tmp_path, **options):
    settings = {"sweep": SWEEP, "truth": TRUTH, "cache": tmp_path / "cache", "image_width": 12, "samples": 1}
    return study(stage, **{**settings, **options})


def test_every_case_is_measured_against_the_truth_and_shown(stage, tmp_path):
    noted = Noted()
    result = small(stage, tmp_path, progress=noted)
    (part,) = result.exposures
    assert [found.case.settings.photons for found in part.measured] == [64, 64, 256, 256]
    assert part.exposure == 0.5 and result.frames == (2.0,) and result.size == (12, 8)
    assert len(noted.steps) == noted.count == 6 and all(noted.fresh)
    for found in part.measured:
        assert set(found.solution.cpu_seconds) >= {"read", "build", "trace", "gather"}
        assert found.solution.landed > 0 and found.cpu > 0


def test_a_study_goes_on_where_it_stopped_and_finds_the_same(stage, tmp_path, monkeypatch):
    first = small(stage, tmp_path, sweep=Sweep(methods=("tpd",), photons=(64,), segments=(1,)))
    rendered = []
    real = Renderer.render

    def note(self, shutters, settings):
        rendered.append(settings.estimator)
        return real(self, shutters, settings)

    monkeypatch.setattr(Renderer, "render", note)
    second = small(stage, tmp_path)
    assert rendered == ["pd", "tpd", "pd"]
    again = second.exposures[0].measured[0]
    assert again.errors == first.exposures[0].measured[0].errors and again.cpu == first.exposures[0].measured[0].cpu


def test_a_changed_scene_is_rendered_anew(stage, tmp_path):
    small(stage, tmp_path)
    noted = Noted()
    other = write_stage(tmp_path / "other.usda", frames=4)
    small(other, tmp_path, frames="2", progress=noted)
    assert all(noted.fresh)
    noted = Noted()
    small(stage, tmp_path, progress=noted)
    assert not any(noted.fresh)


def test_when_time_is_up_nothing_new_is_begun(stage, tmp_path):
    nothing = small(stage, tmp_path, time_limit=0)
    assert nothing.exposures == () and len(nothing.left) == 5
    one = Sweep(methods=("pd",), photons=(64,))
    small(stage, tmp_path, sweep=one)
    kept = small(stage, tmp_path, time_limit=0)
    assert [found.case.series for found in kept.exposures[0].measured] == ["pd"] and len(kept.left) == 3


def test_exposures_have_truths_of_their_own(stage, tmp_path):
    noted, sweep = Noted(), Sweep(methods=("pd",), photons=(64,), exposures=(0.25, 1.0))
    result = small(stage, tmp_path, sweep=sweep, progress=noted)
    assert [part.exposure for part in result.exposures] == [0.25, 1.0]
    truths = [label for label in noted.steps if label.startswith("truth")]
    assert truths == [f"truth {half} of 2, exposure {exposure}" for exposure in (0.25, 1) for half in (1, 2)]
    assert all(noted.fresh)


def test_several_frames_tell_the_flicker(stage, tmp_path):
    single, several = (small(stage, tmp_path, frames=frames).exposures[0].measured[0] for frames in ("1", "1:3"))
    assert single.errors.flicker is None and several.errors.flicker >= 0
    assert several.solution.caustic.shape == (3, 8, 12, 3)


def test_a_case_that_fails_does_not_end_the_study(stage, tmp_path, monkeypatch):
    real = Renderer.render

    def fail(self, shutters, settings):
        if settings.estimator == "pd":
            raise FrameError("the lamp blew")
        return real(self, shutters, settings)

    monkeypatch.setattr(Renderer, "render", fail)
    result = small(stage, tmp_path)
    assert len(result.failed) == 2 and set(result.failed.values()) == {"the lamp blew"}
    assert [found.case.settings.estimator for found in result.exposures[0].measured] == ["tpd", "tpd"]


def test_all_outputs_are_written(stage, tmp_path):
    outputs = {kind: tmp_path / "out" / f"study.{kind}" for kind in ("csv", "json", "report")}
    small(stage, tmp_path, **outputs)
    assert all(path.stat().st_size > 200 for path in outputs.values())


def test_an_output_that_cannot_be_is_refused_before_anything_is_rendered(stage, tmp_path, monkeypatch):
    monkeypatch.setattr(run, "open_scene", lambda *_, **__: pytest.fail("opened"))
    with pytest.raises(InputError, match="is a folder"):
        small(stage, tmp_path, report=tmp_path)


def test_without_matplotlib_a_report_is_refused_before_anything_is_rendered(stage, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setattr(run, "open_scene", lambda *_, **__: pytest.fail("opened"))
    with pytest.raises(InputError, match=r"needs Matplotlib \(pip install 'tpdwarp\[study\]'\)"):
        small(stage, tmp_path, report=tmp_path / "study.html")


def test_no_output_is_written_over_the_scene(stage, tmp_path):
    shot = tmp_path / "shot.usda"
    shot.write_text(f"#usda 1.0\n(\n    startTimeCode = 1\n    endTimeCode = 3\n    subLayers = [@{stage}@]\n)\n")
    kept = {path: path.read_bytes() for path in (shot, Path(stage))}
    for kind in ("csv", "json", "report"):
        for output in kept:
            with pytest.raises(InputError, match="is part of the scene"):
                small(shot, tmp_path, **{kind: output})
    with pytest.raises(InputError, match="is written by csv and by json"):
        small(shot, tmp_path, csv=tmp_path / "a", json=tmp_path / "a")
    assert {path: path.read_bytes() for path in kept} == kept


def test_a_fixed_shutter_and_swept_exposures_exclude_each_other(stage, tmp_path):
    with pytest.raises(InputError, match=r"^shutter fixes the exposure"):
        small(stage, tmp_path, shutter=(0.0, 0.5), sweep=Sweep(exposures=(1.0,)))


def test_a_scene_without_a_caustic_is_refused(tmp_path):
    matte = write_stage(tmp_path / "matte.usda", glass=False)
    with pytest.raises(InputError, match="no light comes from photons"):
        small(matte, tmp_path)


def test_a_truth_that_was_kept_is_the_truth_again(stage, tmp_path):
    first = small(stage, tmp_path, save_truth=tmp_path / "truth.##.exr")
    again = small(stage, tmp_path, truth_file=tmp_path / "truth.##.exr")
    (one,), (other,) = first.exposures, again.exposures
    assert [found.errors for found in other.measured] == [found.errors for found in one.measured]
    assert other.truth.relative_noise == pytest.approx(one.truth.relative_noise, rel=1e-6)


def test_frames_of_other_renderers_stand_beside_with_their_seconds(stage, tmp_path):
    truth = tmp_path / "truth.##.exr"
    small(stage, tmp_path, save_truth=truth)
    channels, _ = read_image(tmp_path / "truth.02.exr")
    # A renderer whose image is brighter by .01 everywhere, and that knows no caustic layer.
    brighter = {name: channels[name] + np.float32(0.01) for name in "RGB"}
    (tmp_path / "cycles").mkdir()
    write_frame(tmp_path / "cycles" / "f.02.exr", brighter | {"A": channels["A"]}, {}, "float")
    result = small(stage, tmp_path, truth_file=truth, against=[tmp_path / "cycles" / "f.##.exr"], seconds=[2.5])
    found = next(found for found in result.exposures[0].measured if found.case.outside)
    assert (found.case.label, found.cpu) == ("cycles/f", 2.5)
    assert found.errors.rmse == pytest.approx(0.01, rel=1e-4)
    assert "cycles/f" in "\n".join(table_lines(result))
    row = next(row for row in rows_of(result) if row["method"] == "cycles/f")
    assert row["photons"] is None and row["cpu"] == 2.5


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"against": ["a.##.exr"], "seconds": [1.0, 2.0]}, "seconds has 2 values for 1"),
        ({"truth_file": "none.##.exr"}, r"none\.02\.exr"),
        ({"truth_file": "none.##.exr", "sweep": Sweep(exposures=(0.5, 1.0))}, "one exposure"),
    ],
)
def test_frames_that_do_not_fit_a_study_are_refused(stage, tmp_path, options, why):
    with pytest.raises(InputError, match=why):
        small(stage, tmp_path, **options)
