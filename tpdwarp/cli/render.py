"""``tpdwarp render``: frames of a stage to image files."""

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

SUMMARY = "render frames of a USD stage to image files"
EPILOG = (
    "OUT holds #### where the frame number goes (zero-padded; ###.## for fractions), as in out/wave.####.exr.\n"
    "Exit code: 0 done, 1 a frame failed, 2 wrong usage or unusable input, 130 or 143 interrupted."
)


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the sub-command's arguments."""
    parser.usage = "tpdwarp render SCENE OUT [options]"
    parser.add_argument("scene", metavar="SCENE", help="USD stage.")
    parser.add_argument("out", metavar="OUT", help="Image file: .exr, or .png, .jpg, .tif (beauty only, sRGB).")
    declare_frames(parser)
    declare_resume(parser)
    parser.add_argument("--debug-layer", metavar="LAYER", help="Also write the photons to this USD layer.")
    parser.add_argument("--curves", type=int, metavar="N", help="At most so many photons a frame in it. [all]")
    declare_reports(parser)
    declare_memory(parser)
    declare_persistence(parser)
    declare_tracing(parser, PICTURE)


def run(options: argparse.Namespace) -> int:
    """Renders; returns the exit code."""
    shown = progress_of(options.progress)
    with warnings_shown(shown, options.log_level) as warnings:
        # Here and not above, so that --help need not wait for the renderer to load.
        with collector_paused():
            from tpdwarp.jobs.sequence import render

        result = render(
            options.scene,
            options.out,
            progress=shown,
            debug_layer=options.debug_layer,
            curves=options.curves,
            **sequence_given(options),
        )
    return report(result, quiet=options.progress in QUIET, warnings=warnings)
