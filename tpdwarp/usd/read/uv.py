"""Texture coordinates of receivers: a named primvar's, or a planar projection where a mesh has none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pxr import Usd, UsdGeom

from tpdwarp.errors import InputError, WarnOnce
from tpdwarp.usd.read.primvars import flattened
from tpdwarp.usd.read.samples import sample_times
from tpdwarp.usd.read.topology import Topology
from tpdwarp.usd.read.values import ROWS, value_at


@dataclass(frozen=True, eq=False)
class CornerCoordinates:
    """Texture coordinates (s, t) of the triangles of a mesh.

    Attributes:
        values: Those of each triangle corner, shape [m, 3, 2].
        projected: Those of the mesh's own points where they are a projection, which a layer may add to it, shape
            [v, 2]; empty for one of a shape that has no points of its own; None where they are a primvar's.
    """

    values: np.ndarray
    projected: np.ndarray | None = None


def corner_coordinates(
    prim: Usd.Prim, topology: Topology, point_count: int, name: str, frame: float, warnings: WarnOnce
) -> np.ndarray | None:
    """The coordinates that a primvar gives each triangle corner at a time code, shape [m, 3, 2].

    Returns:
        None where the prim (and what is above it) has no such primvar, or one that does not fit, which is warned about.

    Raises:
        InputError: Values that are not finite.
    """
    primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(name)
    if not primvar or not primvar.HasValue():
        return None
    values = flattened(primvar, warnings.file, shape=(None, None)).at(frame)
    spread = None
    if values is not None and len(values) and values.shape[1] >= 2:
        spread = topology.spread(values[:, :2], str(primvar.GetInterpolation()), point_count)
    if spread is None:
        warnings(str(primvar.GetAttr().GetPath()), "does not fit its mesh: a planar projection takes its place")
        return None
    return spread[0][spread[1]]


def planar_coordinates(points: np.ndarray) -> np.ndarray:
    """Points [v, 3] projected along the thinnest axis of their box, which the other two cover from 0 to 1, [v, 2]."""
    low, extent = points.min(axis=0), np.ptp(points, axis=0)
    thinnest = int(np.argmin(extent))
    # Seen against the axis, s goes right and t up.
    axes = [(thinnest + 1) % 3, (thinnest + 2) % 3]
    return (points[:, axes] - low[axes]) / np.maximum(extent[axes], 1e-30)


def authored_points(prim: Usd.Prim, point_count: int) -> np.ndarray | None:
    """The first points that a mesh has in time, in its own space, which no frame changes; None where they do not fit.

    Raises:
        InputError: They are no points.
    """
    if not prim.IsA(UsdGeom.Mesh):
        return None
    attribute = UsdGeom.Mesh(prim).GetPointsAttr()
    times = sample_times(attribute)
    points = value_at(attribute, times[0] if times else None, ROWS)
    if points is None or len(points) != point_count or not np.isfinite(points).all():
        return None
    return points


def require_flat_enough(values: np.ndarray, path: str, file: str) -> None:
    """Refuses coordinates that span no area.

    Raises:
        InputError: They do not.
    """
    sides = values[:, 1:] - values[:, :1]
    if not np.any(sides[:, 0, 0] * sides[:, 1, 1] != sides[:, 0, 1] * sides[:, 1, 0]):
        raise InputError("has texture coordinates without area (choose others with --uv)", file, path)
