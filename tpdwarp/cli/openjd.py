"""``tpdwarp openjd``: a template for render farms that speak Open Job Description."""

from __future__ import annotations

import argparse

from tpdwarp.cli.options import (
    PICTURE,
    declare_frames,
    declare_persistence,
    declare_tracing,
    persistence_given,
    settings_given,
)
from tpdwarp.cli.outcome import DONE
from tpdwarp.cli.report import warnings_shown
from tpdwarp.jobs.progress import Progress

SUMMARY = "write an Open Job Description template that renders a stage"
EPILOG = (
    "Check it with openjd check TEMPLATE, and run it here with openjd run TEMPLATE.\n"
    "Exit code: 0 done, 2 wrong usage or unusable input, 130 or 143 interrupted."
)


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the sub-command's arguments."""
    parser.usage = "tpdwarp openjd SCENE OUT TEMPLATE [options]"
    parser.add_argument("scene", metavar="SCENE", help="USD stage.")
    parser.add_argument("out", metavar="OUT", help="Image file, with #### where the frame number goes.")
    parser.add_argument("template", metavar="TEMPLATE", help="Template to write: .json.")
    declare_frames(parser)
    parser.add_argument("--chunk", type=int, default=10, metavar="N", help="Frames in one task. [10]")
    declare_persistence(parser)
    declare_tracing(parser, PICTURE)


def run(options: argparse.Namespace) -> int:
    """Writes the template; returns the exit code."""
    with warnings_shown(Progress()):
        # Here and not above, so that --help need not wait for USD to load.
        from tpdwarp.farms.open_job import open_job_template

        open_job_template(
            options.scene,
            options.out,
            options.template,
            frames=options.frames,
            chunk=options.chunk,
            **persistence_given(options),
            **settings_given(options),
        )
    return DONE
