"""What lies far from the origin, stored near one of its own: single precision holds digits, not distances."""

from __future__ import annotations

import numpy as np

from tpdwarp.photons.record import PhotonRecord

# So many extents from the origin single precision still tells 2⁻¹⁷ of an extent.
FARTHEST = 100.0


def own_origin(record: PhotonRecord) -> np.ndarray | None:
    """An origin for photons that lie more than 100 times their extent away from the scene's.

    Args:
        record: Photons; their extent is that of their positions, or of one of their differentials where that is longer.

    Returns:
        A point in their middle, shape [3], in whole powers of two about as large as their extent, so that photons
        traced a little differently have the same one; None where the scene's origin serves them.
    """
    if not len(record):
        return None
    low, high = record.positions.min(axis=0), record.positions.max(axis=0)
    columns = np.concatenate([record.dxdu, record.dxdv, record.dxdt])
    extent = max(float((high - low).max()), float(np.abs(columns).max()))
    middle = 0.5 * (low + high)
    if not np.abs(middle).max() > FARTHEST * extent > 0:
        return None
    unit = 2.0 ** np.ceil(np.log2(extent))
    return np.rint(middle / unit) * unit
