"""Options shared by sub-commands; those of settings take their help and defaults from :class:`Settings` itself."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields
from functools import cache
from typing import Any

from tpdwarp.jobs.progress import KINDS
from tpdwarp.presets import PRESETS
from tpdwarp.settings import AOVS, CHOICES, Settings

LOG_LEVELS = ("debug", "info", "warning", "error")
COMPLEXITIES = {"low": 1.0, "medium": 1.1, "high": 1.2, "veryhigh": 1.3}


def names(text: str) -> tuple[str, ...]:
    """A comma separated list."""
    return tuple(part for part in map(str.strip, text.split(",")) if part)


def complexity(text: str) -> float:
    """A complexity by usdrecord's words, or as a number."""
    try:
        return COMPLEXITIES[text] if text in COMPLEXITIES else float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is neither a number nor {', '.join(COMPLEXITIES)}") from None


def count_or_auto(text: str) -> int | str:
    """A number, or auto."""
    try:
        return text if text == "auto" else int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is neither a whole number nor auto") from None


@dataclass(frozen=True)
class SettingOption:
    """The command line's face of one field of :class:`Settings`.

    Attributes:
        field: The field.
        flags: Spellings of the option.
        kind: What the text of the value becomes.
        metavar: How help names the value; one a value where there are several.
        also: What help adds to the field's documentation.
        alone: What the option means without a value; None where it needs one.
        brief: What help says in the place of the field's documentation, where that begins at length.
    """

    field: str
    flags: tuple[str, ...]
    kind: Callable[[str], Any] = str
    metavar: str | tuple[str, ...] | None = None
    also: str = ""
    alone: tuple[str, ...] | None = None
    brief: str = ""


PICTURE = (
    SettingOption("camera", ("-cam", "--camera"), metavar="CAMERA"),
    SettingOption("image_width", ("-w", "--imageWidth"), int, "PIXELS"),
    SettingOption("resolution", ("--resolution",), int, ("W", "H")),
    SettingOption(
        "crop", ("--crop",), float, ("X0", "Y0", "X1", "Y1"), "0 … 1 from lower left, or pixels from upper left"
    ),
    SettingOption("render_settings", ("-rs", "--renderSettingsPrimPath"), metavar="PATH"),
    SettingOption("product", ("--product",), metavar="NAME"),
    SettingOption("purposes", ("--purposes",), names, "NAME,..."),
    SettingOption("mask", ("--mask",), names, "PATH,..."),
    SettingOption("complexity", ("--complexity",), complexity, "X", also=f"a number, or {'|'.join(COMPLEXITIES)}"),
    SettingOption("samples", ("--samples",), int, "S"),
    SettingOption(
        "view_cutoff",
        ("--view-cutoff",),
        float,
        "PART",
        brief="Least part of a sample that is followed.",
    ),
    SettingOption(
        "refracted_radiance",
        ("--refracted-radiance",),
        brief="Radiance seen through interfaces.",
    ),
    SettingOption("aovs", ("--aov",), names, "NAME,...", also=", ".join(AOVS)),
    SettingOption("exr_type", ("--exr-type",), metavar="half|float"),
    SettingOption("light_groups", ("--light-groups",), names, "NAME=PATTERN,...", "auto if alone", ("auto",)),
    SettingOption("holdout", ("--holdout",), metavar="HOST.EXR", brief="Images whose depth hides what is behind."),
    SettingOption("view", ("--view",), metavar="AOV", brief="What PNG, JPEG and TIFF show instead of the beauty."),
    SettingOption("view_exposure", ("--view-exposure",), float, "STOPS"),
)
EXPOSURE = (
    SettingOption(
        "exposure", ("--exposure",), float, "FRAMES", brief="How long the shutter is open from the frame on, in frames."
    ),
    SettingOption("shutter", ("--shutter",), float, ("OPEN", "CLOSE")),
)
METHOD = (
    SettingOption("motion", ("--motion",)),
    SettingOption("photons", ("--photons",), int, "N"),
    SettingOption(
        "segments", ("--segments",), count_or_auto, "K|auto", brief="Parts of the shutter that are traced apart."
    ),
    SettingOption(
        "light_splits",
        ("--light-splits",),
        count_or_auto,
        "N|auto",
        brief="Parts that a light with extent is cut into.",
    ),
    SettingOption("bounces", ("--bounces",), int, "N"),
    SettingOption(
        "branch_cutoff",
        ("--branch-cutoff",),
        float,
        "PART",
        brief="Part of a photon below which reflections are given up.",
    ),
    SettingOption("target_error", ("--target-error",), float, "X"),
    SettingOption("estimator", ("--estimator",), brief="How light is estimated from photons."),
    SettingOption(
        "accumulation_times",
        ("--accumulation-times",),
        int,
        "N",
        brief="Instants of accumulation, and for random times.",
    ),
    SettingOption("tdpm_neighbours", ("--tdpm-neighbours",), int, "N"),
    SettingOption("tdpm_between", ("--tdpm-between",), int, "N"),
    SettingOption("kernel", ("--kernel",)),
    SettingOption("footprint", ("--footprint",), brief="True time average, or Eq. 7 of the paper."),
    SettingOption("emission", ("--emission",)),
    SettingOption("anchor", ("--anchor",)),
    SettingOption("trace_at", ("--trace-at",)),
    SettingOption("path", ("--path",)),
    SettingOption("smoothing", ("--smoothing",), float, "CELLS"),
    SettingOption("time_filter", ("--time-filter",)),
    SettingOption("seed", ("--seed",), int, "N"),
)
MACHINE = (
    SettingOption("device", ("--device",), metavar="NAME"),
    SettingOption("threads", ("--threads",), int, "N"),
)


