#!/usr/bin/env python3
"""The caustics pass over a render by Cycles, beside Cycles' own caustics: docs/caustics_pass.jpg.

    .venv/bin/python scripts/blender/side_by_side.py FOLDER docs/caustics_pass.jpg

FOLDER is what ``scripts/blender/caustics_pass.py`` has filled.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

import tpdwarp
from tpdwarp.io.images import encode_srgb, read_image

# Brightness of the picture, and the gap between its parts in pixels.
GAIN, GAP = 1.6, 4


def main() -> None:
    """Renders the pass, prints how it compares, and writes the picture."""
    parser = argparse.ArgumentParser(description="Adds the caustics pass to a render by Cycles.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("picture", type=Path)
    options = parser.parse_args()
    plain, theirs = (rgb(read_image(options.folder / f"{name}.exr")[0]) for name in ("plain", "caustics"))
    stage = options.folder / "scene.usda"
    # Blender's lamps are white at 6500 K, USD's are not quite.
    tinted = "inputs:enableColorTemperature = "
    stage.write_text(stage.read_text().replace(f"{tinted}1", f"{tinted}0"))
    height, width = plain.shape[:2]
    frame = tpdwarp.render_frame(
        stage, 0, resolution=(width, height), photons=131072, samples=16, aovs=["caustic", "id"],
        refracted_radiance="unscaled",
    )  # fmt: skip
    ours = np.stack([frame.channels[f"caustic.{c}"] for c in "RGB"], axis=-1)
    # The floor is the object of the lower edge.
    floor = frame.channels["id"] == frame.channels["id"][-1, width // 2]
    print(f"light of photons on the floor: {ours[floor].sum() / (theirs - plain)[floor].sum():.3f} of Cycles'")
    print(f"whole picture: {(plain + ours).sum() / theirs.sum():.3f} of Cycles'")
    gap = np.ones((height, GAP, 3))
    parts = [encode_srgb(np.clip(GAIN * part, 0, 1).astype(np.float32)) for part in (plain, plain + ours, theirs)]
    pixels = np.concatenate([parts[0], gap, parts[1], gap, parts[2]], axis=1)
    output = oiio.ImageOutput.create(str(options.picture))
    spec = oiio.ImageSpec(pixels.shape[1], height, 3, "uint8")
    spec.attribute("compression", "jpeg:92")
    output.open(str(options.picture), spec)
    output.write_image((np.clip(pixels, 0, 1) * 255 + 0.5).astype(np.uint8))
    output.close()


def rgb(channels: dict[str, np.ndarray]) -> np.ndarray:
    """Red, green and blue, shape [h, w, 3]."""
    return np.stack([channels[name] for name in "RGB"], axis=-1)


if __name__ == "__main__":
    main()
