"""The debug layer: photons and their differentials as USD curves and points, and a layer that views them in the scene.

    shot.debug.usdc     /TPD (Scope, purpose guide) over TimeDifferentials, Footprints, SweptFootprints, Photons, Paths
    shot.view.usda      sublayers of the two, with /TPD shown

/TPD has two variant sets: ``colour`` (speed, flux, bounces, receiver or light) and, in the view layer, ``what`` is
shown. Colours of the variant that is shown first stand as they are; the others are places in a table of 256 colours,
which take a twelfth of the room.

The guide purpose keeps photons out of renders of a scene that has the debug layer among its own; the view layer shows
them without a viewer having to ask for guides.
"""

from __future__ import annotations

import importlib.metadata
import json
import os
from collections.abc import Mapping, Sequence
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
from tpdwarp.photons.paths import PhotonPaths
from tpdwarp.photons.record import PhotonRecord
from tpdwarp.photons.thinning import thinning_ranks
from tpdwarp.usd.write.colors import palette, palette_places, speed_colors
from tpdwarp.usd.write.local_origin import own_origin
from tpdwarp.usd.write.outlines import COARSE, FINE, MOST_FINE, footprint_outlines, swept_outlines

# What colours may show of each photon, by name, shape [n] float32.
Shades = dict[str, np.ndarray]

EXTENSIONS = (".usdc", ".usda", ".usd")

# Widths as parts of a typical footprint's diameter, and where there is none, of the cloud of photons.
CURVE_WIDTH = 0.02
POINT_WIDTH = 0.1
FALLBACK_DIAMETER = 0.01
# Nothing is narrower than this part of the cloud: half a pixel where it fills a picture of a thousand.
LEAST_CURVE_WIDTH = 5e-4
LEAST_POINT_WIDTH = 1e-3
# A layer whose photons all move by less than this part of a typical footprint shows nothing moving.
SMALLEST_MOTION = 1e-3

# What colours may show, and the prims that each choice of the view layer shows.
COLOURS = ("speed", "flux", "bounces", "receiver", "light")
SHOWN: dict[str, tuple[str, ...]] = {
    "differentials": ("TimeDifferentials",),
    "footprints": ("Footprints",),
    "swept": ("SweptFootprints",),
    "photons": ("Photons",),
    "paths": ("Paths",),
    "all": ("TimeDifferentials", "Footprints", "SweptFootprints", "Photons", "Paths"),
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
    "tpd:light": (Sdf.ValueTypeNames.IntArray, "Light that it comes from: index into tpd:lights."),
}

# Those that a layer has where the light of its first photons has an extent.
LIGHT_PRIMVARS: dict[str, tuple[Sdf.ValueTypeName, str]] = {
    "tpd:DaX": (Sdf.ValueTypeNames.Vector3fArray, "Derivative of the position by the place a on the light."),
    "tpd:DbX": (Sdf.ValueTypeNames.Vector3fArray, "Derivative of the position by the place b on the light."),
}


