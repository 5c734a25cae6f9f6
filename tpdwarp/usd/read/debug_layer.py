"""Reading photons back from a debug layer."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from pxr import Tf, Usd, UsdGeom

from tpdwarp.errors import InputError
from tpdwarp.photons.record import PhotonRecord

_POINTS = "/TPD/Photons"
_DIFFERENTIALS = "/TPD/TimeDifferentials"
# Those of layers whose lights have an extent, and what records call them.
_LIGHT_COLUMNS = {"tpd:DaX": "dxda", "tpd:DbX": "dxdb"}
_COLUMNS = {"tpd:flux": 3, "tpd:DuX": 3, "tpd:DvX": 3, "tpd:DtX": 3, "tpd:emission": 2, "tpd:bounces": 0}


class DebugLayerReader:
    """A debug layer opened for reading, frame by frame.

    Args:
        path: The layer.

    Raises:
        InputError: It cannot be read, or holds no photons.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = os.fspath(path)
        try:
            stage = Usd.Stage.Open(self.path)
        except Tf.ErrorException as error:
            reason = " ".join(error.args[0].commentary.split())
            raise InputError(f"cannot be read: {reason}", file=self.path) from error
        self._points = UsdGeom.Points.Get(stage, _POINTS)
        if not self._points:
            raise InputError("holds no photons (is it a debug layer?)", file=self.path, prim=_POINTS)
        self._primvars = UsdGeom.PrimvarsAPI(self._points)
        self._stage = stage

    @property
    def frames(self) -> tuple[float, ...]:
        """Time codes for which it holds photons."""
        return tuple(self._points.GetPointsAttr().GetTimeSamples())

    @property
    def up_axis_and_unit(self) -> tuple[str, float]:
        """The stage's up axis, and its unit in metres."""
        return str(UsdGeom.GetStageUpAxis(self._stage)), float(UsdGeom.GetStageMetersPerUnit(self._stage))

    @property
    def provenance(self) -> dict[str, Any]:
        """What the layer says of its making: ``settings`` (JSON), ``exposure`` (frames), ``version``; may be empty."""
        return dict(self._stage.GetRootLayer().customLayerData.get("tpdwarp", {}))

    def at(self, frame: float) -> PhotonRecord:
        """The photons of one frame. Layers store no normals: they are those of the footprints (0 where collapsed).

        Args:
            frame: One of :attr:`frames`.

        Raises:
                InputError: A column is missing, is of another type, or has not one value a photon; or a receiver is not
                known.
        """
        positions = self._placed(self._points, self._array(self._points.GetPointsAttr(), frame, "points", 3), frame)
        count = len(positions)
        columns = {
            name: self._array(self._primvars.GetPrimvar(name).GetAttr(), frame, name, width)
            for name, width in _COLUMNS.items()
        }
        of_light = {
            name: self._array(self._primvars.GetPrimvar(name).GetAttr(), frame, name, 3)
            for name in _LIGHT_COLUMNS
            if self._primvars.HasPrimvar(name)
        }
        ids = self._array(self._points.GetIdsAttr(), frame, "ids", 0)
        receivers = self._array(self._primvars.GetPrimvar("tpd:receiver").GetAttr(), frame, "tpd:receiver", 0)
        for name, values in {**columns, **of_light, "ids": ids, "tpd:receiver": receivers}.items():
            if len(values) != count:
                message = f"frame {frame:g} has {len(values)} values for {count} photons"
                raise InputError(message, file=self.path, prim=f"{_POINTS}.{name}")
        normals = np.cross(columns["tpd:DuX"], columns["tpd:DvX"])
        lengths = np.linalg.norm(normals, axis=-1, keepdims=True)
        paths = self._primvars.GetPrimvar("tpd:receivers").Get() or ()
        if np.any(receivers >= len(paths)) or np.any(receivers < -1):
            message = f"frame {frame:g} names receivers beyond the {len(paths)} of tpd:receivers"
            raise InputError(message, file=self.path, prim=f"{_POINTS}.tpd:receiver")
        return PhotonRecord(
            ids=ids.astype(np.int64),
            positions=positions,
            normals=np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0),
            dxdu=columns["tpd:DuX"],
            dxdv=columns["tpd:DvX"],
            dxdt=columns["tpd:DtX"],
            flux=columns["tpd:flux"],
            emission=columns["tpd:emission"],
            bounces=columns["tpd:bounces"].astype(np.int32),
            receivers=receivers.astype(np.int32),
            receiver_paths=tuple(str(path) for path in paths),
            **{column: of_light[name] for name, column in _LIGHT_COLUMNS.items() if name in of_light},
        )

    def time_differentials(self, frame: float) -> tuple[np.ndarray, np.ndarray]:
        """The curves that show where footprints move: their ends, shape [n, 2, 3], and display colours, shape [n, 3].

        Ends are the footprint's centre at shutter open and at shutter close, in scene units; colours are linear.

        Args:
            frame: One of :attr:`frames`.

        Raises:
            InputError: The layer holds no such curves, or not two points and a colour for each.
        """
        curves = UsdGeom.BasisCurves.Get(self._stage, _DIFFERENTIALS)
        if not curves:
            raise InputError("holds no curves", file=self.path, prim=_DIFFERENTIALS)
        points = self._array(curves.GetPointsAttr(), frame, "points", 3, _DIFFERENTIALS)
        counts = self._array(curves.GetCurveVertexCountsAttr(), frame, "curveVertexCounts", 0, _DIFFERENTIALS)
        colors = self._array(curves.GetDisplayColorAttr(), frame, "primvars:displayColor", 3, _DIFFERENTIALS)
        if len(points) != 2 * len(counts) or np.any(counts != 2) or len(colors) != len(counts):
            message = f"frame {frame:g} has {len(points)} points and {len(colors)} colours for {len(counts)} curves"
            raise InputError(message, file=self.path, prim=_DIFFERENTIALS)
        return self._placed(curves, points, frame).reshape(-1, 2, 3), colors

    def _placed(self, prim: UsdGeom.PointBased, points: np.ndarray, frame: float) -> np.ndarray:
        """Points of a prim, shape [n, 3], in the world: layers of scenes far from the origin have one of their own."""
        matrix = np.array(prim.ComputeLocalToWorldTransform(frame))
        return points @ matrix[:3, :3] + matrix[3, :3]

    def _array(
        self, attribute: Usd.Attribute, frame: float, name: str, width: int, prim: str = _POINTS
    ) -> np.ndarray:
        value = attribute.Get(frame) if attribute else None
        if value is None:
            raise InputError(f"has no value at frame {frame:g}", file=self.path, prim=f"{prim}.{name}")
        try:
            values = np.array(value, dtype=np.float64 if width else np.int64)
            return values.reshape(-1, width) if width else values.reshape(-1)
        except (TypeError, ValueError, OverflowError) as error:
            wanted = f"vectors of {width} numbers" if width else "whole numbers"
            raise InputError(f"is no array of {wanted}", file=self.path, prim=f"{prim}.{name}") from error
