"""How light goes on between the instants at which cells are traced."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.trajectories.instants import joined_in_time

EDGES = np.array([0.0, 0.5, 1.5, 2.0, 2.25, 3.0]) / 3.0 - 0.5


def parts(ids: list[list[int]], place, power) -> list[PhotonMap]:
    """Photons of each part, which are at ``place(t, id)`` along x and shine with ``power(t, id)``."""
    maps = []
    for first, last, mine in zip(EDGES[:-1], EDGES[1:], ids, strict=True):
        time, length, ids_of_part = 0.5 * (first + last), last - first, np.array(mine, np.int64)
        step = 1e-4
        speed = (place(time + step, ids_of_part) - place(time - step, ids_of_part)) / (2 * step)
        along_x = np.array([1.0, 0.0, 0.0])
        maps.append(
            replace(
                PhotonMap.empty(),
                ids=ids_of_part,
                position=(place(time, ids_of_part)[:, None] * along_x).astype(np.float32),
                dxdt=(length * speed[:, None] * along_x).astype(np.float32),
                flux=(length * power(time, ids_of_part)[:, None] * np.ones(3)).astype(np.float32),
                receiver=np.zeros(len(mine), np.int32),
                path=np.full(len(mine), 7, np.uint32),
                time=time,
                duration=length,
            )
        )
    return maps


def test_light_that_accelerates_and_grows_evenly_does_so_within_its_parts():
    maps = parts([[3, 5, 8]] * 5, lambda t, n: n * t**2 - t, lambda t, n: n * (2.0 + t) ** 2)
    for photons, first, last in zip(joined_in_time(maps), EDGES[:-1], EDGES[1:], strict=True):
        length = last - first
        # 2 n d², where D_t x is linear in time.
        np.testing.assert_allclose(photons.trajectory.dxdtt[:, 0], 2 * photons.ids * length**2, rtol=1e-3)
        if first > EDGES[0] and last < EDGES[-1]:
            exact = photons.ids / 3 * ((2 + last) ** 3 - (2 + first) ** 3)
            np.testing.assert_allclose(photons.flux[:, 0], exact, rtol=1e-5)
            # The slope of a parabola between neighbours that lie alike to either side; here they do up to a part.
            slope = length * 2 / (2 + photons.time)
            np.testing.assert_allclose(photons.trajectory.gain, slope, rtol=0.1)


def test_light_that_has_come_to_rest_does_not_go_back():
    """As total reflection ends light rushes at first, and hardly moves soon after."""
    rests = -0.3

    def place(t, n):
        return 1000.0 * np.minimum(t - rests, 0.0) + t + 0 * n

    maps = parts([[6]] * 5, place, lambda t, n: 1.0 + 0 * (t + n))
    first, second, *others = joined_in_time(maps)
    # Half of D_tt x is what D_t x changes by from the middle of a part to its ends.
    assert 0.5 * np.abs(first.trajectory.dxdtt[0, 0]) <= np.abs(first.dxdt[0, 0]) * (1 + 1e-5)
    # The third part and the second go alike, the first goes a thousand times as fast.
    assert np.abs(second.trajectory.dxdtt).max() < 0.01
    assert max(np.abs(photons.trajectory.dxdtt).max() for photons in others) < 0.01


def test_light_that_begins_or_ends_or_takes_another_path_has_nothing_to_go_on_from():
    ids = [[1], [1], [2], [2], []]
    maps = parts(ids, lambda t, n: t**2 + 0 * n, lambda t, n: 1.0 + t + 0 * n)
    maps[3] = replace(maps[3], path=maps[3].path + np.uint32(1))
    found = joined_in_time(maps)
    for photons, before in zip(found[:2], maps[:2], strict=True):
        # One side tells how fast, two how the mean is.
        assert (photons.trajectory.dxdtt[:, 0] > 0).all()
        np.testing.assert_array_equal(photons.flux, before.flux)
    for photons in found[2:]:
        assert not photons.trajectory.dxdtt.any() and not photons.trajectory.gain.any()


@pytest.mark.parametrize("least", [1e-6, 1e-38])
def test_light_that_grows_at_once_is_never_below_zero_nor_without_bound(least):
    maps = parts([[4]] * 5, lambda t, n: t + 0 * n, lambda t, n: least + (np.abs(t) > 0.2) + 0 * n)
    for photons, before in zip(joined_in_time(maps), maps, strict=True):
        assert (photons.flux > 0).all() and (photons.flux <= 1.5 * before.flux).all()
        assert (np.abs(photons.trajectory.gain) <= 1).all()
