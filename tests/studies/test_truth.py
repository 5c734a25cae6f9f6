import numpy as np
import pytest

from tests.studies.made import solution
from tpdwarp.errors import InputError
from tpdwarp.settings import Settings
from tpdwarp.studies.truth import TruthSettings, truth_of


def test_the_truth_is_the_mean_of_its_halves_and_knows_its_noise():
    halves = [solution(2.0, 0.1, frames=8, seed=seed) for seed in (1, 2)]
    truth = truth_of(*halves, "scene.usda")
    mean = 0.5 * (halves[0].caustic.astype(float) + halves[1].caustic)
    np.testing.assert_allclose(truth.solution.caustic, mean, rtol=1e-6)
    actual = np.sqrt(np.mean((mean - 2.0) ** 2)) / 2.0
    # Both are root mean squares of as many normal deviates of the same width.
    assert truth.relative_noise == pytest.approx(actual, rel=10 / np.sqrt(mean.size))


def test_the_halves_share_neither_lattice_nor_instants_nor_places_in_the_pixels():
    first, second = TruthSettings(photons=1000, times=8, samples=4).halves(Settings(seed=3), 1.0)
    assert first.photons != second.photons and first.accumulation_times != second.accumulation_times
    assert first.seed != second.seed
    assert first.estimator == second.estimator == "accumulation" and first.exposure == 1.0


def test_the_truth_does_not_depend_on_the_footprints_of_the_cases():
    odd = Settings(kernel="cone", footprint="swept", time_filter="cone", emission="jittered", smoothing=3.0)
    assert TruthSettings().halves(odd, None) == TruthSettings().halves(Settings(), None)


def test_without_light_from_photons_there_is_nothing_to_measure():
    with pytest.raises(InputError, match=r"scene\.usda: no light comes from photons"):
        truth_of(solution(0.0), solution(0.0), "scene.usda")
