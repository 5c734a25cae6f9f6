#!/usr/bin/env python3
"""Fig. 7: the wave by temporal photon differentials, and by time dependent photon mapping with in-between frames.

    .venv/bin/python scripts/figures/fig7_between.py
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from renders import Shot, folding_wave, shipped, shot, truth

from tpdwarp.presets import PRESETS
from usd_scenes.drawing.sheets import Figure, Tile, grey, publish

WIDTH = 160
PHOTONS = 1000
NEIGHBOURS = {1000: 20, 40000: 100, 480000: 100}
BETWEEN = (0, 2, 10)
SHOWN = {"b": (1000, 0), "c": (1000, 10), "d": (480000, 0), "e": (480000, 2), "f": (40000, 2), "g": (40000, 10)}
# Name, exposure in frames, and the greys; waves of half the length fold, so that their light is drawn in sharp lines.
SCENES = (("wave", 1.0, 0.1, 0.6), ("folds", 3.0, 0.1, 0.7))


TEXT = """Frame 12, seen from above. a) temporal photon differentials, 1 000 photons, one trace (regular lattice,
B-spline, mid shutter, `--motion cubic`). b–g) time dependent photon mapping with B in-between frames, whose photons
share one budget; k = 20 (1 000 photons) and 100 (others), not tuned. Top: the wave, exposure 1 frame, in which it moves
λ/8. Bottom: the wave with folds (λ = 0.65, λ/8 a frame), exposure 3 frames. Grey runs evenly from radiance 0.1 to 0.6
(top) and to 0.7 (bottom).

RMSE of radiance against an accumulation of 32 instants of 65 536 photons, whose mean is about 0.27:

"""
REMARKS = """
With one trace of 1 000 photons (a) the light is smooth and lies where it belongs. Photon mapping without in-between
frames (b, d) shows the wave as it stood when the shutter opened, and more photons only draw the wrong picture sharper.
Two in-between frames leave three bands side by side, plain to see in the folds (e, bottom); ten nearly close them. On
the wave none of these comes near the single trace. The folds move by 3/8 λ at the bottom, more than one trace can
follow well: there 40 000 photons in ten in-between frames come a little nearer, and segments are what helps.
The last lines are the paper's method to the letter, whose random emission leaves noise that the lattice has not."""


def make() -> Figure:
    """Renders the figure and measures all nine combinations of photons and in-between frames."""
    rows, tables = [], []
    with tempfile.TemporaryDirectory() as folder:
        scenes = {"wave": shipped("wave"), "folds": folding_wave(Path(folder))}
        for name, exposure, black, white in SCENES:
            tiles, table = _measured(name, scenes[name], exposure, black, white)
            rows.append(tiles)
            tables.append(table)
    return Figure(7, "the wave beside time dependent photon mapping", rows, TEXT + "\n".join(tables) + REMARKS)


def _measured(name: str, scene: Path, exposure: float, black: float, white: float) -> tuple[list[Tile], str]:
    exact = truth(scene, WIDTH, exposure, samples=2)
    temporal = shot(scene, WIDTH, photons=PHOTONS, exposure=exposure, motion="cubic")
    segmented = shot(scene, WIDTH, photons=64 * PHOTONS, exposure=exposure, motion="cubic", segments=8)
    paper = shot(scene, WIDTH, photons=PHOTONS, exposure=exposure, **PRESETS["paper"])
    found = {
        (photons, between): shot(
            scene,
            WIDTH,
            photons=photons,
            exposure=exposure,
            motion="cubic",
            estimator="tdpm",
            emission="jittered",
            tdpm_neighbours=neighbours,
            tdpm_between=between,
            samples=1,
        )
        for photons, neighbours in NEIGHBOURS.items()
        for between in BETWEEN
    }
    shown = {"a": ("tpd, 1 000", temporal)}
    for letter, (photons, between) in SHOWN.items():
        shown[letter] = (f"tdpm, {_thousands(photons)}, B {between}", found[photons, between])
    tiles = [
        Tile(grey(made.light, black, white), (f"{letter}) {method}", f"e {exposure:g}, RMSE {made.rmse(exact):.4f}"))
        for letter, (method, made) in shown.items()
    ]
    tiles.append(Tile(grey(exact.light, black, white), (f"accumulation, {name}", f"e {exposure:g}")))
    return tiles, _table(f"{name}, exposure {exposure:g}", exact, temporal, segmented, paper, found)


def _table(
    title: str, exact: Shot, temporal: Shot, segmented: Shot, paper: Shot, found: dict[tuple[int, int], Shot]
) -> str:
    lines = [f"| {title} | B = 0 | B = 2 | B = 10 |", "|---|---|---|---|"]
    for photons in NEIGHBOURS:
        errors = " | ".join(f"{found[photons, between].rmse(exact):.4f}" for between in BETWEEN)
        lines.append(f"| tdpm, {_thousands(photons)} photons | {errors} |")
    lines.append(f"| tpd, {_thousands(PHOTONS)} photons | {temporal.rmse(exact):.4f} | | |")
    lines.append(f"| tpd, {_thousands(64 * PHOTONS)} photons, `--segments 8` | {segmented.rmse(exact):.4f} | | |")
    lines.append(f"| tpd, `--preset paper` | {paper.rmse(exact):.4f} | | |")
    return "\n".join([*lines, ""])


def _thousands(count: int) -> str:
    return f"{count:,}".replace(",", " ")


if __name__ == "__main__":
    print(publish(make()))
