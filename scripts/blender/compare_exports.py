#!/usr/bin/env python3
"""How light here compares with Cycles' in the scenes that ``scripts/blender/exports.py`` has exported and rendered.

    .venv/bin/python scripts/blender/compare_exports.py FOLDER

For each scene: direct light on the floor, and the light of photons there, as parts of Cycles', with the standard error
that the scatter of Cycles' renders leaves in the latter.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import tpdwarp
from tpdwarp.io.images import read_image


def main() -> None:
    """Renders the scenes and prints a line for each."""
    parser = argparse.ArgumentParser(description="Compares exports with Cycles' renders of them.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--photons", type=int, default=65536)
    parser.add_argument("--threads", type=int, default=0)
    options = parser.parse_args()
    for stage in sorted(options.folder.glob("*/scene.usda")):
        plain, *renders = (
            rgb(read_image(file)[0])
            for file in (stage.parent / "plain.exr", *sorted(stage.parent.glob("caustics_*.exr")))
        )
        theirs = np.mean(renders, axis=0)
        height, width = plain.shape[:2]
        frame = tpdwarp.render_frame(
            stage, 1, resolution=(width, height), photons=options.photons, samples=16, threads=options.threads,
            aovs=["caustic", "direct"],
        )  # fmt: skip
        caustic, direct = (
            np.stack([frame.channels[f"{name}.{channel}"] for channel in "RGB"], axis=-1)
            for name in ("caustic", "direct")
        )
        # The camera sees the floor alone.
        part = caustic.sum() / (theirs - plain).sum()
        scatter = part * np.std([render.sum() for render in renders], ddof=1) / (theirs - plain).sum()
        print(
            f"{stage.parent.name}: direct light {direct.sum() / plain.sum():.4f} of Cycles', light of photons "
            f"{part:.3f} ± {scatter / len(renders) ** 0.5:.3f}, both {(direct + caustic).sum() / theirs.sum():.4f}",
            flush=True,
        )


def rgb(channels: dict[str, np.ndarray]) -> np.ndarray:
    """Red, green and blue, shape [h, w, 3]."""
    return np.stack([channels[name] for name in "RGB"], axis=-1).astype(np.float64)


if __name__ == "__main__":
    main()