def view_path(path: str | os.PathLike[str]) -> Path:
    """The view layer that goes with a debug layer: ``shot.view.usda`` for ``shot.debug.usdc`` and for ``shot.usdc``."""
    path = Path(path)
    return path.parent / (path.stem.removesuffix(".debug") + ".view.usda")


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
    named = os.fspath(path)
    path = Path(path)
    if path.suffix.lower() not in EXTENSIONS:
        raise InputError(f"is no name for a USD layer (use one of {', '.join(EXTENSIONS)})", file=named)
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
    ``colour`` chooses, also the number of bounces, the receiver or the light. The layer's ``customLayerData`` records
    that scale, and where the photons come from, under ``tpdwarp``: ``scene``, ``frameRange``, ``exposure`` (frames),
    ``settings`` (JSON), ``version`` and ``fastestColor`` (scene units over the exposure).

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
        self._lights: dict[str, int] = {}
        self._corners = FINE
        self._shades: dict[float, tuple[Shades, Shades]] = {}
        self._diameter: float | None = None
        self._has_light_columns: bool | None = None
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
        self._paths = self._define_curves("Paths", UsdGeom.Tokens.nonperiodic)
        self._author_curve_widths(CURVE_WIDTH * FALLBACK_DIAMETER)
        self._point_width = POINT_WIDTH * FALLBACK_DIAMETER
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

    def add_frame(
        self, time: float, record: PhotonRecord, smoothing: float, paths: PhotonPaths | None = None
    ) -> None:
        """Writes the photons of one frame.

        Args:
            time: Time code of the frame.
            record: Its photons; none is legal.
            smoothing: Footprint size in lattice cells.
            paths: Paths of some of them; None for none.

        Raises:
            FrameError: A value is not finite, or the layer cannot be written.
        """
        refuse_non_finite(record, time, self.path)
        record = self._thinned(record)
        if len(record) and self._diameter is None:
            self._begin_with(record, smoothing)
        if self._origin is not None:
            record = replace(record, positions=record.positions - self._origin)
        ends = record.positions[:, None] + np.array([-0.5, 0.5])[:, None] * record.dxdt[:, None]
        self._author_curves(self._differentials, ends, time)
        self._author_curves(self._footprints, footprint_outlines(record, smoothing, self._corners), time)
        self._author_curves(self._swept, swept_outlines(record, smoothing, self._corners), time)
        self._points.GetPointsAttr().Set(vectors(record.positions), time)
        self._points.GetIdsAttr().Set(Vt.Int64Array.FromNumpy(np.ascontiguousarray(record.ids, np.int64)), time)
        # One width a point: USD computes no extent of points that share one.
        widths = np.full(len(record), self._point_width, np.float32)
        self._points.GetWidthsAttr().Set(Vt.FloatArray.FromNumpy(widths), time)
        shades = self._author_primvars((self._differentials, self._footprints, self._swept, self._points), record, time)
        self._shades[time] = shades, self._author_paths(record, paths, time)
        self._flush()

    def _begin_with(self, record: PhotonRecord, smoothing: float) -> None:
        """Chooses what is the same in all frames by the first photons."""
        self._diameter = diameter = typical_diameter(record, smoothing)
        spread = float(np.linalg.norm(np.ptp(record.positions, axis=0)))
        self._author_curve_widths(max(CURVE_WIDTH * diameter, LEAST_CURVE_WIDTH * spread))
        self._point_width = max(POINT_WIDTH * diameter, LEAST_POINT_WIDTH * spread)
        self._author_origin(own_origin(record))
        self._corners = FINE if len(record) <= MOST_FINE else COARSE

    def _author_paths(self, record: PhotonRecord, paths: PhotonPaths | None, time: float) -> Shades:
        if paths is None:
            paths = PhotonPaths(record.rows(np.zeros(len(record), bool)), np.zeros(0, np.int32), np.zeros((0, 3)))
        if self._curves is not None and len(paths.counts) > self._curves:
            ranks = thinning_ranks(paths.photons)
            paths = paths.rows(ranks < np.partition(ranks, self._curves)[self._curves])
        points = paths.points if self._origin is None else paths.points - self._origin
        self._paths.GetPointsAttr().Set(vectors(points), time)
        self._paths.GetCurveVertexCountsAttr().Set(integers(paths.counts), time)
        return self._author_primvars((self._paths,), paths.photons, time)

    def _author_primvars(self, prims: Sequence[UsdGeom.PointBased], record: PhotonRecord, time: float) -> Shades:
        """What is known of each photon, on prims with one curve or point a photon; what their colours may show."""
        receivers = _placed_in(self._receivers, record.receiver_paths, record.receivers)
        lights = _placed_in(self._lights, record.light_paths, record.lights)
        if len(lights) != len(record):
            lights = np.full(len(record), -1, np.int32)
        values = {
            "tpd:photonId": integers(record.ids & 0x7FFFFFFF),
            "tpd:flux": vectors(record.flux),
            "tpd:DuX": vectors(record.dxdu),
            "tpd:DvX": vectors(record.dxdv),
            "tpd:DtX": vectors(record.dxdt),
            "tpd:emission": Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(record.emission, np.float32)),
            "tpd:bounces": integers(record.bounces),
            "tpd:receiver": integers(receivers),
            "tpd:light": integers(lights),
        }
        values |= self._light_columns(record)
        for prim in prims:
            primvars = UsdGeom.PrimvarsAPI(prim)
            for name, value in values.items():
                primvars.GetPrimvar(name).Set(value, time)
            extent = UsdGeom.Boundable.ComputeExtentFromPlugins(prim, Usd.TimeCode(time))
            prim.GetExtentAttr().Set(extent, time)
        return {
            "speed": np.linalg.norm(record.dxdt, axis=-1).astype(np.float32),
            "flux": record.flux.sum(axis=-1).astype(np.float32),
            "bounces": record.bounces.astype(np.float32),
            # The first of them has a colour that is seen on dark floors, too.
            "receiver": receivers.astype(np.float32) + 1.0,
            "light": lights.astype(np.float32) + 1.0,
        }

    def _light_columns(self, record: PhotonRecord) -> dict[str, Vt.Vec3fArray]:
        """D_a x and D_b x, where the first photons have them; zero in frames that do not."""
        if self._has_light_columns is None and len(record):
            self._has_light_columns = len(record.dxda) > 0
            if self._has_light_columns:
                for prim in self._prims():
                    interpolation = UsdGeom.Tokens.uniform
                    if prim.GetPrim() == self._points.GetPrim():
                        interpolation = UsdGeom.Tokens.vertex
                    for name, (kind, meaning) in LIGHT_PRIMVARS.items():
                        primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar(name, kind, interpolation)
                        primvar.GetAttr().SetDocumentation(meaning)
        if not self._has_light_columns:
            return {}
        none = np.zeros((len(record), 3))
        columns = {"tpd:DaX": record.dxda, "tpd:DbX": record.dxdb}
        return {name: vectors(column if len(column) else none) for name, column in columns.items()}

    def close(self) -> None:
        """Completes both layers and gives them their names. Later calls do nothing.

        Raises:
            FrameError: A layer cannot be written.
        """
        if self._stage is None:
            return
        with self._files:
            ends = {name: self._scale_of(name) for name in COLOURS}
            fastest = ends["speed"]
            moves = fastest > SMALLEST_MOTION * (self._diameter or FALLBACK_DIAMETER)
            first = "speed" if moves else "flux"
            for name, end in ends.items():
                self._colours.SetVariantSelection(name)
                with self._colours.GetVariantEditContext():
                    self._author_colors(name, end, name == first)
                self._flush()
            self._colours.SetVariantSelection(first)
            for prim in self._prims():
                primvars = UsdGeom.PrimvarsAPI(prim)
                primvars.GetPrimvar("tpd:receivers").Set(Vt.StringArray(list(self._receivers)))
                primvars.GetPrimvar("tpd:lights").Set(Vt.StringArray(list(self._lights)))
            self._stage.GetRootLayer().customLayerData = {"tpdwarp": {**self._provenance, "fastestColor": fastest}}
            self._save()
            self._stage = None
            self._write_view("differentials" if moves else "footprints")

    def _author_colors(self, name: str, end: float, plain: bool) -> None:
        """Colours by a quantity, as they are or as places in the table of colours."""
        table = vectors(palette())
        for time, both in self._shades.items():
            for prims, shades in zip((self._prims()[:-1], self._prims()[-1:]), both, strict=True):
                for prim in prims:
                    color = prim.GetDisplayColorPrimvar()
                    if plain:
                        color.Set(vectors(speed_colors(shades[name], end)), time)
                    else:
                        color.Set(table)
                        color.SetIndices(integers(palette_places(shades[name], end)), time)

    def _scale_of(self, name: str) -> float:
        """Where the colours of a quantity end."""
        values = np.concatenate([np.zeros(0), *(shades[name] for shades, _ in self._shades.values())])
        if not len(values):
            return 0.0
        return float(np.percentile(values, RAMP_PERCENTILE) if name in ("speed", "flux") else values.max())

    def _prims(self) -> tuple[UsdGeom.PointBased, ...]:
        return self._differentials, self._footprints, self._swept, self._points, self._paths

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
        for name in ("tpd:receivers", "tpd:lights"):
            primvars.CreatePrimvar(name, Sdf.ValueTypeNames.StringArray, UsdGeom.Tokens.constant)
        prim.CreateDisplayColorPrimvar(interpolation)

    def _author_curve_widths(self, width: float) -> None:
        for curves in (self._differentials, self._footprints, self._swept, self._paths):
            curves.GetWidthsAttr().Set([width])

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


def _placed_in(table: dict[str, int], paths: Sequence[str], indices: np.ndarray) -> np.ndarray:
    """Indices into ``paths`` as indices into a table of all frames, which takes those that it lacks."""
    return np.array([table.setdefault(path, len(table)) for path in paths], np.int32)[indices]


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
