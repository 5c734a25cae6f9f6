"""Photons by rows: footprints take them column by column, and leave them as they are."""

from dataclasses import fields, replace

import numpy as np

from tests.footprints.photons import photon_map, shaped
from tpdwarp.footprints.photon_rows import PhotonRows, stacked
from tpdwarp.photons.photon_map import TrajectoryColumns

PLACES = np.random.default_rng(1).random((40, 3), np.float32)
BENT = tuple(np.random.default_rng(2).random((4, 3)).astype(np.float32))


def maps():
    straight = photon_map(PLACES[:15], (0.1, 0, 0), (0, 0.1, 0), flux=PLACES[:15])
    curved = photon_map(PLACES[15:], (0.1, 0, 0), (0, 0.1, 0), flux=PLACES[15:], trajectory=BENT, gain=0.5)
    return straight, curved


def test_columns_lie_one_below_the_other_as_rows_and_parts_of_the_flux_say():
    straight, curved = maps()
    rows, part = np.array([3, 7, 20]), np.float32([0.5, 0.25, 1.0])
    parts = [PhotonRows(straight), PhotonRows(curved, rows, part)]
    assert np.array_equal(stacked(parts, "position"), np.concatenate([PLACES[:15], PLACES[15:][rows]]))
    assert np.array_equal(stacked(parts, "flux"), np.concatenate([PLACES[:15], PLACES[15:][rows] * part[:, None]]))
    assert np.array_equal(stacked(parts, "dxdtt"), np.concatenate([np.zeros((15, 3)), np.tile(BENT[0], (3, 1))]))
    assert np.array_equal(stacked(parts, "gain"), np.repeat(np.float32([0.0, 0.5]), [15, 3]))


def test_only_what_is_written_to_is_copied_of_a_map_alone():
    (photons, _) = maps()
    assert stacked([PhotonRows(photons)], "position") is photons.position
    assert not np.shares_memory(stacked([PhotonRows(photons)], "position", own=True), photons.position)
    assert not np.shares_memory(stacked([PhotonRows(photons, np.arange(3))], "flux"), photons.flux)


def test_photons_keep_the_curves_that_their_footprints_are_too_wide_to_show():
    slight = photon_map(PLACES, (9, 0, 0), (0, 9, 0), dxdt=(0.1, 0, 0), trajectory=np.full((4, 3), 0.01))
    # As the tracer's are: others are copied in any case.
    columns = (np.ascontiguousarray(getattr(slight.trajectory, field.name)) for field in fields(TrajectoryColumns))
    slight = replace(slight, trajectory=TrajectoryColumns(*columns))
    footprints = shaped(slight, moves=True).footprints
    assert not footprints.arrays.acceleration.numpy().any() and not footprints.arrays.jerk.numpy().any()
    assert (slight.trajectory.dxdtt == np.float32(0.01)).all() and (slight.trajectory.dxdttt == np.float32(0.01)).all()
