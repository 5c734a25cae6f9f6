#!/usr/bin/env python3
"""Converts EXR frames to PNG (sRGB, 8 bits), next to them: scripts/to_png.py out/wave.????.exr"""

from __future__ import annotations

import sys
from pathlib import Path

from tpdwarp.errors import FrameError, InputError
from tpdwarp.io.images import read_image, write_frame


def main(paths: list[str]) -> int:
    """Converts ``paths``; returns the exit code (1: a frame could not be written, 2: an input could not be read)."""
    if not paths:
        print("usage: to_png.py FRAME.exr ...", file=sys.stderr)
        return 2
    try:
        for path in map(Path, paths):
            channels, _ = read_image(path)
            write_frame(path.with_suffix(".png"), {name: channels[name] for name in "RGBA" if name in channels}, {})
    except (InputError, FrameError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2 if isinstance(error, InputError) else 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
