"""Polygons to triangles: fans (or ears) in face order, with what is needed to find their corners and faces again."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tpdwarp.usd.read.concave_faces import concave_faces, ears


@dataclass(frozen=True, eq=False)
class Topology:
    """Triangles of a polygonal mesh.

    Attributes:
        triangles: Point indices, counter-clockwise seen from the front, shape [m, 3] int32.
        corners: Position of each triangle corner among the face-varying elements, shape [m, 3] int32.
        faces: Face of each triangle, shape [m] int32.
        face_count: Number of faces, holes included.
        corner_count: Number of face-varying elements.
    """

    triangles: np.ndarray
    corners: np.ndarray
    faces: np.ndarray
    face_count: int
    corner_count: int

    @cached_property
    def mirrored(self) -> Topology:
        """The same triangles wound the other way round."""
        order = [0, 2, 1]
        return replace(
            self,
            triangles=np.ascontiguousarray(self.triangles[:, order]),
            corners=np.ascontiguousarray(self.corners[:, order]),
        )

    @cached_property
    def face_corners(self) -> tuple[np.ndarray, np.ndarray]:
        """Point and face of each face corner that a triangle uses, each once, shapes [k] and [k]."""
        _, where = np.unique(self.corners, return_index=True)
        return self.triangles.ravel()[where], np.repeat(self.faces, 3)[where]

    def elements(self, interpolation: str, size: int, point_count: int) -> np.ndarray | None:
        """Element of each triangle corner in a primvar of ``size`` elements, shape [m, 3] int32.

        Returns:
            None where the size does not fit the interpolation.
        """
        expected = {
            "constant": 1,
            "uniform": self.face_count,
            "vertex": point_count,
            "varying": point_count,
            "faceVarying": self.corner_count,
        }
        if expected.get(interpolation) != size:
            return None
        if interpolation == "constant":
            return np.zeros_like(self.triangles)
        if interpolation == "uniform":
            return np.repeat(self.faces[:, None], 3, axis=1)
        return self.corners if interpolation == "faceVarying" else self.triangles

    def spread(
        self, values: np.ndarray, interpolation: str, point_count: int
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """A primvar's values [n, k], and the one at each triangle corner [m, 3]; None where they do not fit."""
        elements = self.elements(interpolation, len(values), point_count)
        return None if elements is None else (values, elements)


def triangulate(
    counts: np.ndarray,
    indices: np.ndarray,
    holes: np.ndarray,
    left_handed: bool,
    points: np.ndarray | None = None,
) -> Topology:
    """Cuts each face into a fan about its first corner, in face order; concave faces into ears.

    Faces of fewer than three corners, holes, and triangles that use a point twice are left out.

    Args:
        counts: Corners of each face, shape [f].
        indices: Point of each corner, shape [sum(counts)].
        holes: Faces left out.
        left_handed: Whether faces are authored clockwise seen from the front.
        points: Positions by which concave faces are known, shape [v, 3]; without them all faces become fans.
    """
    counts, indices = np.asarray(counts, dtype=np.int64), np.asarray(indices, dtype=np.int64)
    fans = np.maximum(counts - 2, 0)
    fans[np.asarray(holes, dtype=np.int64)] = 0
    starts, ends = np.cumsum(counts) - counts, np.cumsum(fans)
    faces = np.repeat(np.arange(len(counts)), fans)
    within = np.arange(fans.sum()) - np.repeat(ends - fans, fans)
    first = starts[faces]
    second, third = first + within + 1, first + within + 2
    for face in () if points is None else concave_faces(points, counts, indices):
        if fans[face]:
            rows = slice(ends[face] - fans[face], ends[face])
            cut = starts[face] + ears(points[indices[starts[face] : starts[face] + counts[face]]])
            first[rows], second[rows], third[rows] = cut.T
    if left_handed:
        second, third = third, second
    corners = np.stack([first, second, third], axis=1)
    triangles = indices[corners]
    a, b, c = triangles.T
    proper = (a != b) & (b != c) & (c != a)
    return Topology(
        triangles[proper].astype(np.int32),
        corners[proper].astype(np.int32),
        faces[proper].astype(np.int32),
        len(counts),
        len(indices),
    )