def declare_settings(group: argparse._ActionsContainer, options: Iterable[SettingOption]) -> None:
    """Adds options of settings to a parser or a group of one; only those given appear in :func:`settings_given`."""
    for option in options:
        metavar = option.metavar
        if option.field in CHOICES:
            metavar = "|".join(CHOICES[option.field])
        group.add_argument(
            *option.flags,
            dest=option.field,
            type=option.kind,
            # Lists given more than once add up.
            action="extend" if option.kind is names else "store",
            nargs=len(metavar) if isinstance(metavar, tuple) else None if option.alone is None else "?",
            const=option.alone,
            metavar=metavar,
            default=argparse.SUPPRESS,
            help=_help(option).replace("%", "%%"),
        )


def settings_given(options: argparse.Namespace) -> dict[str, Any]:
    """The settings that a command line changes, for ``**settings``."""
    names_of = (*(field.name for field in fields(Settings)), "preset")
    given = {name: getattr(options, name) for name in names_of if hasattr(options, name)}
    return {name: tuple(value) if isinstance(value, list) else value for name, value in given.items()}


class _JoinedFrames(argparse.Action):
    """Frames given more than once add up."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        before = getattr(namespace, self.dest, None)
        setattr(namespace, self.dest, f"{before},{values}" if before else values)


def declare_frames(parser: argparse.ArgumentParser) -> None:
    """Adds ``--frames`` and ``--default-time``."""
    which = parser.add_mutually_exclusive_group()
    which.add_argument(
        "-f",
        "--frames",
        action=_JoinedFrames,
        metavar="SPEC",
        help="Frames, for instance 1:24,30:40x2 (first:lastxstride); by default all of the stage.",
    )
    which.add_argument(
        "-d",
        "--default-time",
        "--defaultTime",
        dest="default_time",
        action="store_true",
        help="The default time (values that are not time samples) in place of frames.",
    )


def declare_tracing(parser: argparse.ArgumentParser, picture: Iterable[SettingOption]) -> None:
    """Adds the options of settings, in groups.

    Args:
        parser: A sub-command's parser.
        picture: Those of ``PICTURE`` that concern the sub-command.
    """
    declare_settings(parser.add_argument_group("stage and image"), picture)
    light = parser.add_argument_group("time and light")
    declare_settings(light.add_mutually_exclusive_group(), EXPOSURE)
    light.add_argument(
        "--preset",
        metavar="|".join(PRESETS),
        default=argparse.SUPPRESS,
        help="Settings from fast to exact, or the paper's; options given beside it beat it.",
    )
    declare_settings(light, METHOD)
    declare_settings(parser.add_argument_group("machine"), MACHINE)


def declare_resume(parser: argparse.ArgumentParser) -> None:
    """Adds ``--skip-existing-frames``."""
    parser.add_argument(
        "--skip-existing-frames",
        dest="skip_existing",
        action="store_true",
        help="Leave what is there, whole and up to date: goes on where a run was stopped.",
    )
    parser.set_defaults(resumable=" (the same command with --skip-existing-frames goes on)")


def declare_reports(parser: argparse.ArgumentParser) -> None:
    """Adds ``--stats``, ``--progress`` and ``--log-level``."""
    parser.add_argument(
        "--stats",
        metavar="FILE.json",
        help="Also write seconds and energies of every frame; .jsonl: a line as each ends.",
    )
    parser.add_argument(
        "--progress",
        metavar="|".join(KINDS),
        default="auto",
        help="How progress is shown; auto is a bar on a terminal, else a line a frame. [auto]",
    )
    parser.add_argument(
        "--log-level",
        choices=LOG_LEVELS,
        metavar="LEVEL",
        default="warning",
        help=f"{', '.join(LOG_LEVELS)}. [warning]",
    )


def declare_persistence(parser: argparse.ArgumentParser) -> None:
    """Adds the options that say how much a sequence puts up with; :func:`persistence_given` has their values."""
    group = parser.add_argument_group("what goes wrong")
    group.add_argument("--strict", action="store_true", help="Layers that are missing or damaged are errors.")
    group.add_argument("--frame-timeout", type=float, metavar="S", help="Seconds a frame may take. [no limit]")
    group.add_argument("--retries", type=int, default=0, metavar="N", help="Further tries of a frame that failed. [0]")
    group.add_argument(
        "--max-failures",
        type=int,
        metavar="N",
        help="Stop after so many frames in a row. [3 on a full disk]",
    )


def persistence_given(options: argparse.Namespace) -> dict[str, Any]:
    """The values of :func:`declare_persistence`, by their names in Python."""
    return {name: getattr(options, name) for name in ("strict", "frame_timeout", "retries", "max_failures")}


def sequence_given(options: argparse.Namespace) -> dict[str, Any]:
    """What all commands that work through frames are given, by its names in Python."""
    plain = ("frames", "default_time", "stats", "skip_existing", "max_memory")
    return {**{name: getattr(options, name) for name in plain}, **persistence_given(options), **settings_given(options)}


def declare_memory(parser: argparse.ArgumentParser) -> None:
    """Adds ``--max-memory``."""
    parser.add_argument(
        "--max-memory",
        type=size,
        metavar="SIZE",
        help="Memory that may be taken, as in 12G; frames that need more are refused. [three quarters of the machine]",
    )


def size(text: str) -> float:
    """Bytes of a size such as ``12G`` or ``512M`` (powers of 1024)."""
    found = re.fullmatch(r"([0-9]+(?:\.[0-9]*)?) *([kKMGT]?)i?B?", text.strip())
    if found is None or not float(found[1]) > 0:
        raise argparse.ArgumentTypeError(f"{text!r} is no size (write for instance 12G)")
    return float(found[1]) * 1024.0 ** ("kMGT".index(found[2].replace("K", "k")) + 1 if found[2] else 0)


def _help(option: SettingOption) -> str:
    # What follows is for who reads the documentation: help is to fit two screens.
    documented = _documentation().get(option.field, "").replace("``", "")
    text = option.brief or re.split("; |: |, which |, whose ", documented)[0]
    text = re.sub(r"\b(?:None|empty) (?:takes|for)\b", "by default", text)
    default = next(field.default for field in fields(Settings) if field.name == option.field)
    if default not in (None, "", ()):
        default = ",".join(default) if isinstance(default, tuple) else default
        option_default = f"[{default}]"
    else:
        option_default = ""
    also = f"({option.also})" if option.also else ""
    return " ".join(part for part in (text, also, option_default) if part)


@cache
def _documentation() -> dict[str, str]:
    """What the docstrings of the groups of :class:`Settings` say of each field."""
    found: dict[str, str] = {}
    for group in Settings.__mro__:
        section = (group.__doc__ or "").partition("Attributes:")[2]
        entries = re.findall(r"^\s+(\w+): (.*(?:\n(?!\s+\w+: ).*\S.*)*)", section, re.MULTILINE)
        found |= {name: " ".join(text.split()) for name, text in entries}
    return found
