"""``tpdwarp study``: error against time over methods and settings."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from typing import Any

from tpdwarp.cli.options import MACHINE, METHOD, PICTURE, count_or_auto, declare_settings, names, settings_given
from tpdwarp.cli.outcome import DONE, FAILED
from tpdwarp.cli.report import warnings_shown
from tpdwarp.io.terminal import say

SUMMARY = "measure error against time over methods and settings"
EPILOG = (
    "Everything rendered is kept, so that a study that was cut short goes on where it stopped.\n"
    "Exit code: 0 done, 1 a case failed, 2 wrong usage or unusable input, 130 or 143 interrupted."
)
_KINDS = ("auto", "bar", "plain", "none")
# What is measured is the caustic itself, whatever a file would hold.
_PICTURE_ONLY = ("crop", "aovs", "light_groups", "holdout", "exr_type", "view", "view_exposure")
_SWEPT = ("photons", "segments", "kernel", "estimator", "tdpm_neighbours", "tdpm_between")


def _list(kind: Callable[[str], Any]) -> Callable[[str], tuple[Any, ...]]:
    def parse(text: str) -> tuple[Any, ...]:
        return tuple(kind(part) for part in names(text))

    parse.__name__ = "list"
    return parse


def _between(text: str) -> int | None:
    return None if text == "random" else int(text)


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the sub-command's arguments."""
    parser.usage = "tpdwarp study SCENE [options]"
    parser.add_argument("scene", metavar="SCENE", help="USD stage.")
    parser.add_argument(
        "-f", "--frames", metavar="SPEC", help="Frames, as for render; flicker takes two or more. [the middle one]"
    )
    swept = parser.add_argument_group("what is tried, all with all")
    for flag, kind, metavar, text in (
        ("--methods", str, "NAME,...", "Estimators. [tpd,pd,tdpm,distribution,accumulation]"),
        ("--photons", int, "N,...", "Photons a frame; for accumulation an instant. [1024,4096,16384,65536]"),
        ("--segments", count_or_auto, "K,...", "Segments of tpd, or auto. [1,4]"),
        ("--kernel", str, "NAME,...", "Kernels of all but tdpm. [bspline]"),
        ("--exposure", float, "FRAMES,...", "Exposures. [that of the camera]"),
        ("--tdpm-neighbours", int, "N,...", "Photons in an estimate of tdpm. [25,100]"),
        ("--tdpm-between", _between, "N,...", "In-between frames of tdpm, or random for random times. [random]"),
        ("--presets", str, "NAME,...", "Presets tried beside all that."),
    ):
        destination = f"swept_{flag.strip('-').replace('-', '_')}"
        swept.add_argument(flag, dest=destination, type=_list(kind), metavar=metavar, help=text)
    truth = parser.add_argument_group("what it is measured against")
    for flag, text in (
        ("--truth-photons", "Photons of each instant of the accumulation. [262144]"),
        ("--truth-times", "Instants in each of its two halves. [32]"),
        ("--truth-samples", "Camera samples a pixel in each half. [16]"),
    ):
        truth.add_argument(flag, type=int, metavar="N", help=text)
    truth.add_argument("--truth", metavar="FILE", help="EXR frames (####) that are the truth, with caustic channels.")
    truth.add_argument("--save-truth", metavar="FILE", help="Also write the truth to these EXR frames (####).")
    swept.add_argument(
        "--against", action="append", default=[], metavar="FILE", help="EXR frames (####) of another renderer."
    )
    swept.add_argument(
        "--seconds", action="append", default=[], type=float, metavar="S", help="CPU seconds a frame of each of these."
    )
    says = parser.add_argument_group("what it says, and when it stops")
    says.add_argument("--csv", metavar="FILE.csv", help="Also write the measurements as CSV.")
    says.add_argument("--json", metavar="FILE.json", help="Also write everything measured as JSON.")
    says.add_argument("--report", metavar="FILE.html", help="Also write a page with plots, images and maps of errors.")
    says.add_argument("--time-limit", type=float, metavar="SECONDS", help="Begin nothing new after that.")
    says.add_argument("--cache", metavar="FOLDER", help="Where what is rendered is kept. [the user's cache folder]")
    says.add_argument("--progress", metavar="|".join(_KINDS), default="auto", help="How progress is shown. [auto]")
    shown = [option for option in PICTURE if option.field not in _PICTURE_ONLY]
    declare_settings(parser.add_argument_group("stage and image"), shown)
    declare_settings(parser.add_argument_group("time and light"), [o for o in METHOD if o.field not in _SWEPT])
    declare_settings(parser.add_argument_group("machine"), MACHINE)


def run(options: argparse.Namespace) -> int:
    """Studies and prints the table; returns the exit code."""
    # Here and not above, so that --help need not wait for the renderer to load.
    from tpdwarp.studies.cases import Sweep
    from tpdwarp.studies.progress import study_progress_of
    from tpdwarp.studies.run import study
    from tpdwarp.studies.table import table_lines
    from tpdwarp.studies.truth import TruthSettings

    fields = {"kernel": "kernels", "exposure": "exposures", "tdpm_neighbours": "neighbours", "tdpm_between": "between"}
    given = {
        fields.get(name.removeprefix("swept_"), name.removeprefix("swept_")): value
        for name, value in vars(options).items()
        if name.startswith("swept_") and value is not None
    }
    truth = {
        name: getattr(options, f"truth_{name}")
        for name in ("photons", "times", "samples")
        if getattr(options, f"truth_{name}") is not None
    }
    shown = study_progress_of(options.progress)
    with warnings_shown(shown):
        result = study(
            options.scene,
            sweep=Sweep(**given),
            truth=TruthSettings(**truth),
            frames=options.frames,
            cache=options.cache,
            time_limit=options.time_limit,
            progress=shown,
            csv=options.csv,
            json=options.json,
            report=options.report,
            against=options.against,
            seconds=options.seconds,
            truth_file=options.truth,
            save_truth=options.save_truth,
            **settings_given(options),
        )
    say("\n".join(table_lines(result)), sys.stdout)
    return FAILED if result.failed else DONE
