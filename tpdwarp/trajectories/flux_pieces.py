"""Flux that grows along a curve: photons in pieces of the shutter, in each of which it goes along a line.

A cell that rides on what it meets grows as that is seen to grow, by an area: a lens that is scaled up to twice its size
catches four times the light, and a line through that is off by a twelfth of it where the light may be in focus. Of such
photons the trajectory is cut into pieces; none is traced again.

With f the flux at the part s of the shutter, by its mean: f = 1 + g s + ½ c (s² − ¹⁄₁₂), from which a line is off by up
to c/12 at either end, and in a piece of the length d by d² of that.

Beyond the paper, whose photons keep their flux.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.trajectories.brightening import over_piece

# Pieces of such photons. Chosen, not derived: lines are off by a sixteenth of what one is off by.
PIECES = 4
# Flux may be off a line by so much of its mean at either end of the shutter. Chosen, not derived.
LARGEST_MISS = 0.02
# Flux that changes along a line by more than this part of its mean is near nothing at one end. Chosen, not derived: as
# far as the axes of footprints grow, which pieces let grow by more, too.
LARGEST_SLOPE = 1.0


def needs_pieces(slope: np.ndarray, bend: np.ndarray) -> np.ndarray:
    """Whether flux of that first and second derivative over the shutter, by its mean, is cut into pieces, all [n]."""
    return (np.abs(bend) / 12.0 > LARGEST_MISS) | (np.abs(slope) > LARGEST_SLOPE)


def follow_flux(photons: PhotonMap) -> list[PhotonMap]:
    """The photons, of which those whose flux bends are in pieces: the same light in all, as it changes."""
    trajectory = photons.trajectory
    if trajectory is None or not trajectory.flux_bend.any():
        return [photons]
    bent = trajectory.flux_bend != 0.0
    others = [photons.rows(~bent)] if not bent.all() else []
    rows = photons.rows(bent)
    slope, bend = (values.astype(np.float64) for values in (rows.trajectory.gain, rows.trajectory.flux_bend))
    none = np.zeros_like(rows.trajectory.gain)
    rows = replace(rows, trajectory=replace(rows.trajectory, gain=none, flux_bend=none[:0]))

    def flux_until(part: float) -> np.ndarray:
        return part * (1.0 + 0.5 * slope * part + bend / 6.0 * (part**2 - 0.25))

    edges = [number / PIECES - 0.5 for number in range(PIECES + 1)]
    means = np.diff([flux_until(edge) for edge in edges], axis=0) * PIECES
    # A parabola may pass below zero; what there is has all of the flux.
    means = np.maximum(means, 0.0)
    means /= means.mean(axis=0)
    pieces = []
    for begin, mean in zip(edges, means, strict=False):
        middle = begin + 0.5 / PIECES
        gain = (slope + bend * middle) / PIECES / np.maximum(mean, np.finfo(np.float32).eps)
        pieces.append(over_piece(rows, middle, 1.0 / PIECES, mean[:, None], gain))
    return [*others, *pieces]
