"""Solids of tetrahedra: their surface is what is seen."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from pxr import UsdGeom

from tpdwarp.usd.read.blobs import Blobs
from tpdwarp.usd.read.shapes import ShapeAtShutter
from tpdwarp.usd.read.topology import triangulate
from tpdwarp.usd.read.values import raw_at, text_at


class Solid(Blobs):
    """A TetMesh prim over time, as :class:`tpdwarp.usd.read.shapes.Shape`; it is shaded flat."""

    def _made(self, points: Callable[[float], np.ndarray], first: np.ndarray, frame: float) -> ShapeAtShutter | None:
        solid = UsdGeom.TetMesh(self._prim)
        faces = raw_at(solid.GetSurfaceFaceVertexIndicesAttr(), frame)
        if not faces and raw_at(solid.GetTetVertexIndicesAttr(), frame):
            faces = UsdGeom.TetMesh.ComputeSurfaceFaces(solid, frame)
        triangles = np.array(faces or [], dtype=np.int64).reshape(-1, 3)
        there = ((triangles >= 0) & (triangles < len(first))).all(axis=1)
        if not there.all():
            self._warnings(self.path, "has faces of points that are not there, which are left out")
        if not there.any():
            self._warnings(self.path, "the mesh has no faces and is left out")
            return None
        flipped = text_at(UsdGeom.Gprim(self._prim).GetOrientationAttr()) == UsdGeom.Tokens.leftHanded
        indices = triangles[there].ravel()
        topology = triangulate(np.full(len(indices) // 3, 3), indices, np.zeros(0), flipped)
        return ShapeAtShutter(topology, len(first), points, None, None)
