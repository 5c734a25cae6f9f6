"""Some of many photons, spread evenly over the light and the same in every frame."""

from __future__ import annotations

import numpy as np

from tpdwarp.photons.record import PhotonRecord


def lattice_ranks(coordinates: np.ndarray) -> np.ndarray:
    """A number for each lattice point, such that the points below any bound are spread evenly.

    Reading the bits of the lattice coordinates backwards (a van der Corput sequence in two dimensions) numbers a
    lattice so that the first of them lie on a coarse lattice, the next between these.

    Args:
        coordinates: Lattice coordinates, whole or half numbers, shape [n, 2].

    Returns:
        Whole numbers below 2^40, shape [n] uint64.
    """
    # Doubled, whole and half coordinates are whole: rounding then cannot flip with the last digit of a coordinate.
    lattice = np.rint(2 * np.asarray(coordinates, np.float64)).astype(np.int64)
    ranks = np.zeros(len(lattice), np.uint64)
    for bit in range(20):
        for axis in range(2):
            ranks = ranks << np.uint64(1) | (lattice[:, axis] >> bit & 1).astype(np.uint64)
    return ranks


def thinning_ranks(record: PhotonRecord) -> np.ndarray:
    """A number for each photon, shape [n] uint64, such that the photons below any bound are spread evenly.

    It depends on the photon alone, so that a bound picks the same photons in every frame.
    """
    ranks = lattice_ranks(record.emission)
    # Photons of one lattice point (several lights, or branches of one path) follow in an order of their own.
    scattered = record.ids.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    return ranks << np.uint64(24) | scattered >> np.uint64(40)


def thinned_alone(record: PhotonRecord, curves: int | None) -> PhotonRecord:
    """The photons of a frame that a layer of at most ``curves`` photons a frame may need.

    That is one more than ``curves``: where the layer's writer meets more, the first that is too many sets its bound.
    """
    if curves is None or len(record) <= curves + 1:
        return record
    ranks = thinning_ranks(record)
    return record.rows(ranks <= np.partition(ranks, curves)[curves])
