import pytest

from tpdwarp.errors import InputError
from tpdwarp.presets import PRESETS
from tpdwarp.settings import Settings
from tpdwarp.studies.cases import Sweep


def test_each_method_is_crossed_with_what_it_heeds_and_nothing_else():
    sweep = Sweep(photons=(10, 20), segments=(1, 2, 3), kernels=("cone", "uniform"), neighbours=(5, 6, 7))
    counts = {}
    for case in sweep.cases(Settings()):
        counts[case.settings.estimator] = counts.get(case.settings.estimator, 0) + 1
    assert counts == {"tpd": 12, "pd": 4, "distribution": 4, "accumulation": 4, "tdpm": 6}


def test_no_case_comes_twice():
    assert len(Sweep(methods=("pd", "pd"), photons=(9, 9)).cases(Settings())) == 1


def test_cases_with_few_photons_come_first_at_each_exposure():
    cases = Sweep(photons=(30, 10, 20), exposures=(0.5, 2.0)).cases(Settings())
    assert [case.exposure for case in cases] == sorted(case.exposure for case in cases)
    photons = [case.settings.photons for case in cases if case.exposure == 2.0]
    assert photons == sorted(photons)


def test_settings_that_are_not_swept_are_those_of_the_base():
    for case in Sweep(presets=("paper",)).cases(Settings(seed=7, samples=3)):
        assert (case.settings.seed, case.settings.samples) == (7, 3)


def test_presets_are_tried_as_they_are():
    cases = Sweep(methods=(), presets=tuple(PRESETS), exposures=(1.0,)).cases(Settings())
    assert [case.settings for case in cases] == [Settings.of(preset=name, exposure=1.0) for name in PRESETS]


def test_series_tell_cases_of_equal_photons_apart():
    sweep = Sweep(photons=(10,), kernels=("cone", "uniform"), between=(None, 0), neighbours=(5, 6))
    cases = sweep.cases(Settings())
    assert len({case.series for case in cases}) == len(cases)


@pytest.mark.parametrize("sweep", [Sweep(methods=("tpdd",)), Sweep(presets=("best",)), Sweep(kernels=("box",))])
def test_unknown_names_are_refused(sweep):
    with pytest.raises(InputError, match=r"there are|must be one of"):
        sweep.cases(Settings())
