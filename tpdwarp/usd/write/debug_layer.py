"""The debug layer: photons and their differentials as USD curves and points, and a layer that views them in the scene.

    shot.debug.usdc     /TPD (Scope, purpose guide) over TimeDifferentials, Footprints, SweptFootprints, Photons
    shot.view.usda      sublayers of the two, with /TPD shown

/TPD has two variant sets: ``colour`` (speed, flux, bounces or receiver) and, in the view layer, ``what`` is shown.

The guide purpose keeps photons out of renders of a scene that has the debug layer among its own; the view layer shows
them without a viewer having to ask for guides.
"""

from __future__ import annotations

import importlib.metadata
import json
import os
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdUtils, Vt

from tpdwarp.errors import FrameError, InputError, shortened
from tpdwarp.io.files import check_writable, complete_or_absent
from tpdwarp.io.float32 import to_float32
from tpdwarp.photons.record import PhotonRecord
from tpdwarp.usd.write.local_origin import own_origin

EXTENSIONS = (".usdc", ".usda", ".usd")
OUTLINE_POINTS = 16
SWEPT_POINTS = OUTLINE_POINTS + 2

# Widths as parts of a typical footprint's diameter, and where there is none, of the cloud of photons.
CURVE_WIDTH = 0.02
POINT_WIDTH = 0.1
FALLBACK_DIAMETER = 0.01
# A layer whose photons all move by less than this part of a typical footprint shows nothing moving.
SMALLEST_MOTION = 1e-3

# sRGB, slow to fast: lightness rises evenly, so that it reads on grey prints and by colour-blind eyes as well.
SPEED_RAMP = np.array([[38, 26, 120], [126, 30, 148], [205, 44, 96], [245, 128, 36], [255, 218, 84]]) / 255
# What colours may show, and the prims that each choice of the view layer shows.
COLOURS = ("speed", "flux", "bounces", "receiver")
SHOWN: dict[str, tuple[str, ...]] = {
    "differentials": ("TimeDifferentials",),
    "footprints": ("Footprints",),
    "swept": ("SweptFootprints",),
    "photons": ("Photons",),
    "all": ("TimeDifferentials", "Footprints", "SweptFootprints", "Photons"),
}
# Near a focus a few photons are far faster than the rest; they share the last colour.
RAMP_PERCENTILE = 99.0

PRIMVARS: dict[str, tuple[Sdf.ValueTypeName, str]] = {
    "tpd:photonId": (Sdf.ValueTypeNames.IntArray, "Identity from frame to frame (its lowest 31 bits)."),
    "tpd:flux": (Sdf.ValueTypeNames.Color3fArray, "Flux carried [W], linear Rec.709."),
    "tpd:DuX": (Sdf.ValueTypeNames.Vector3fArray, "Derivative of the position by the lattice coordinate u, a step."),
    "tpd:DvX": (Sdf.ValueTypeNames.Vector3fArray, "Derivative of the position by the lattice coordinate v, a step."),
    "tpd:DtX": (Sdf.ValueTypeNames.Vector3fArray, "Displacement relative to the receiver over the whole exposure."),
    "tpd:emission": (Sdf.ValueTypeNames.Float2Array, "Lattice coordinates at the light."),
    "tpd:bounces": (Sdf.ValueTypeNames.IntArray, "Specular interactions of its path."),
    "tpd:receiver": (Sdf.ValueTypeNames.IntArray, "Mesh on which the photon lies: index into tpd:receivers."),
}


def view_path(path: str | os.PathLike[str]) -> Path:
    """The view layer that goes with a debug layer: ``shot.view.usda`` for ``shot.debug.usdc`` and for ``shot.usdc``."""
    path = Path(path)
    return path.with_name(path.stem.removesuffix(".debug") + ".view.usda")


def footprint_outlines(record: PhotonRecord, smoothing: float) -> np.ndarray:
    """Outlines at mid shutter of the ellipses with semi-axes ½ D_u x and ½ D_v x (paper, Fig. 2).

    Args:
        record: n photons.
        smoothing: Footprint size in lattice cells; scales both axes.

    Returns:
        Polygons inscribed in the ellipses, shape [n, 16, 3], scene units.
    """
    angles = np.arange(OUTLINE_POINTS) * (2 * np.pi / OUTLINE_POINTS)
    return record.positions[:, None] + ellipse_points(record, smoothing, angles[None])


