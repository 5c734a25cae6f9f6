"""``tpdwarp bake``: light of photons on receivers to textures."""

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
    names,
    sequence_given,
)
from tpdwarp.cli.report import QUIET, report, warnings_shown
from tpdwarp.jobs.progress import progress_of
from tpdwarp.loading import collector_paused

SUMMARY = "bake light of photons on receivers to textures, over their coordinates"
EPILOG = (
    "OUT is an .exr file with #### where the frame number goes, as in tex/caustic.####.exr; the names of several\n"
    "receivers and the UDIM numbers of several tiles go before it (or a number where OUT has <UDIM>).\n"
    "Beside it appears tex/caustic.light.usda, which shows the light on its receivers in the scene.\n"
    "Exit code: 0 done, 1 a frame failed, 2 wrong usage or unusable input, 130 or 143 interrupted."
)
_PICTURE_ONLY = (
    "camera",
    "image_width",
    "resolution",
    "crop",
    "samples",
    "aovs",
    "exr_type",
    "view",
    "view_exposure",
    "refracted_radiance",
)


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the sub-command's arguments."""
    parser.usage = "tpdwarp bake SCENE OUT [options]"
    parser.add_argument("scene", metavar="SCENE", help="USD stage; it needs no camera.")
    parser.add_argument("out", metavar="OUT", help="Texture files: .exr.")
    parser.add_argument(
        "--receiver",
        type=names,
        action="extend",
        metavar="PATH,...",
        help="Meshes that receive, or prims above them. [those that photons land on in the first frame]",
    )
    parser.add_argument("--uv", default="st", metavar="NAME", help="Primvar of texture coordinates. [st]")
    # Its name would be taken for that of the pictures' resolution.
    parser.add_argument(
        "--resolution", dest="texels", type=int, default=1024, metavar="N", help="Texels along a side. [1024]"
    )
    parser.add_argument(
        "--what",
        default="irradiance",
        metavar="irradiance|caustic|motion",
        help="Irradiance in W/m2, the radiance that it makes (albedo/pi times it), or mean D_t x. [irradiance]",
    )
    parser.add_argument("--gutter", type=int, default=8, metavar="N", help="Texels filled around charts. [8]")
    declare_frames(parser)
    declare_resume(parser)
    declare_reports(parser)
    declare_persistence(parser)
    declare_memory(parser)
    declare_tracing(parser, [option for option in PICTURE if option.field not in _PICTURE_ONLY])


def run(options: argparse.Namespace) -> int:
    """Bakes; returns the exit code."""
    shown = progress_of(options.progress)
    with warnings_shown(shown, options.log_level) as warnings:
        # Here and not above, so that --help need not wait for the renderer to load.
        with collector_paused():
            from tpdwarp.jobs.bake import bake

        result = bake(
            options.scene,
            options.out,
            receiver=options.receiver,
            uv=options.uv,
            resolution=options.texels,
            what=options.what,
            gutter=options.gutter,
            progress=shown,
            **sequence_given(options),
        )
    return report(result, quiet=options.progress in QUIET, warnings=warnings)
