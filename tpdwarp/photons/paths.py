"""Paths of photons from their lights to where they land, for looking at them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpdwarp.photons.emission import ChosenCells, Patch
from tpdwarp.photons.lattices import EmissionPlan, Lattice
from tpdwarp.photons.photon_map import MOST_VERTICES, PhotonMap
from tpdwarp.photons.record import PhotonRecord, record_of
from tpdwarp.photons.thinning import lattice_ranks

# Ranks of whole lattice coordinates, whose doubles are even, are below this.
WHOLE_RANKS = 2.0**38
# Of light from afar the last stretch before the first surface is shown, no longer than this in the tracer's units, in
# which the scene has a radius of one.
LONGEST_ARRIVAL = 1.0


@dataclass(frozen=True, eq=False)
class PhotonPaths:
    """Paths of some of the photons of a frame, as they are at mid shutter.

    Attributes:
        photons: What the paths end as, k of them.
        counts: Vertices of each path, 2 or more, shape [k] int32.
        points: The vertices of one path after the other, scene units, shape [sum of counts, 3].
    """

    photons: PhotonRecord
    counts: np.ndarray
    points: np.ndarray

    def rows(self, chosen: np.ndarray) -> PhotonPaths:
        """Some of the paths, by a mask of shape [k]."""
        return PhotonPaths(self.photons.rows(chosen), self.counts[chosen], self.points[np.repeat(chosen, self.counts)])


class SpreadCells:
    """Chooses cells of lattices that are spread evenly over the light, and the same in every frame.

    Args:
        plan: The lattices.
        count: About as many cells as are chosen of those that the stills foresaw.
    """

    def __init__(self, plan: EmissionPlan, count: int) -> None:
        planned = sum(lattice.wrap[0] * lattice.wrap[1] / 4.0 for lattice in plan.lattices)
        self._bound = WHOLE_RANKS * min(1.0, count / max(planned, 1.0))

    def __call__(self, lattice: Lattice, patch: Patch) -> ChosenCells:
        cells = ChosenCells.of_patch(patch).cell
        return ChosenCells(cells[lattice_ranks(cells) < self._bound])


def paths_of(photons: PhotonMap, plan: EmissionPlan, receivers: tuple[str, ...]) -> PhotonPaths:
    """The paths of photons that were traced with their vertices.

    Args:
        photons: The photons.
        plan: The lattices that they come from.
        receivers: Prim paths of the objects.
    """
    counts = np.minimum(photons.bounces + 2, MOST_VERTICES).astype(np.int32)
    vertices = photons.vertices.astype(np.float64)
    arrival = vertices[:, 0] - vertices[:, 1]
    lengths = np.linalg.norm(arrival, axis=1, keepdims=True)
    vertices[:, 0] = vertices[:, 1] + arrival * np.minimum(1.0, LONGEST_ARRIVAL / np.maximum(lengths, 1e-30))
    points = plan.normalization.world_points(vertices[np.arange(MOST_VERTICES) < counts[:, None]])
    return PhotonPaths(record_of([(photons, plan)], receivers), counts, points)
