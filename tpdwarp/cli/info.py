"""``tpdwarp info``: what a stage holds and what it requires."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from typing import Any

from tpdwarp.cli.options import EXPOSURE, PICTURE, SettingOption, declare_frames, declare_settings, settings_given
from tpdwarp.cli.outcome import DONE
from tpdwarp.cli.report import warnings_shown
from tpdwarp.io.terminal import printable, say
from tpdwarp.jobs.progress import Progress
from tpdwarp.loading import collector_paused

SUMMARY = "say what a USD stage holds and what it requires of the tracer"
EPILOG = (
    "Requirements are listed for each run of frames that share them: the differentials photons carry, the\n"
    "interactions they meet, and what moves while the shutter is open.\n"
    "Exit code: 0 done, 2 wrong usage or unusable input, 130 or 143 interrupted."
)
_PICTURE_ONLY = ("samples", "aovs", "exr_type", "view", "view_exposure")


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the sub-command's arguments."""
    parser.usage = "tpdwarp info SCENE [options]"
    parser.add_argument("scene", metavar="SCENE", help="USD stage.")
    parser.add_argument("--json", action="store_true", help="Print JSON.")
    declare_frames(parser)
    stage = parser.add_argument_group("stage and image")
    declare_settings(stage, [option for option in PICTURE if option.field not in _PICTURE_ONLY])
    time = parser.add_argument_group("time")
    declare_settings(time.add_mutually_exclusive_group(), EXPOSURE)
    declare_settings(time, [SettingOption("motion", ("--motion",))])


def run(options: argparse.Namespace) -> int:
    """Prints; returns the exit code."""
    # What it found stands among what it prints.
    with warnings_shown(Progress(), "error"):
        # Here and not above, so that --help need not wait for USD to load.
        with collector_paused():
            from tpdwarp.jobs.stage_info import info

        holdings = info(
            options.scene, frames=options.frames, default_time=options.default_time, **settings_given(options)
        )
    say(json.dumps(holdings, indent=1) if options.json else "\n".join(_lines(holdings, "")), sys.stdout)
    return DONE


def _lines(values: dict[str, Any], indent: str) -> Iterator[str]:
    """A mapping as text: a line a value, lists of mappings below their names, a line an entry."""
    for name, value in values.items():
        label = f"{indent}{name.replace('_', ' ')}:"
        if isinstance(value, dict):
            yield label
            yield from _lines(value, indent + "  ")
        elif isinstance(value, list | tuple) and any(isinstance(entry, dict) for entry in value):
            yield label
            for entry in value:
                parts = (f"{key.replace('_', ' ')} {_text(part)}" for key, part in entry.items())
                yield f"{indent}  - {', '.join(parts)}"
        else:
            yield f"{label} {_text(value)}"


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        return " ".join(map(_text, value)) or "none"
    if isinstance(value, float):
        return f"{value:.9g}"
    return "none" if value in (None, "") else printable(str(value))
