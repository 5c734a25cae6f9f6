#!/usr/bin/env python3
"""Makes the scenes in usd_scenes/. Without arguments, exactly those that are in the repository.

    scripts/make_scenes.py                                all of them
    scripts/make_scenes.py wave --wavelength 0.65 --out out/scenes
"""

from __future__ import annotations

import argparse
import inspect
import math
import sys
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from tpdwarp.device import Launcher
from tpdwarp.errors import FrameError, InputError
from usd_scenes.authoring.cylinder import write_cylinder
from usd_scenes.authoring.mirror import write_mirror
from usd_scenes.authoring.sea import write_sea
from usd_scenes.authoring.table import write_table
from usd_scenes.authoring.tumbler import write_tumbler
from usd_scenes.authoring.wave import write_wave

SCENES: dict[str, Callable[..., None]] = {
    "wave": write_wave,
    "cylinder": write_cylinder,
    "mirror": write_mirror,
    "sea": write_sea,
    "tumbler": write_tumbler,
    "table": write_table,
}
SHIPPED = Path(__file__).resolve().parent.parent / "usd_scenes"
HELP = {
    "amplitude": "height of the (longest) wave, scene units",
    "wavelength": "of the (longest) wave, scene units",
    "radius": "scene units",
    "speed": "scene units a frame (waves) or degrees a frame (solids)",
    "frames": "how many, from 1",
    "resolution": "vertices along x, or round the axis",
}
SMALLEST = {"frames": 1, "resolution": 3}


def main(arguments: list[str] | None = None) -> int:
    """Runs the command line; returns the exit code (2: an option has no usable value)."""
    Launcher()  # starts Warp without its warning where there is no GPU
    parser = argparse.ArgumentParser(description="Makes the scenes in usd_scenes/.")
    parser.add_argument("--out", type=Path, default=SHIPPED, metavar="FOLDER", help="where to (default: usd_scenes)")
    kinds = parser.add_subparsers(dest="scene", metavar="SCENE", help=f"only one: {', '.join(SCENES)}")
    for name, write in SCENES.items():
        summary = (inspect.getdoc(write) or "").splitlines()[0]
        _add_options(kinds.add_parser(name, help=summary, description=summary), write)
    options = vars(parser.parse_args(arguments))
    chosen, folder = options.pop("scene"), options.pop("out")
    try:
        for name in [chosen] if chosen else SCENES:
            path = folder / f"{name}.usdc"
            _refuse_unusable(options)
            SCENES[name](path, **options)
            print(path)
    except (ValueError, InputError, FrameError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


def _add_options(parser: argparse.ArgumentParser, write: Callable[..., None]) -> None:
    parser.add_argument("--out", type=Path, default=argparse.SUPPRESS, metavar="FOLDER", help="where to")
    for name, parameter in inspect.signature(write).parameters.items():
        if name != "path":
            default = parameter.default
            parser.add_argument(
                f"--{name}", type=type(default), default=default, help=f"{HELP[name]} (default {default:g})"
            )


def _refuse_unusable(options: dict[str, float]) -> None:
    for name, value in options.items():
        if not math.isfinite(value) or value < SMALLEST.get(name, -math.inf) or (name == "wavelength" and value <= 0):
            raise ValueError(f"--{name} cannot be {value}")


if __name__ == "__main__":
    sys.exit(main())