def swept_outlines(record: PhotonRecord, smoothing: float) -> np.ndarray:
    """Outlines of the same ellipses swept from −½ D_t x to +½ D_t x (paper, Eq. 7).

    In the plane in which the ellipse is a unit circle the sweep is a stadium: two half circles that part where the
    tangent is parallel to the motion. The front half is drawn at shutter close, the back half at shutter open.

    Args:
        record: n photons.
        smoothing: Footprint size in lattice cells; scales both axes.

    Returns:
        Convex polygons, first the front half, shape [n, 18, 3], scene units.
    """
    # The direction of D_t x in the basis D_u x, D_v x, by Cramer's rule. The receiver's normal in place of their cross
    # product keeps it meaningful where the footprint has collapsed to a line.
    turn = np.sign(np.einsum("ni,ni->n", np.cross(record.dxdu, record.dxdv), record.normals))
    turn[turn == 0] = 1
    along_u = turn * np.einsum("ni,ni->n", np.cross(record.dxdt, record.dxdv), record.normals)
    along_v = turn * np.einsum("ni,ni->n", np.cross(record.dxdu, record.dxdt), record.normals)
    forward = np.arctan2(along_v, along_u)
    half = np.linspace(-0.5 * np.pi, 0.5 * np.pi, SWEPT_POINTS // 2)
    front = ellipse_points(record, smoothing, forward[:, None] + half)
    shift = 0.5 * record.dxdt[:, None]
    center = record.positions[:, None]
    return np.concatenate([center + shift + front, center - shift - front], axis=1)


def ellipse_points(record: PhotonRecord, smoothing: float, angles: np.ndarray) -> np.ndarray:
    """Points of each photon's ellipse about its centre, shape [n, k, 3], at angles of shape [n or 1, k]."""
    across_u = np.cos(angles)[..., None] * record.dxdu[:, None]
    across_v = np.sin(angles)[..., None] * record.dxdv[:, None]
    return 0.5 * smoothing * (across_u + across_v)


def speed_colors(speeds: np.ndarray, fastest: float) -> np.ndarray:
    """Colours for speeds, from 0 to ``fastest`` and beyond, shape [n, 3], linear Rec.709."""
    place = np.clip(speeds / fastest, 0, 1) if fastest > 0 else np.zeros_like(speeds)
    stops = np.linspace(0, 1, len(SPEED_RAMP))
    encoded = np.stack([np.interp(place, stops, channel) for channel in SPEED_RAMP.T], axis=-1)
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def thinning_ranks(record: PhotonRecord) -> np.ndarray:
    """A number for each photon, shape [n] uint64, such that the photons below any bound are spread evenly.

    Reading the bits of the lattice coordinates backwards (a van der Corput sequence in two dimensions) numbers a
    lattice so that the first of them lie on a coarse lattice, the next between these. It depends on the photon alone,
    so that a bound picks the same photons in every frame.
    """
    # Doubled, whole and half coordinates are whole: rounding then cannot flip with the last digit of a coordinate.
    lattice = np.rint(2 * np.asarray(record.emission, np.float64)).astype(np.int64)
    ranks = np.zeros(len(record), np.uint64)
    for bit in range(20):
        for axis in range(2):
            ranks = ranks << np.uint64(1) | (lattice[:, axis] >> bit & 1).astype(np.uint64)
    # Photons of one lattice point (several lights, or branches of one path) follow in an order of their own.
    scattered = record.ids.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    return ranks << np.uint64(24) | scattered >> np.uint64(40)


def thinned_alone(record: PhotonRecord, curves: int | None) -> PhotonRecord:
    """The photons of a frame that a layer of at most ``curves`` photons a frame may need.

    That is one more than ``curves``: where the layer's writer meets more, the first that is too many sets its bound.
    """
    if curves is None or len(record) <= curves + 1:
        return record
    ranks = thinning_ranks(record)
    return record.rows(ranks <= np.partition(ranks, curves)[curves])


def refuse_non_finite(record: PhotonRecord, time: float, path: str | os.PathLike[str]) -> None:
    """Refuses photons that no viewer could show.

    Args:
        record: The photons.
        time: Time code of their frame.
        path: The layer meant for them.

    Raises:
        FrameError: A value is not finite.
    """
    for name in ("positions", "dxdu", "dxdv", "dxdt", "flux", "emission"):
        finite = np.isfinite(getattr(record, name)).all(axis=-1)
        if not finite.all():
            photon = record.ids[np.argmin(finite)]
            raise FrameError(f"{os.fspath(path)}: frame {time:g}: {name} of photon {photon} is not finite")


def check_debug_layer(path: str | os.PathLike[str], scene: str, curves: int | None) -> Sdf.Layer:
    """Makes sure that a debug layer and its view layer can be written.

    Args:
        path: The debug layer.
        scene: The stage from which the photons come.
        curves: At most so many photons a frame; None for all.

    Returns:
        The scene's layer.

    Raises:
        InputError: The scene cannot be opened, the layers cannot be written where they are asked for, or ``curves`` is
            no number of photons.
    """
    path = Path(path)
    if path.suffix.lower() not in EXTENSIONS:
        raise InputError(f"is no name for a USD layer (use one of {', '.join(EXTENSIONS)})", file=str(path))
    if curves is not None and curves < 1:
        raise InputError(f"--curves must be above 0, not {curves}")
    layer = open_scene_layer(scene)
    for layer_path in (path, view_path(path)):
        check_writable(layer_path)
        if os.path.realpath(layer_path) == os.path.realpath(layer.realPath or scene):
            raise InputError("is the scene itself (choose another name)", file=str(layer_path))
    return layer


class DebugLayerWriter:
    """Writes a debug layer frame by frame, and its view layer.

    Use it in a ``with`` block, or call :meth:`close`: until then, and after an error in the block, neither file
    appears. A crate layer goes to disk with every frame, so that memory holds one frame and not the animation.

    Colours show the speed |D_t x| on one scale for the whole layer, or where nothing moves the flux; the variant set
    ``colour`` chooses, also the number of bounces or the receiver. The layer's ``customLayerData`` records it, with
    where the photons come from, under ``tpdwarp``: ``scene``, ``frameRange``, ``exposure`` (frames), ``settings``
    (JSON), ``version`` and ``fastestColor`` (scene units over the exposure).

    Where photons lie so far from the origin that single precision loses what they show, all prims have a translation
    in double precision, the same in every frame, and points relative to it.

    Args:
        path: The layer, ``.usdc``, ``.usd`` (crate as well) or ``.usda``; missing folders are made.
        source_file: Root layer of the scene.
        settings_dict: Settings of the trace, as JSON values.
        frame_range: First and last frame traced.
        exposure: Exposure in frames.
        time_codes_per_second: Of the scene's stage.
        frames_per_second: Of the scene's stage.
        up_axis: ``Y`` or ``Z``, of the scene's stage.
        meters_per_unit: Of the scene's stage.
        curves: At most so many photons are written for a frame, spread evenly over the light and the same in every
            frame in which they land; None for all.

    Raises:
        InputError: The scene cannot be opened, or the layers cannot be written where they are asked for.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        source_file: str | os.PathLike[str],
        settings_dict: Mapping[str, Any],
        frame_range: tuple[float, float],
        exposure: float,
        time_codes_per_second: float,
        frames_per_second: float,
        up_axis: str,
        meters_per_unit: float,
        curves: int | None = None,
        notes: Mapping[str, str] | None = None,
    ) -> None:
        self.path, self.view_path = Path(path), view_path(path)
        self._scene_path = os.fspath(source_file)
        self._scene = check_debug_layer(path, self._scene_path, curves)
        self._curves = curves
        self._bound: np.uint64 | None = None
        self._receivers: dict[str, int] = {}
        self._shades: dict[float, dict[str, np.ndarray]] = {}
        self._diameter: float | None = None
        self._origin: np.ndarray | None = None

        self._files = ExitStack()
        self._temporary_view = self._files.enter_context(complete_or_absent(self.view_path))
        temporary = self._files.enter_context(complete_or_absent(self.path))
        self._streams = self.path.suffix.lower() != ".usda"
        self._stage: Usd.Stage | None = Usd.Stage.CreateNew(temporary)
        self._stage.SetTimeCodesPerSecond(time_codes_per_second)
        self._stage.SetFramesPerSecond(frames_per_second)
        self._stage.SetStartTimeCode(self._scene.startTimeCode if self._scene.HasStartTimeCode() else frame_range[0])
        self._stage.SetEndTimeCode(self._scene.endTimeCode if self._scene.HasEndTimeCode() else frame_range[1])
        UsdGeom.SetStageUpAxis(self._stage, up_axis)
        UsdGeom.SetStageMetersPerUnit(self._stage, meters_per_unit)
        self._provenance = {
            "scene": self._scene_path,
            "frameRange": Gf.Vec2d(*frame_range),
            "exposure": float(exposure),
            "settings": json.dumps(dict(settings_dict), sort_keys=True),
            "version": program_version(),
            **(notes or {}),
        }

        scope = UsdGeom.Scope.Define(self._stage, "/TPD")
        scope.CreatePurposeAttr(UsdGeom.Tokens.guide)
        self._stage.SetDefaultPrim(scope.GetPrim())
        self._differentials = self._define_curves("TimeDifferentials", UsdGeom.Tokens.nonperiodic)
        self._footprints = self._define_curves("Footprints", UsdGeom.Tokens.periodic)
        self._swept = self._define_curves("SweptFootprints", UsdGeom.Tokens.periodic)
        self._points = UsdGeom.Points.Define(self._stage, "/TPD/Photons")
        self._points.SetWidthsInterpolation(UsdGeom.Tokens.vertex)
        self._define_primvars(self._points, UsdGeom.Tokens.vertex)
        self._author_curve_widths(FALLBACK_DIAMETER)
        self._colours = scope.GetPrim().GetVariantSets().AddVariantSet("colour")
        for name in COLOURS:
            self._colours.AddVariant(name)

    def __enter__(self) -> DebugLayerWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.close()
        else:
            self._stage = None
            self._files.__exit__(kind, error, trace)

    def add_frame(self, time: float, record: PhotonRecord, smoothing: float) -> None:
        """Writes the photons of one frame.

        Args:
            time: Time code of the frame.
            record: Its photons; none is legal.
            smoothing: Footprint size in lattice cells.

        Raises:
            FrameError: A value is not finite, or the layer cannot be written.
        """
        refuse_non_finite(record, time, self.path)
        record = self._thinned(record)
        if len(record) and self._diameter is None:
            self._diameter = typical_diameter(record, smoothing)
            self._author_curve_widths(self._diameter)
            self._author_origin(own_origin(record))
        if self._origin is not None:
            record = replace(record, positions=record.positions - self._origin)
        ends = record.positions[:, None] + np.array([-0.5, 0.5])[:, None] * record.dxdt[:, None]
        self._author_curves(self._differentials, ends, time)
        self._author_curves(self._footprints, footprint_outlines(record, smoothing), time)
        self._author_curves(self._swept, swept_outlines(record, smoothing), time)
        self._points.GetPointsAttr().Set(vectors(record.positions), time)
        self._points.GetIdsAttr().Set(Vt.Int64Array.FromNumpy(np.ascontiguousarray(record.ids, np.int64)), time)
        # One width a point: USD computes no extent of points that share one.
        widths = np.full(len(record), POINT_WIDTH * (self._diameter or FALLBACK_DIAMETER), np.float32)
        self._points.GetWidthsAttr().Set(Vt.FloatArray.FromNumpy(widths), time)

        table = [self._receivers.setdefault(path, len(self._receivers)) for path in record.receiver_paths]
        values = {
            "tpd:photonId": integers(record.ids & 0x7FFFFFFF),
            "tpd:flux": vectors(record.flux),
            "tpd:DuX": vectors(record.dxdu),
            "tpd:DvX": vectors(record.dxdv),
            "tpd:DtX": vectors(record.dxdt),
            "tpd:emission": Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(record.emission, np.float32)),
            "tpd:bounces": integers(record.bounces),
            "tpd:receiver": integers(np.array(table, np.int32)[record.receivers]),
        }
        for prim in self._prims():
            primvars = UsdGeom.PrimvarsAPI(prim)
            for name, value in values.items():
                primvars.GetPrimvar(name).Set(value, time)
            extent = UsdGeom.Boundable.ComputeExtentFromPlugins(prim, Usd.TimeCode(time))
            prim.GetExtentAttr().Set(extent, time)
        self._shades[time] = {
            "speed": np.linalg.norm(record.dxdt, axis=-1).astype(np.float32),
            "flux": record.flux.sum(axis=-1).astype(np.float32),
            "bounces": record.bounces.astype(np.float32),
            "receiver": np.array(table, np.float32)[record.receivers],
        }
        self._flush()

    def close(self) -> None:
        """Completes both layers and gives them their names. Later calls do nothing.

        Raises:
            FrameError: A layer cannot be written.
        """
        if self._stage is None:
            return
        with self._files:
            ends = {name: self._scale_of(name) for name in COLOURS}
            for name, end in ends.items():
                self._colours.SetVariantSelection(name)
                with self._colours.GetVariantEditContext():
                    for time, shades in self._shades.items():
                        colors = vectors(speed_colors(shades[name], end))
                        for prim in self._prims():
                            prim.GetDisplayColorAttr().Set(colors, time)
                self._flush()
            fastest = ends["speed"]
            moves = fastest > SMALLEST_MOTION * (self._diameter or FALLBACK_DIAMETER)
            self._colours.SetVariantSelection("speed" if moves else "flux")
            receivers = Vt.StringArray(list(self._receivers))
            for prim in self._prims():
                UsdGeom.PrimvarsAPI(prim).GetPrimvar("tpd:receivers").Set(receivers)
            self._stage.GetRootLayer().customLayerData = {"tpdwarp": {**self._provenance, "fastestColor": fastest}}
            self._save()
            self._stage = None
            self._write_view("differentials" if moves else "footprints")

    def _scale_of(self, name: str) -> float:
        """Where the colours of a quantity end."""
        values = np.concatenate([np.zeros(0), *(shades[name] for shades in self._shades.values())])
        if not len(values):
            return 0.0
        return float(np.percentile(values, RAMP_PERCENTILE) if name in ("speed", "flux") else values.max())

    def _prims(self) -> tuple[UsdGeom.PointBased, ...]:
        return self._differentials, self._footprints, self._swept, self._points

    def _define_curves(self, name: str, wrap: str) -> UsdGeom.BasisCurves:
        curves = UsdGeom.BasisCurves.Define(self._stage, f"/TPD/{name}")
        curves.CreateTypeAttr(UsdGeom.Tokens.linear)
        curves.CreateWrapAttr(wrap)
        curves.SetWidthsInterpolation(UsdGeom.Tokens.constant)
        self._define_primvars(curves, UsdGeom.Tokens.uniform)
        return curves

    def _define_primvars(self, prim: UsdGeom.PointBased, interpolation: str) -> None:
        primvars = UsdGeom.PrimvarsAPI(prim)
        for name, (kind, meaning) in PRIMVARS.items():
            primvars.CreatePrimvar(name, kind, interpolation).GetAttr().SetDocumentation(meaning)
        primvars.CreatePrimvar("tpd:receivers", Sdf.ValueTypeNames.StringArray, UsdGeom.Tokens.constant)
        prim.CreateDisplayColorPrimvar(interpolation)

    def _author_curve_widths(self, diameter: float) -> None:
        for curves in (self._differentials, self._footprints, self._swept):
            curves.GetWidthsAttr().Set([CURVE_WIDTH * diameter])

    def _author_origin(self, origin: np.ndarray | None) -> None:
        self._origin = origin
        if origin is not None:
            for prim in self._prims():
                prim.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(*origin.tolist()))

    def _author_curves(self, curves: UsdGeom.BasisCurves, points: np.ndarray, time: float) -> None:
        count, size, _ = points.shape
        curves.GetPointsAttr().Set(vectors(points.reshape(-1, 3)), time)
        curves.GetCurveVertexCountsAttr().Set(integers(np.full(count, size)), time)

    def _thinned(self, record: PhotonRecord) -> PhotonRecord:
        """At most ``curves`` photons. The bound only falls, so that a photon kept now was kept in earlier frames."""
        if self._curves is None:
            return record
        ranks = thinning_ranks(record)
        kept = np.ones(len(record), bool) if self._bound is None else ranks < self._bound
        if np.count_nonzero(kept) > self._curves:
            self._bound = np.partition(ranks[kept], self._curves)[self._curves]
            kept = ranks < self._bound
        return record.rows(kept)

    def _flush(self) -> None:
        if self._streams:
            self._save()

    def _save(self) -> None:
        try:
            self._stage.GetRootLayer().Save()
        except Tf.ErrorException as error:
            raise FrameError(f"{self.path}: cannot be written: {first_line(error)}") from error

    def _write_view(self, what: str) -> None:
        folder = os.path.realpath(self.view_path.parent)
        view = Sdf.Layer.CreateNew(self._temporary_view)
        # Stage metadata does not compose from sublayers.
        UsdUtils.CopyLayerMetadata(self._scene, view, skipSublayers=True)
        view.subLayerPaths = [
            # A link in its place is about to be replaced by the layer itself.
            relative_asset(os.path.join(os.path.realpath(self.path.parent), self.path.name), folder),
            relative_asset(self._scene.realPath, folder),
        ]
        shown = Sdf.CreatePrimInLayer(view, "/TPD")
        purpose = Sdf.AttributeSpec(shown, "purpose", Sdf.ValueTypeNames.Token, Sdf.VariabilityUniform)
        purpose.default = UsdGeom.Tokens.default_
        choices = Sdf.VariantSetSpec(shown, "what")
        for name, prims in SHOWN.items():
            variant = Sdf.VariantSpec(choices, name).primSpec
            for hidden in (prim for prim in SHOWN["all"] if prim not in prims):
                over = Sdf.PrimSpec(variant, hidden, Sdf.SpecifierOver)
                visibility = Sdf.AttributeSpec(over, "visibility", Sdf.ValueTypeNames.Token)
                visibility.default = UsdGeom.Tokens.invisible
        shown.variantSetNameList.prependedItems = ["what"]
        shown.variantSelections["what"] = what
        try:
            view.Save()
        except Tf.ErrorException as error:
            raise FrameError(f"{self.view_path}: cannot be written: {first_line(error)}") from error


def open_scene_layer(path: str) -> Sdf.Layer:
    """The layer at ``path``.

    Raises:
        InputError: There is none, or it cannot be read.
    """
    try:
        layer = Sdf.Layer.FindOrOpen(path) if path else None
    except Tf.ErrorException as error:
        raise InputError(f"cannot be read: {first_line(error)}", file=path) from error
    if layer is None:
        raise InputError("cannot be opened as a USD layer", file=path)
    return layer


def typical_diameter(record: PhotonRecord, smoothing: float) -> float:
    """A footprint's diameter, the median over the photons, or a part of their bounds where all have collapsed."""
    areas = np.linalg.norm(np.cross(record.dxdu, record.dxdv), axis=-1)
    diameter = smoothing * float(np.sqrt(np.median(areas)))
    spread = float(np.linalg.norm(np.ptp(record.positions, axis=0)))
    return diameter or FALLBACK_DIAMETER * (spread or 1.0)


def relative_asset(path: str, folder: str) -> str:
    """``path`` as an asset path anchored at ``folder``, so that both can move together."""
    relative = Path(os.path.relpath(path, folder)).as_posix()
    return relative if relative.startswith("../") else f"./{relative}"


def program_version() -> str:
    """The version of the installed package, or ``unknown`` in a tree that is not installed."""
    try:
        return importlib.metadata.version("tpdwarp")
    except importlib.metadata.PackageNotFoundError:
        return "unknown"


def first_line(error: Tf.ErrorException) -> str:
    """What the first of USD's errors says, without where in USD it was raised."""
    return shortened(error.args[0].commentary)


def vectors(values: np.ndarray) -> Vt.Vec3fArray:
    """A USD array of the rows of ``values``, shape [n, 3]."""
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(to_float32(values)))


def integers(values: np.ndarray) -> Vt.IntArray:
    """A USD array of ``values``, shape [n]."""
    return Vt.IntArray.FromNumpy(np.ascontiguousarray(values, np.int32))
