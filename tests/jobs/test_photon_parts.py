"""Photons of frames that are done come back as they were traced, and only where they are those of the sequence."""

import dataclasses

import numpy as np
import pytest

from tpdwarp.jobs.fingerprint import Fingerprint
from tpdwarp.jobs.photon_parts import PhotonParts
from tpdwarp.photons.paths import PhotonPaths
from tpdwarp.photons.record import PhotonRecord
from tpdwarp.photons.thinning import thinning_ranks
from tpdwarp.settings import Settings

STATISTICS = '{"photons": 5, "energy": {"sent": 2.0}, "seconds": {"trace": 0.5}}'


def photons(count, seed=1):
    draw = np.random.default_rng(seed)
    vectors = [draw.normal(size=(count, 3)) for _ in range(6)]
    integers = [draw.integers(0, 3, count).astype(np.int32) for _ in range(2)]
    emission = np.stack(np.unravel_index(np.arange(count), (64, 64)), axis=-1) + 0.5
    return PhotonRecord(np.arange(count), *vectors, emission, *integers, ("/World/Floor", "/Wände/λ", "/C"))


def parts(tmp_path, curves=None, **changes):
    return PhotonParts(tmp_path / "a.debug.usdc", Fingerprint.of(Settings.of(None, **changes), "digest"), curves)


def test_photons_come_back_bit_by_bit(tmp_path):
    stored = photons(5)
    parts(tmp_path).store(2.0, stored, STATISTICS)
    loaded = parts(tmp_path).load(2.0).photons
    for field in dataclasses.fields(PhotonRecord):
        before, after = getattr(stored, field.name), getattr(loaded, field.name)
        np.testing.assert_array_equal(before, after)
        assert getattr(before, "dtype", None) == getattr(after, "dtype", None)
    kept = parts(tmp_path).kept(2.0)
    assert (kept.photons, kept.energy.sent, kept.seconds) == (5, 2.0, {"trace": 0.5})


def test_paths_come_back_with_their_photons(tmp_path):
    points, counts = np.random.default_rng(2).normal(size=(7, 3)), np.array([3, 4], np.int32)
    parts(tmp_path).store(2.0, photons(5), STATISTICS, PhotonPaths(photons(2, seed=3), counts, points))
    paths = parts(tmp_path).load(2.0).paths
    np.testing.assert_array_equal(paths.points, points)
    np.testing.assert_array_equal(paths.counts, counts)
    np.testing.assert_array_equal(paths.photons.positions, photons(2, seed=3).positions)


def test_photons_of_another_sequence_do_not_count(tmp_path):
    parts(tmp_path).store(2.0, photons(5), STATISTICS)
    assert parts(tmp_path).load(3.0) is None
    assert parts(tmp_path, seed=7).load(2.0) is None and parts(tmp_path, curves=3).load(2.0) is None
    assert parts(tmp_path, seed=7).kept(2.0) is None
    assert parts(tmp_path, threads=7).load(2.0) is not None


@pytest.mark.parametrize("keep", [0, 1, 100, -300, -1])
def test_archives_that_are_cut_do_not_count(tmp_path, keep):
    parts(tmp_path).store(2.0, photons(50), STATISTICS)
    path = parts(tmp_path).path(2.0)
    path.write_bytes(path.read_bytes()[:keep])
    assert parts(tmp_path).load(2.0) is None


def test_archives_with_a_flipped_bit_or_of_something_else_do_not_count(tmp_path):
    parts(tmp_path).store(2.0, photons(50), STATISTICS)
    path = parts(tmp_path).path(2.0)
    whole = path.read_bytes()
    for place in (whole.index(b"positions") + 500, len(whole) // 2):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 4]) + whole[place + 1 :])
        assert parts(tmp_path).load(2.0) is None
    path.write_text("<html></html>")
    assert parts(tmp_path).load(2.0) is None
    np.savez(path, fingerprint=np.array([{}], dtype=object))
    assert parts(tmp_path).load(2.0) is None


def test_no_more_photons_are_kept_than_the_layer_may_need(tmp_path):
    parts(tmp_path, curves=10).store(2.0, photons(1000), STATISTICS)
    kept = parts(tmp_path, curves=10).load(2.0).photons
    ranks = thinning_ranks(photons(1000))
    assert sorted(kept.ids) == sorted(np.argsort(ranks)[:11])
