#!/usr/bin/env python3
"""Fig. 6: the wave with 1 000 photons at exposures of 0 to 4 frames: footprints stretch into tails.

    .venv/bin/python scripts/figures/fig6_exposures.py
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from renders import shipped, shot

from tpdwarp.presets import PRESETS
from usd_scenes.drawing.sheets import Figure, Tile, grey, publish

PHOTONS = 1000
WIDTH = 224
EXPOSURES = (0, 1, 2, 3, 4)
BLACK, WHITE = 0.0, 0.7
# Half the footprint, so that single photons can be told apart.
SMOOTHING = 0.5


def make() -> Figure:
    """Renders the figure."""
    scene = shipped("wave")
    rows = []
    for name, settings in (
        ("as in the paper", {**PRESETS["paper"], "smoothing": SMOOTHING}),
        ("defaults", {"motion": "cubic"}),
    ):
        tiles = []
        for exposure in EXPOSURES:
            made = shot(scene, WIDTH, photons=PHOTONS, exposure=float(exposure), **settings)
            tiles.append(Tile(grey(made.light, BLACK, WHITE), (f"exposure {exposure}, {name}",)))
        rows.append(tiles)
    text = f"""Wave, {PHOTONS:,} photons sent, frame 12, exposures of {", ".join(map(str, EXPOSURES))} frames; the wave
moves to the right by λ/8 a frame. Seen from above; grey runs evenly from radiance {BLACK:g} to {WHITE:g}.

Top: `--preset paper` with `--smoothing {SMOOTHING}`, so that single footprints are seen. Without exposure they are
dots; with it each draws a tail along the path that its time differential predicts, the longer the longer the exposure.
Where light is focused the tails go with the wave, where it is spread they go against it, and in between they are short.
Each photon keeps its flux, so that tails are dimmer than dots. Bottom: the defaults (regular lattice, B-spline,
traced at mid shutter) with `--motion cubic`: the same number of photons without noise."""
    return Figure(6, "exposures of 0 to 4 frames", rows, text.replace(f"{PHOTONS:,}", "1 000"))


if __name__ == "__main__":
    print(publish(make()))
