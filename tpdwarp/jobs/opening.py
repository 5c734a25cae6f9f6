"""What a caller asks for: settings, a stage, frames of it and their shutters, looked at before anything is rendered."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import replace
from numbers import Real
from typing import Any

from tpdwarp.device import Launcher
from tpdwarp.errors import InputError
from tpdwarp.io.files import check_name
from tpdwarp.io.memory import memory_allowed
from tpdwarp.rendering.error_target import ErrorTarget, settled
from tpdwarp.scene.description import Shutter
from tpdwarp.settings import AOV_ALIASES, AOVS, Settings
from tpdwarp.usd.read.default_time import DefaultTimeScene
from tpdwarp.usd.read.frame_specs import frames_of
from tpdwarp.usd.read.stage import StageLike, StageScene

Frames = str | float | Iterable[float] | None
FilePath = str | os.PathLike[str]

DEFAULT_TIME = math.nan


def chosen_settings(changes: Mapping[str, Any], settings: Settings | None = None) -> Settings:
    """``settings`` (or the defaults) with ``changes``.

    Raises:
        InputError: A name or a value is not usable.
    """
    return Settings.of(settings, **changes)


def open_scene(
    scene: StageLike | StageScene, settings: Settings, default_time: bool, max_memory: float | None = None
) -> StageScene:
    """The stage, at its default time if that is asked for; one that is open stays what it is.

    Args:
        max_memory: Bytes that rendering may take; None for three quarters of the machine.

    Raises:
        InputError: The stage cannot be used.
    """
    if isinstance(scene, StageScene):
        return scene
    if isinstance(scene, str | os.PathLike):
        check_name(scene)
    kind = DefaultTimeScene if default_time else StageScene
    return kind.open(scene, settings, memory_allowed(max_memory))


def shutter_of(source: StageScene, frame: float, settings: Settings) -> Shutter:
    """The shutter of a frame; a still where ``frame`` is NaN, the default time.

    Raises:
        InputError: The camera's shutter cannot be used.
    """
    return Shutter.still(source.start) if math.isnan(frame) else source.shutter(frame, settings)


def time_of(frame: Any, default_time: bool = False) -> float:
    """The time code that a caller names by a number, or by USD's own.

    Args:
        frame: What the caller gave.
        default_time: Whether NaN may name the default time.

    Raises:
        InputError: It is none.
    """
    number = frame
    if hasattr(frame, "IsDefault"):
        number = DEFAULT_TIME if frame.IsDefault() else frame.GetValue()
    usable = isinstance(number, Real) and not isinstance(number, bool) and not math.isinf(number)
    if not usable or (math.isnan(number) and not default_time):
        raise InputError(f"frame {frame!r}: is no time code (give a number)")
    return float(number)


def frames_asked(frames: Frames, default_time: bool) -> tuple[float, ...] | None:
    """The frames a caller names; None where that is the stage's whole range.

    Raises:
        InputError: They cannot be understood, or are none.
    """
    if default_time:
        if frames is not None:
            raise InputError("--default-time takes the place of --frames (leave one out)")
        return (DEFAULT_TIME,)
    if frames is None:
        return None
    if isinstance(frames, str):
        return frames_of(frames)
    try:
        listed = (frames,) if isinstance(frames, Real) else tuple(frames)
        chosen = tuple(dict.fromkeys(float(frame) for frame in listed))
    except (TypeError, ValueError):
        raise InputError(f"--frames {frames!r}: these are no frames (give numbers, or a text like '1:24')") from None
    if not chosen or not all(map(math.isfinite, chosen)):
        raise InputError(f"--frames {frames!r}: there must be at least one, and all finite")
    return chosen


def opened(
    scene: StageLike | StageScene,
    settings: Settings,
    frames: Frames,
    default_time: bool,
    strict: bool,
    max_memory: float | None = None,
) -> tuple[StageScene, tuple[float, ...]]:
    """The stage and the frames of it that are asked for, or all; arguments are those of a sequence.

    Raises:
        InputError: Something cannot be used.
    """
    asked = frames_asked(frames, default_time)
    # Tried here, so that a missing device is refused once and not by every frame.
    Launcher(settings.device, settings.threads)
    source = open_scene(scene, settings, default_time, max_memory)
    if strict and source.warnings.of_usd:
        raise InputError(f"{source.warnings.of_usd[0]} (--strict)", file=source.file)
    return source, asked or source.frames()


def with_render_vars(settings: Settings, source: StageScene, template: str) -> Settings:
    """``settings`` with the AOVs that the stage's RenderVars name, for an EXR where none are asked for."""
    if settings.aovs or not template.lower().endswith(".exr"):
        return settings
    known = {name.lower(): name for name in AOVS} | {name: aov for name, aov in AOV_ALIASES.items()}
    unknown = [name for name in source.render_vars if name.lower() not in known]
    for name in unknown:
        source.warnings(source.render_settings_path, f"the RenderVar {name} is not rendered")
    return replace(settings, aovs=tuple(known[name.lower()] for name in source.render_vars if name not in unknown))


def settled_settings(source: StageScene, settings: Settings) -> tuple[Settings, ErrorTarget | None]:
    """Settings without an open choice of photons, and what they were chosen for, if for anything."""
    if settings.target_error is None:
        return settings, None
    return settled(source, settings, spread_shutters(source, settings), *source.resolution())


def spread_shutters(source: StageScene, settings: Settings) -> list[Shutter]:
    """Shutters of whole frames spread over the animation.

    Between frames they would see breaks in the motion of vertices, which frames that open on a time sample do not see.

    Raises:
        InputError: The camera's shutter cannot be used.
    """
    offsets = (round(still.middle - source.start) for still in source.reference_shutters())
    frames = [min(source.start + offset, source.end) for offset in dict.fromkeys(offsets)]
    return [shutter_of(source, frame, settings) for frame in frames]
