"""What a stage holds, and what its frames therefore require of the tracer."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from tpdwarp.jobs.frame_need import need_of
from tpdwarp.jobs.opening import Frames, chosen_settings, frames_asked, open_scene, shutter_of
from tpdwarp.scene.requirements import Requirements, requirements_of
from tpdwarp.usd.read.stage import StageLike


def info(scene: StageLike, *, frames: Frames = None, default_time: bool = False, **settings: Any) -> dict[str, Any]:
    """What a stage holds and requires, as plain JSON values.

    The stage's own description (meshes, lights, cameras, rates, units, warnings) with ``memory_of_a_frame`` (what the
    first frame is made of, and the bytes it will need, about) and ``requirements`` added: one
    entry for each run of frames that require the same, with ``frames`` (how many), ``first`` and ``last`` (null for
    the default time), and the fields of :class:`tpdwarp.scene.requirements.Requirements`.

    Args:
        scene: The stage; it needs no camera.
        frames: A specification such as ``1:24``, a frame, or several; None for the stage's whole range.
        default_time: Look at the default time in place of frames.
        **settings: Fields of :class:`tpdwarp.settings.Settings`.

    Raises:
        InputError: The input or the settings cannot be used.
    """
    chosen = chosen_settings(settings)
    asked = frames_asked(frames, default_time)
    source = open_scene(scene, chosen, default_time)
    wanted = asked or source.frames()
    needed = ((frame, requirements_of(source.at(shutter_of(source, frame, chosen)))) for frame in wanted)
    requirements = _runs(needed)
    width, height = source.region().size
    need = need_of(source, shutter_of(source, wanted[0], chosen), chosen, width * height)
    memory = {"triangles": need.triangles, "photons": need.photons, "pixels": need.pixels, "bytes": need.bytes}
    # Described last, since warnings come up while frames are read.
    return {**source.describe(), "memory_of_a_frame": memory, "requirements": requirements}


def _runs(needed: Iterable[tuple[float, Requirements]]) -> list[dict[str, Any]]:
    runs: list[dict[str, Any]] = []
    before: Requirements | None = None
    for frame, requirements in needed:
        number = None if math.isnan(frame) else frame
        if requirements != before:
            runs.append({"first": number, "last": number, "frames": 0, **requirements.as_dict()})
        runs[-1]["last"] = number
        runs[-1]["frames"] += 1
        before = requirements
    return runs
