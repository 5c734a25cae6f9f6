"""Cages of subdivision surfaces, read from mesh prims with their creases and corners."""

from __future__ import annotations

import numpy as np
from pxr import UsdGeom

from tpdwarp.errors import WarnOnce
from tpdwarp.usd.read.subdivision.connectivity import Connectivity
from tpdwarp.usd.read.values import LIST, indices_or_none, text_at, value_or_fallback


def cage_of(
    mesh: UsdGeom.Mesh, counts: np.ndarray, indices: np.ndarray, point_count: int, warnings: WarnOnce
) -> Connectivity:
    """The cage of a mesh; creases and corners that do not fit it are warned about and left out."""
    corner_sharpness = np.zeros(point_count)
    corners, sharpness = (
        indices_or_none(mesh.GetCornerIndicesAttr(), None, warnings),
        value_or_fallback(mesh.GetCornerSharpnessesAttr(), None, warnings, LIST),
    )
    if len(corners):
        known = (corners >= 0) & (corners < point_count)
        if sharpness is None or len(sharpness) != len(corners) or not known.all():
            warnings(f"{mesh.GetPath()}.cornerIndices", "holds corners that do not fit, which are left out")
        else:
            corner_sharpness[corners] = sharpness
    if text_at(mesh.GetInterpolateBoundaryAttr()) == UsdGeom.Tokens.edgeAndCorner:
        alone = np.bincount(indices, minlength=point_count) == 1
        corner_sharpness[alone] = np.inf
    return Connectivity.of(counts, indices, point_count, _creases(mesh, point_count, warnings), corner_sharpness)


def faces_at_boundary(cage: Connectivity) -> np.ndarray:
    """Numbers of the faces that touch a boundary."""
    at_boundary = np.zeros(cage.vertex_count, dtype=bool)
    at_boundary[cage.edges[np.bincount(cage.edge_of) == 1]] = True
    return np.unique(cage.face_of[at_boundary[cage.indices]])


def _creases(mesh: UsdGeom.Mesh, point_count: int, warnings: WarnOnce) -> dict[tuple[int, int], float]:
    """Sharpness by vertices, the lower first; there is one a crease, or one for each of its edges."""
    attributes = mesh.GetCreaseIndicesAttr(), mesh.GetCreaseLengthsAttr()
    vertices, lengths = (indices_or_none(attribute, None, warnings) for attribute in attributes)
    if not len(vertices):
        return {}
    sharpness = value_or_fallback(mesh.GetCreaseSharpnessesAttr(), None, warnings, LIST)
    edge_count = int(np.maximum(lengths - 1, 0).sum())
    fits = lengths.sum() == len(vertices) and vertices.min() >= 0 and vertices.max() < point_count
    if sharpness is None or not fits or len(sharpness) not in (len(lengths), edge_count):
        warnings(f"{mesh.GetPath()}.creaseIndices", "holds creases that do not fit, which are left out")
        return {}
    by_edge = sharpness if len(sharpness) == edge_count else np.repeat(sharpness, np.maximum(lengths - 1, 0))
    firsts = np.setdiff1d(np.arange(len(vertices)), np.cumsum(lengths) - 1)
    pairs = zip(vertices[firsts].tolist(), vertices[firsts + 1].tolist(), strict=True)
    return {(min(a, b), max(a, b)): float(s) for (a, b), s in zip(pairs, by_edge, strict=True)}
