"""A subdivision surface: its cage refined so many times and moved to the limit, with the limit's normals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpdwarp.usd.read.normals import area_vectors, unit
from tpdwarp.usd.read.subdivision.connectivity import Connectivity, summed
from tpdwarp.usd.read.subdivision.rules import CatmullClark, Loop, Rules
from tpdwarp.usd.read.topology import Topology, triangulate

SCHEMES: dict[str, type[Rules]] = {"catmullClark": CatmullClark, "loop": Loop}

# Faces after refinement, to which the cage is brought near: silhouettes of 64 segments, light refracted by 256.
WANTED_FACES, WANTED_SPECULAR_FACES = 2048, 16384
# All subdivision surfaces of a stage together stay about below this number of faces.
MOST_FACES = 1_000_000
# A cage finer than this is rendered as it is: once refined it would take 2 GB.
FINEST_CAGE = 250_000
MOST_LEVELS = 6


def levels_for(faces: int, specular: bool, surfaces: int, complexity: float) -> int:
    """How often a cage is refined.

    Args:
        faces: Faces of the cage.
        specular: Whether it reflects or refracts.
        surfaces: Subdivision surfaces of the stage, instances counted each.
        complexity: As in usdrecord: each tenth above 1 is one level more.
    """
    if faces > FINEST_CAGE:
        return 0
    wanted = WANTED_SPECULAR_FACES if specular else WANTED_FACES
    needed, affordable = (
        np.log2(max(most / max(faces, 1), 1.0)) / 2.0 for most in (wanted, MOST_FACES / max(surfaces, 1))
    )
    levels = max(1, min(int(np.ceil(needed)), int(affordable)))
    # Single precision and typed decimals: 1.1 is a level, 1.0999999 as well.
    extra = int(np.clip((complexity - 1.0) * 10.0 + 0.01, 0.0, 8.0))
    while extra > 0 and faces * 4.0 ** (levels + extra) > MOST_FACES:
        extra -= 1
    return min(levels + extra, MOST_LEVELS + extra)


@dataclass(frozen=True, eq=False)
class RefinedTopology(Topology):
    """Triangles of a subdivision surface; primvars are those of its cage.

    Attributes:
        refinements: The rules of each level, from the cage on.
    """

    refinements: tuple[Rules, ...] = ()

    def spread(self, values: np.ndarray, interpolation: str, point_count: int) -> tuple[np.ndarray, np.ndarray] | None:
        """As :meth:`Topology.spread`; what differs from corner to corner is interpolated linearly over each face."""
        mesh = self.refinements[0].mesh
        if interpolation in ("constant", "uniform"):
            elements = self.elements(interpolation, len(values), point_count)
            return None if elements is None else (values, elements)
        sizes = {"vertex": point_count, "varying": point_count, "faceVarying": len(mesh.indices)}
        if sizes.get(interpolation) != len(values):
            return None
        at_corners = values if interpolation == "faceVarying" else values[mesh.indices]
        for rules in self.refinements:
            at_corners = rules.corner_values(at_corners)
        return at_corners, self.corners


class Surface:
    """A cage's surface.

    Args:
        scheme: ``catmullClark`` or ``loop`` (of triangles).
        cage: The cage.
        levels: How often it is refined, at least once.
        holes: Faces left out, shape [h].
        left_handed: Whether faces are authored clockwise seen from the front.
    """

    def __init__(self, scheme: str, cage: Connectivity, levels: int, holes: np.ndarray, left_handed: bool) -> None:
        self._side = -1.0 if left_handed else 1.0
        self._refinements: list[Rules] = []
        mesh, parents = cage, np.arange(len(cage.counts))
        for _ in range(levels):
            rules = SCHEMES[scheme](mesh)
            self._refinements.append(rules)
            mesh, above = rules.refined()
            parents = parents[above]
        self._limit = SCHEMES[scheme](mesh)
        self._smooth = self._limit.smooth()
        cut = triangulate(mesh.counts, mesh.indices, np.flatnonzero(np.isin(parents, holes)), left_handed)
        self.topology = RefinedTopology(
            cut.triangles,
            cut.corners,
            parents[cut.faces].astype(np.int32),
            len(cage.counts),
            len(mesh.indices),
            refinements=tuple(self._refinements),
        )
        self.point_count = mesh.vertex_count
        self._plan_sharp_normals(mesh, cut)

    def refined(self, cage_points: np.ndarray) -> np.ndarray:
        """The points of the last level for those of the cage, shape [point_count, 3]."""
        points = cage_points
        for rules in self._refinements:
            points = rules.refined_points(points)
        return points

    def points(self, refined: np.ndarray) -> np.ndarray:
        """The points on the limit surface for refined ones, shape [point_count, 3]."""
        return self._limit.limit_points(refined)

    def normals(self, refined: np.ndarray) -> np.ndarray:
        """Unit normals for refined points: one a vertex, then one for each sector of a vertex that is not smooth.

        Those of smooth vertices are the limit's own. Those of sectors (between creases, at corners) are the mean of
        the refined faces there.
        """
        normals = self._side * self._limit.limit_normals(refined)
        if len(self._sharp_corners):
            areas = area_vectors(self._limit.limit_points(refined), self.topology.triangles)
            sectors = summed(self._sector_of, areas[self._sharp_corners // 3], self._sectors)
            normals = np.concatenate([normals, sectors])
        return unit(normals)

    def normal_elements(self, faces: Topology) -> np.ndarray:
        """Normal of each corner of a topology that may be mirrored, shape [m, 3]."""
        return self._normal_elements if faces is self.topology else self._normal_elements[:, [0, 2, 1]]

    def _plan_sharp_normals(self, mesh: Connectivity, cut: Topology) -> None:
        """Numbers the sectors at vertices that are not smooth."""
        corners = cut.corners.ravel()
        sharp = ~self._smooth[mesh.indices[corners]]
        self._sharp_corners = np.flatnonzero(sharp)
        self._sectors = 0
        elements = cut.triangles.ravel().copy()
        if len(self._sharp_corners):
            _, sector = mesh.around
            keys = np.stack([mesh.indices[corners[sharp]], sector[corners[sharp]]], axis=1)
            known, self._sector_of = np.unique(keys, axis=0, return_inverse=True)
            self._sector_of = self._sector_of.ravel()
            self._sectors = len(known)
            elements[self._sharp_corners] = mesh.vertex_count + self._sector_of
        self._normal_elements = elements.reshape(-1, 3).astype(np.int32)
