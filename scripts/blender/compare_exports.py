#!/usr/bin/env python3
"""How light here compares with Cycles' in the scenes that ``scripts/blender/exports.py`` has exported and rendered.

    .venv/bin/python scripts/blender/compare_exports.py FOLDER

For each scene: direct light where neither render has glass in view, and the light of photons on the floor, as parts of
Cycles'.
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
        plain, theirs = (rgb(read_image(stage.parent / f"{name}.exr")[0]) for name in ("plain", "caustics"))
        # Blender's lamps are white at 6500 K, USD's are not quite.
        stage.write_text(
            stage.read_text().replace("inputs:enableColorTemperature = 1", "inputs:enableColorTemperature = 0")
        )
        height, width = plain.shape[:2]
        frame = tpdwarp.render_frame(
            stage, 1, resolution=(width, height), photons=options.photons, samples=16, threads=options.threads,
            aovs=["caustic", "direct", "id"], refracted_radiance="unscaled",
        )  # fmt: skip
        caustic, direct = (
            np.stack([frame.channels[f"{name}.{channel}"] for channel in "RGB"], axis=-1)
            for name in ("caustic", "direct")
        )
        # The floor is the object in the corner. Where glass is seen both renders differ by what they see in it.
        floor = frame.channels["id"] == frame.channels["id"][0, 0]
        print(
            f"{stage.parent.name}: direct light {direct[floor].sum() / plain[floor].sum():.4f} of Cycles', light of "
            f"photons {caustic[floor].sum() / (theirs - plain)[floor].sum():.3f}, the whole picture "
            f"{(direct + caustic).sum() / theirs.sum():.3f}",
            flush=True,
        )


def rgb(channels: dict[str, np.ndarray]) -> np.ndarray:
    """Red, green and blue, shape [h, w, 3]."""
    return np.stack([channels[name] for name in "RGB"], axis=-1).astype(np.float64)


if __name__ == "__main__":
    main()
