"""Templates of Open Job Description, the language of jobs that render farms of several makers take.

The template has one step whose tasks are chunks of frames, each rendered by ``tpdwarp render``. Stage, frames and
settings are parameters of the job, so that they can be changed where it is submitted.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import fields
from typing import Any

from tpdwarp.errors import InputError
from tpdwarp.io.files import complete_or_absent
from tpdwarp.io.frame_names import FrameNames, frame_text
from tpdwarp.io.images import check_format
from tpdwarp.io.outputs import check_outputs
from tpdwarp.jobs.frame_loop import Persistence
from tpdwarp.jobs.opening import FilePath, Frames, chosen_settings, frames_asked, open_scene
from tpdwarp.settings import CHOICES, Settings

VERSION = "jobtemplate-2023-09"
# Chunks of frames, in the names of Open Job Description's extensions.
EXTENSIONS = ("TASK_CHUNKING",)
# Settings that a job exposes whether they were given or not.
ALWAYS = ("photons", "samples", "threads")
# Options that are not called as their settings are.
_FLAGS = {"aovs": "--aov", "image_width": "--imageWidth", "render_settings": "--renderSettingsPrimPath"}
# Settings of several values, and what these are.
_SEVERAL = {"shutter": ("Open", "Close"), "resolution": ("Width", "Height"), "crop": ("X0", "Y0", "X1", "Y1")}
# An interrupted render ends within two seconds; who asks again after that kills.
NOTICE_SECONDS = 10
LONGEST_NAME = 128


def open_job_template(
    scene: FilePath,
    out: FilePath,
    template: FilePath,
    *,
    frames: Frames = None,
    chunk: int = 10,
    strict: bool = False,
    frame_timeout: float | None = None,
    retries: int = 0,
    max_failures: int | None = None,
    **settings: Any,
) -> dict[str, Any]:
    """Writes a template that renders frames of a USD stage.

    Args:
        scene: The stage.
        out: Image file, with ``####`` where the frame number goes.
        template: The template to write, ``.json``.
        frames: As for :func:`tpdwarp.render`; whole numbers.
        chunk: Frames in one task.
        strict, frame_timeout, retries, max_failures, **settings: As for :func:`tpdwarp.render`. Settings that are given
            become parameters of the job.

    Returns:
        The template as JSON values.

    Raises:
        InputError: Something cannot be used, or the template cannot be written.
    """
    if chunk < 1:
        raise InputError(f"--chunk must be above 0, not {chunk}")
    if os.path.splitext(os.fspath(template))[1].lower() != ".json":
        raise InputError("is no name for a template (end it in .json)", file=os.fspath(template))
    chosen = chosen_settings(settings)
    persistence = Persistence(frame_timeout, retries, max_failures)
    names = FrameNames(out)
    check_format(names.template, chosen.aovs, chosen.view)
    source = open_scene(scene, chosen, False)
    wanted = frames_asked(frames, False) or source.frames()
    names.check(wanted)
    check_outputs(
        {"the template": template}, {"is read by the scene": source.used_files()}, [names.path(f) for f in wanted]
    )
    given = {**{name: getattr(chosen, name) for name in ALWAYS}, **_changed(chosen)}
    folder = os.path.realpath(os.path.dirname(os.path.abspath(template)))
    paths = [
        _path("Scene", source.file, folder, "IN", "The stage."),
        _path("Out", names.template, folder, "OUT", "Image file, with #### where the frame number goes."),
    ]
    made = _template(_name(source.file), paths, wanted, chunk, given, persistence, strict)
    with complete_or_absent(template) as temporary, open(temporary, "w", encoding="utf-8") as file:
        json.dump(made, file, indent=2)
        file.write("\n")
    return made


def option_of(setting: str) -> str:
    """The command line's option for a setting."""
    return _FLAGS.get(setting, "--" + setting.replace("_", "-"))


def range_of(frames: Sequence[float]) -> str:
    """Frames as a range expression, such as ``1-24,30-40:2``.

    Raises:
        InputError: One is no whole number.
    """
    for frame in frames:
        if not float(frame).is_integer():
            raise InputError(f"frame {frame_text(frame)} is no whole number, as tasks of Open Job Description are")
    numbers = sorted({int(frame) for frame in frames})
    parts = []
    while numbers:
        step = numbers[1] - numbers[0] if len(numbers) > 1 else 1
        count = 1
        while count < len(numbers) and numbers[count] - numbers[count - 1] == step:
            count += 1
        # Two numbers far apart are no range.
        count = 1 if count == 2 and step > 1 else count
        first, last = numbers[0], numbers[count - 1]
        parts.append(str(first) if count == 1 else f"{first}-{last}" + (f":{step}" if step > 1 else ""))
        numbers = numbers[count:]
    return ",".join(parts)


