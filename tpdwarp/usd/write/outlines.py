"""Outlines of footprints, at rest and swept over the shutter, as polygons."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tpdwarp.photons.record import PhotonRecord

# Corners of an outline: of few photons, which are looked at closely, and of so many that most are a few pixels across.
# Chosen, not derived.
FINE, COARSE = 16, 6
MOST_FINE = 5000


def footprint_outlines(record: PhotonRecord, smoothing: float, points: int = FINE) -> np.ndarray:
    """Outlines at mid shutter of the ellipses with semi-axes ½ D_u x and ½ D_v x (paper, Fig. 2).

    Those are of one standard deviation of a B-spline; light of some extent widens them by its own (:func:`in_light`).

    Args:
        record: n photons.
        smoothing: Footprint size in lattice cells; scales both axes.
        points: Corners of each.

    Returns:
        Polygons inscribed in the ellipses, shape [n, points, 3], scene units.
    """
    record = in_light(record, smoothing)
    angles = np.arange(points) * (2 * np.pi / points)
    return record.positions[:, None] + ellipse_points(record, smoothing, angles[None])


def swept_outlines(record: PhotonRecord, smoothing: float, points: int = FINE) -> np.ndarray:
    """Outlines of the same ellipses swept from −½ D_t x to +½ D_t x (paper, Eq. 7).

    In the plane in which the ellipse is a unit circle the sweep is a stadium: two half circles that part where the
    tangent is parallel to the motion. The front half is drawn at shutter close, the back half at shutter open.

    Args:
        record: n photons.
        smoothing: Footprint size in lattice cells; scales both axes.
        points: Corners of an outline that is not swept; an even number.

    Returns:
        Convex polygons, first the front half, shape [n, points + 2, 3], scene units.
    """
    record = in_light(record, smoothing)
    # The direction of D_t x in the basis D_u x, D_v x, by Cramer's rule. The receiver's normal in place of their cross
    # product keeps it meaningful where the footprint has collapsed to a line.
    turn = np.sign(np.einsum("ni,ni->n", np.cross(record.dxdu, record.dxdv), record.normals))
    turn[turn == 0] = 1
    along_u = turn * np.einsum("ni,ni->n", np.cross(record.dxdt, record.dxdv), record.normals)
    along_v = turn * np.einsum("ni,ni->n", np.cross(record.dxdu, record.dxdt), record.normals)
    forward = np.arctan2(along_v, along_u)
    half = np.linspace(-0.5 * np.pi, 0.5 * np.pi, points // 2 + 1)
    front = ellipse_points(record, smoothing, forward[:, None] + half)
    shift = 0.5 * record.dxdt[:, None]
    center = record.positions[:, None]
    return np.concatenate([center + shift + front, center - shift - front], axis=1)


def in_light(record: PhotonRecord, smoothing: float) -> PhotonRecord:
    """``record`` with D_u x and D_v x such that J Jᵀ is larger by D_a x D_a xᵀ + D_b x D_b xᵀ / ``smoothing``².

    So the variance of the ellipse, ¼ J Jᵀ, has that of the image of a round light, ¼ (D_a x D_a xᵀ + D_b x D_b xᵀ).
    Photons whose light has no extent stay as they are.
    """
    lit = np.any(record.dxda, axis=1) | np.any(record.dxdb, axis=1)
    if not lit.any():
        return record
    columns = [record.dxdu, record.dxdv, record.dxda / smoothing, record.dxdb / smoothing]
    axes, lengths, _ = np.linalg.svd(np.stack([column[lit] for column in columns], axis=-1), full_matrices=False)
    dxdu, dxdv = record.dxdu.copy(), record.dxdv.copy()
    dxdu[lit], dxdv[lit] = axes[:, :, 0] * lengths[:, :1], axes[:, :, 1] * lengths[:, 1:2]
    return replace(record, dxdu=dxdu, dxdv=dxdv)


def ellipse_points(record: PhotonRecord, smoothing: float, angles: np.ndarray) -> np.ndarray:
    """Points of each photon's ellipse about its centre, shape [n, k, 3], at angles of shape [n or 1, k]."""
    across_u = np.cos(angles)[..., None] * record.dxdu[:, None]
    across_v = np.sin(angles)[..., None] * record.dxdv[:, None]
    return 0.5 * smoothing * (across_u + across_v)
