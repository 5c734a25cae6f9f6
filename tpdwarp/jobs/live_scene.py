"""A stage that stays open: its frames, photons and irradiance as arrays, with nothing written."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from numbers import Real
from typing import Any

import numpy as np

from tpdwarp.clock import Clock
from tpdwarp.errors import InputError
from tpdwarp.io.images import encode_srgb, encoded_picture
from tpdwarp.jobs.holdouts import held_out
from tpdwarp.jobs.opening import chosen_settings, open_scene, settled_settings, shutter_of, time_of
from tpdwarp.photons.record import PhotonRecord
from tpdwarp.rendering import frame as one_frame
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.surface_points import PointGroup, irradiance_at, points_on_surfaces, square
from tpdwarp.settings import MachineSettings, Settings, StageSettings
from tpdwarp.usd.read.stage import StageLike, StageScene

# Settings that the stage is opened with, and put on the device; its shutter is asked for frame by frame.
_READ_WITH = {"bounces", *(field.name for group in (StageSettings, MachineSettings) for field in fields(group))} - {
    "exposure",
    "shutter",
}


@dataclass(repr=False)
class RenderedFrame(one_frame.Frame):
    """A frame in memory; notebooks show its beauty.

    Attributes:
        frame: Its time code.
    """

    frame: float = math.nan

    def __repr__(self) -> str:
        height, width = self.channels["R"].shape
        names = " ".join(dict.fromkeys(name.partition(".")[0] for name in self.channels))
        return f"tpdwarp.RenderedFrame(frame {self.frame:g}, {width} × {height}, {names}, {len(self.photons)} photons)"

    @property
    def beauty(self) -> np.ndarray:
        """Linear Rec.709 and alpha, shape [height, width, 4] float32."""
        return np.stack([self.channels[name] for name in "RGBA"], axis=-1)

    def _repr_png_(self) -> bytes:
        pixels = encode_srgb(self.beauty)[..., :3]
        return encoded_picture((np.clip(pixels, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8), ".png")


class Scene:
    """A USD stage with the settings that it is rendered with, open from frame to frame.

    Settings given to a method hold for that call only. What stays the same (the stage, its units, its lattices of
    photons) is made once.

    >>> import tpdwarp
    >>> scene = tpdwarp.Scene("usd_scenes/wave.usdc", photons=1024, exposure=1.0, image_width=32, samples=1)
    >>> scene
    tpdwarp.Scene('usd_scenes/wave.usdc', frames 1 to 24)
    >>> scene.frames[:3]
    (1.0, 2.0, 3.0)
    >>> frame = scene.render_frame(2, aovs=["irradiance"])
    >>> sorted(frame.channels)
    ['A', 'B', 'G', 'R', 'irradiance.B', 'irradiance.G', 'irradiance.R']
    >>> frame.channels["R"].shape
    (18, 32)

    Args:
        scene: A USD file, an ``Sdf.Layer`` or a ``Usd.Stage``.
        settings: :class:`tpdwarp.settings.Settings`; None for the defaults.
        **changes: Fields of it that differ.

    Attributes:
        settings: The settings.

    Raises:
        InputError: The stage or the settings cannot be used.
    """

    def __init__(self, scene: StageLike, settings: Settings | None = None, **changes: Any) -> None:
        self.settings = chosen_settings(changes, settings)
        self._scene = scene
        self._open: StageScene | None = open_scene(scene, self.settings, False)

    def __enter__(self) -> Scene:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Lets go of the stage and of what was made of it. Later calls of :meth:`close` do nothing, others fail."""
        self._open = None
        for name in ("_opened", "_context"):
            self.__dict__.pop(name, None)

    def __repr__(self) -> str:
        if self._open is None:
            return "tpdwarp.Scene(closed)"
        first, last = self._source.start, self._source.end
        return f"tpdwarp.Scene({self._source.file!r}, frames {first:g} to {last:g})"

    @property
    def frames(self) -> tuple[float, ...]:
        """The time codes of the stage's range; the first alone where nothing changes."""
        return self._source.frames()

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the stage holds that is not rendered, a line a kind."""
        return tuple(self._source.warnings.messages)

    def render_frame(self, frame: float, **changes: Any) -> RenderedFrame:
        """Renders one frame; nothing is written.

        Args:
            frame: Time code.
            **changes: Fields of :class:`tpdwarp.settings.Settings` that differ for this call.

        Returns:
            Its ``channels`` (by their names in an EXR, each [height, width] float32), ``camera``, ``energy``
            [W] and ``photons``.

        Raises:
            InputError: The stage cannot be used there.
            FrameError: The frame cannot be rendered.
        """
        context = self._context_with(changes)
        moment = time_of(frame)
        shutter = shutter_of(context.source, moment, context.settings)
        region = context.source.region()
        made = one_frame.render_frame(context, shutter, region.width, region.height, region=region)
        channels = held_out(made.channels, context.settings.holdout, moment, region)
        return RenderedFrame(made.landed, made.energy, made.seconds, channels, made.camera, frame=moment)

    def trace_photons(self, frame: float, **changes: Any) -> PhotonRecord:
        """The photons that land over the shutter of a frame; see :func:`tpdwarp.trace_photons`."""
        context = self._context_with(changes)
        return one_frame.trace_frame(context, shutter_of(context.source, time_of(frame), context.settings)).photons

    def irradiance(
        self, frame: float, points: np.ndarray, normals: np.ndarray, *, spacing: float = 0.0, **changes: Any
    ) -> np.ndarray:
        """Irradiance that photons leave on diffuse surfaces, averaged over the shutter.

        Points of surfaces that move ride along: they are given where they stand in the middle of the shutter.

        Args:
            frame: Time code.
            points: World positions on diffuse surfaces, within a thousandth of the scene's size, shape [n, 3].
            normals: The side of the surface that is meant, shape [n, 3]; of any length.
            spacing: Side of the square [scene units] that each value is the mean over; 0 for the value at the point.
            **changes: Fields of :class:`tpdwarp.settings.Settings` that differ for this call.

        Returns:
            Irradiance [W/m²], shape [n, 3] float64; NaN where there is no diffuse surface.

        >>> import tpdwarp
        >>> scene = tpdwarp.Scene("usd_scenes/wave.usdc", photons=1024, exposure=1.0)
        >>> on_floor, above_it = scene.irradiance(2, [[0, 0, 0], [0, 0, 0.5]], [[0, 0, 1], [0, 0, 1]])
        >>> bool((on_floor > 0).all()), bool((above_it == above_it).any())
        (True, False)

        Raises:
            InputError: The arrays do not fit, or the stage cannot be used there.
        """
        places, sides = _vectors("points", points), _vectors("normals", normals)
        if len(places) != len(sides):
            raise InputError(f"{len(places)} points and {len(sides)} normals (give as many)")
        if not (isinstance(spacing, Real) and math.isfinite(spacing) and spacing >= 0.0):
            raise InputError(f"spacing {spacing!r}: must be a length, 0 or more")
        context = self._context_with(changes)
        shutter = shutter_of(context.source, time_of(frame), context.settings)
        scenes = context.segmentation.load(shutter, Clock())
        found = points_on_surfaces(context, scenes, places, sides)
        area = square(float(spacing), context)
        lights, _ = irradiance_at(context, shutter, scenes, [PointGroup(found, area)])
        return lights[0].irradiance

    @property
    def _source(self) -> StageScene:
        if self._open is None:
            raise InputError("the scene is closed (make another tpdwarp.Scene)")
        return self._open

    @cached_property
    def _opened(self) -> RenderContext:
        return RenderContext(self._source, self.settings)

    @cached_property
    def _context(self) -> RenderContext:
        return self._context_of(self.settings)

    def _context_with(self, changes: Mapping[str, Any]) -> RenderContext:
        if not changes:
            return self._context
        settings = chosen_settings(changes, self.settings)
        if self._source and any(getattr(settings, name) != getattr(self.settings, name) for name in _READ_WITH):
            return Scene(self._scene, settings)._context
        return self._context_of(settings)

    def _context_of(self, settings: Settings) -> RenderContext:
        settings, _ = settled_settings(self._source, settings)
        return self._opened.with_settings(settings)


def _vectors(name: str, values: np.ndarray) -> np.ndarray:
    try:
        found = np.asarray(values, np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name}: are no numbers (give [n, 3])") from None
    if found.ndim != 2 or found.shape[1] != 3:
        raise InputError(f"{name}: shape {list(found.shape)} (give [n, 3])")
    if not np.isfinite(found).all():
        raise InputError(f"{name}: hold values that are not finite")
    return found


def render_frame(scene: StageLike, frame: float, settings: Settings | None = None, **changes: Any) -> RenderedFrame:
    """Renders one frame of a stage; nothing is written. See :meth:`Scene.render_frame`.

    Raises:
        InputError: The stage or the settings cannot be used.
        FrameError: The frame cannot be rendered.
    """
    return Scene(scene, settings, **changes).render_frame(frame)


def irradiance(
    scene: StageLike,
    frame: float,
    points: np.ndarray,
    normals: np.ndarray,
    settings: Settings | None = None,
    *,
    spacing: float = 0.0,
    **changes: Any,
) -> np.ndarray:
    """Irradiance from photons at points of surfaces. See :meth:`Scene.irradiance`.

    Raises:
        InputError: The stage, the settings or the arrays cannot be used.
    """
    return Scene(scene, settings, **changes).irradiance(frame, points, normals, spacing=spacing)
