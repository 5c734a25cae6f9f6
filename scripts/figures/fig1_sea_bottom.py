#!/usr/bin/env python3
"""Fig. 1: the sea bottom under waves that interfere, by temporal differentials beside time dependent photon mapping.

    .venv/bin/python scripts/figures/fig1_sea_bottom.py
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from renders import finer_sea, shot, truth

from usd_scenes.drawing.sheets import Figure, Tile, grey, publish

WIDTH = 256
EXPOSURE = 1.0
PHOTONS = 16384
NEIGHBOURS = 50
BLACK, WHITE = 0.0, 0.8


def make() -> Figure:
    """Renders the figure."""
    with tempfile.TemporaryDirectory() as folder:
        scene = finer_sea(Path(folder))
        exact = truth(scene, WIDTH, EXPOSURE, times=24, samples=2)
        common = {"photons": PHOTONS, "exposure": EXPOSURE, "motion": "cubic"}
        nearest = {**common, "estimator": "tdpm", "emission": "jittered", "tdpm_neighbours": NEIGHBOURS, "samples": 1}
        shots = [
            (name, shot(scene, WIDTH, **settings))
            for name, settings in (
                ("tpd, one trace", common),
                ("tpd, --segments 2", {**common, "segments": 2}),
                (f"tdpm, k {NEIGHBOURS}, B = 0", {**nearest, "tdpm_between": 0}),
                (f"tdpm, k {NEIGHBOURS}, B = 10", {**nearest, "tdpm_between": 10}),
            )
        ]
    tiles = [
        Tile(grey(made.light, BLACK, WHITE), (f"{name}", f"{made.landed} photons, RMSE {made.rmse(exact):.4f}"))
        for name, made in shots
    ]
    tiles.append(Tile(grey(exact.light, BLACK, WHITE), ("accumulation, 24 instants",)))
    numbers = "\n".join(f"| {name} | {made.landed} | {made.rmse(exact):.4f} |" for name, made in shots)
    text = f"""Bottom of a shallow sea under three waves that cross, frame 12, exposure {EXPOSURE:g} frame, in which the
longest wave moves λ/8; {PHOTONS} photons, seen from above. Grey runs evenly from radiance {BLACK:g} to {WHITE:g}.

Temporal photon differentials keep the net of light and smear it along its motion. Time dependent photon mapping with as
many photons blurs the net, and without in-between frames (B = 0) it shows the net of shutter open, not smeared at all.

| method | photons landed | RMSE |
|---|---|---|
{numbers}
"""
    return Figure(1, "the sea bottom", [tiles], text)


if __name__ == "__main__":
    print(publish(make()))
