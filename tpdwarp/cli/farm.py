"""``tpdwarp farm``: frames of a stage, rendered by the workers of a Dask cluster."""

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
from tpdwarp.errors import InputError
from tpdwarp.jobs.progress import progress_of
from tpdwarp.loading import collector_paused

SUMMARY = "render frames on a Dask cluster, this machine's own or another"
EPILOG = (
    "Workers see the stage and the output folder under the same paths as this machine. Frames of workers that are\n"
    "lost are rendered by others. Needs pip install 'tpdwarp[farm]'.\n"
    "Exit code: 0 done, 1 a frame failed, 2 wrong usage or unusable input, 130 or 143 interrupted."
)
_TLS = ("tls_ca_file", "tls_cert", "tls_key")


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the sub-command's arguments."""
    parser.usage = "tpdwarp farm SCENE OUT [options]"
    parser.add_argument("scene", metavar="SCENE", help="USD stage.")
    parser.add_argument("out", metavar="OUT", help="Image file, with #### where the frame number goes.")
    declare_frames(parser)
    declare_resume(parser)
    parser.add_argument("--debug-layer", metavar="LAYER", help="Also write the photons to this USD layer.")
    parser.add_argument("--curves", type=int, metavar="N", help="At most so many photons a frame in it. [all]")
    declare_reports(parser)
    cluster = parser.add_argument_group("cluster")
    cluster.add_argument("--scheduler", default="", metavar="URL", help="As tcp://host:8786. [one started here]")
    cluster.add_argument("--workers", type=int, metavar="N", help="Workers started here. [one a core]")
    cluster.add_argument("--chunk", type=int, metavar="N", help="Frames in one task. [1 to 16, by their number]")
    cluster.add_argument(
        "--dashboard",
        default="",
        metavar="HOST:PORT",
        help="Where the dashboard of a scheduler started here listens. [any port, seen from this machine only]",
    )
    cluster.add_argument("--tls-ca-file", metavar="PEM", help="Authorities whose certificates are trusted.")
    cluster.add_argument("--tls-cert", metavar="PEM", help="This machine's certificate.")
    cluster.add_argument("--tls-key", metavar="PEM", help="Its key.")
    declare_memory(parser)
    declare_persistence(parser)
    declare_tracing(parser, PICTURE)


def run(options: argparse.Namespace) -> int:
    """Renders; returns the exit code."""
    tls = tuple(getattr(options, name) for name in _TLS)
    if any(tls) and not all(tls):
        raise InputError("--tls-ca-file, --tls-cert and --tls-key belong together (give all three)")
    shown = progress_of(options.progress)
    with warnings_shown(shown, options.log_level) as warnings:
        # Here and not above, so that --help need not wait for the renderer to load.
        try:
            with collector_paused():
                from tpdwarp.farms.farm import farm
        except ModuleNotFoundError as error:
            if (error.name or "").partition(".")[0] not in ("dask", "distributed"):
                raise
            raise InputError("farm needs Dask (pip install 'tpdwarp[farm]')") from error

        result = farm(
            options.scene,
            options.out,
            scheduler=options.scheduler,
            workers=options.workers,
            chunk=options.chunk,
            dashboard=options.dashboard,
            tls=tls if all(tls) else None,
            progress=shown,
            debug_layer=options.debug_layer,
            curves=options.curves,
            **sequence_given(options),
        )
    return report(result, quiet=options.progress in QUIET, warnings=warnings)