def _changed(settings: Settings) -> dict[str, Any]:
    """Settings that are not the defaults."""
    return {
        field.name: getattr(settings, field.name)
        for field in fields(Settings)
        if getattr(settings, field.name) != field.default
    }


def _template(
    name: str,
    paths: list[dict[str, Any]],
    frames: Sequence[float],
    chunk: int,
    settings: dict[str, Any],
    persistence: Persistence,
    strict: bool,
) -> dict[str, Any]:
    parameters: list[dict[str, Any]] = [
        *paths,
        {"name": "Frames", "type": "STRING", "default": range_of(frames), "description": "As in 1-24,30-40:2."},
        {"name": "FramesPerTask", "type": "INT", "default": chunk, "minValue": 1, "description": "Frames in one task."},
    ]
    arguments = ["render", "{{Param.Scene}}", "{{Param.Out}}", "--frames={{Task.Param.Frame}}"]
    arguments += ["--skip-existing-frames", "--progress=openjd"]
    for setting, value in settings.items():
        for name, part in _parts(setting, value):
            parameters.append(_parameter(name, setting, part))
        values = [f"{{{{Param.{name}}}}}" for name, _ in _parts(setting, value)]
        arguments += [f"{option_of(setting)}={values[0]}"] if len(values) == 1 else [option_of(setting), *values]
    if persistence.frame_timeout is not None:
        arguments.append(f"--frame-timeout={persistence.frame_timeout:g}")
    if persistence.retries:
        arguments.append(f"--retries={persistence.retries}")
    if persistence.max_failures is not None:
        arguments.append(f"--max-failures={persistence.max_failures}")
    if strict:
        arguments.append("--strict")
    return {
        "specificationVersion": VERSION,
        "extensions": list(EXTENSIONS),
        "name": name,
        "parameterDefinitions": parameters,
        "steps": [
            {
                "name": "Render",
                "parameterSpace": {
                    "taskParameterDefinitions": [
                        {
                            "name": "Frame",
                            "type": "CHUNK[INT]",
                            "range": "{{Param.Frames}}",
                            "chunks": {
                                "defaultTaskCount": "{{Param.FramesPerTask}}",
                                "rangeConstraint": "CONTIGUOUS",
                            },
                        }
                    ]
                },
                "script": {
                    "actions": {
                        "onRun": {
                            "command": "tpdwarp",
                            "args": arguments,
                            "cancelation": {
                                "mode": "NOTIFY_THEN_TERMINATE",
                                "notifyPeriodInSeconds": NOTICE_SECONDS,
                            },
                        }
                    }
                },
            }
        ],
    }


def _name(scene: str) -> str:
    """The job's name: that of the stage, without what names may not hold or what would be read as a parameter."""
    stem = os.path.splitext(os.path.basename(scene))[0]
    text = "".join(character if character.isprintable() and character not in "{}" else "_" for character in stem)
    return f"tpdwarp {text}"[:LONGEST_NAME]


def _path(name: str, value: str, folder: str, flow: str, description: str) -> dict[str, Any]:
    """The parameter of a path: relative to the template's folder, so that both can be sent to a farm together.

    Defaults of paths may not lead out of that folder; one that does is a text, which farms do not map to their own
    folders.
    """
    place = os.path.relpath(os.path.realpath(value), folder)
    if place.split(os.sep)[0] == os.pardir:
        outside = f"{description} It does not lie below the template: the farm must see it under the same path."
        return {"name": name, "type": "STRING", "default": os.path.realpath(value), "description": outside}
    kind = {"name": name, "type": "PATH", "objectType": "FILE", "dataFlow": flow}
    return {**kind, "default": place, "description": description}


def _parts(setting: str, value: Any) -> list[tuple[str, Any]]:
    """Names and values of the parameters that a setting becomes: one, but for those of several values."""
    name = "".join(word.capitalize() for word in setting.split("_"))
    if setting in _SEVERAL:
        return [(f"{name}{part}", value[k]) for k, part in enumerate(_SEVERAL[setting])]
    return [(name, ",".join(value) if isinstance(value, tuple) else value)]


def _parameter(name: str, setting: str, value: Any) -> dict[str, Any]:
    kind = {int: "INT", float: "FLOAT"}.get(type(value), "STRING")
    where = f"See tpdwarp render --help, {option_of(setting)}."
    made = {"name": name, "type": kind, "default": value, "description": where}
    if setting in CHOICES and kind == "STRING":
        made["allowedValues"] = list(CHOICES[setting])
    return made
