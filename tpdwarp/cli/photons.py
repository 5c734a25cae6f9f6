"""``tpdwarp photons``: photons of a stage to a debug layer."""

from __future__ import annotations

import argparse

from tpdwarp.cli.options import (
    PICTURE,
    declare_frames,
    declare_memory,
    declare_persistence,
    declare_reports,
    declare_resume,
    declare_tracing,
    sequence_given,
)
from tpdwarp.cli.report import QUIET, report, warnings_shown
from tpdwarp.jobs.progress import progress_of
from tpdwarp.loading import collector_paused

SUMMARY = "trace photons and write them to a USD debug layer"
EPILOG = (
    "Beside shot.debug.usdc appears shot.view.usda, which shows the photons in the scene.\n"
    "Exit code: 0 done, 1 a frame failed, 2 wrong usage or unusable input, 130 or 143 interrupted."
)
_PICTURE_ONLY = (
    "image_width",
    "resolution",
    "crop",
    "samples",
    "aovs",
    "light_groups",
    "holdout",
    "exr_type",
    "view",
    "view_exposure",
)


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the sub-command's arguments."""
    parser.usage = "tpdwarp photons SCENE LAYER [options]"
    parser.add_argument("scene", metavar="SCENE", help="USD stage; it needs no camera.")
    parser.add_argument("layer", metavar="LAYER", help="USD layer to write: .usdc, .usd or .usda.")
    declare_frames(parser)
    parser.add_argument("--curves", type=int, metavar="N", help="At most so many photons a frame, spread evenly. [all]")
    declare_resume(parser)
    declare_reports(parser)
    declare_memory(parser)
    declare_persistence(parser)
    declare_tracing(parser, [option for option in PICTURE if option.field not in _PICTURE_ONLY])


def run(options: argparse.Namespace) -> int:
    """Traces; returns the exit code."""
    shown = progress_of(options.progress)
    with warnings_shown(shown, options.log_level) as warnings:
        # Here and not above, so that --help need not wait for the tracer to load.
        with collector_paused():
            from tpdwarp.jobs.sequence import write_photons

        result = write_photons(
            options.scene,
            options.layer,
            progress=shown,
            curves=options.curves,
            **sequence_given(options),
        )
    return report(result, quiet=options.progress in QUIET, warnings=warnings)
