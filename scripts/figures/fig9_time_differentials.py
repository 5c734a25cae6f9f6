#!/usr/bin/env python3
"""Fig. 9: projected time differentials of the cylinder, from the curves of a debug layer, over the frame.

    .venv/bin/python scripts/figures/fig9_time_differentials.py
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from renders import FRAME, MEASURING_CAMERA, shipped, shot

from tpdwarp.io.images import encode_srgb
from tpdwarp.jobs.opening import open_scene
from tpdwarp.settings import Settings
from tpdwarp.usd.read.debug_layer import DebugLayerReader
from usd_scenes.drawing.lines import draw_lines, project
from usd_scenes.drawing.sheets import Figure, Tile, grey, publish

WIDTH = 448
EXPOSURE = 1.0
PHOTONS = 14000
CURVES = 500
BLACK, WHITE = -0.05, 1.5


def make() -> Figure:
    """Renders the figure and measures lengths of lines by distance from the axis of rotation."""
    scene = shipped("cylinder")
    with tempfile.TemporaryDirectory() as folder:
        layer = Path(folder) / "cylinder.debug.usdc"
        made = shot(scene, WIDTH, photons=PHOTONS, exposure=EXPOSURE, debug_layer=layer, curves=CURVES)
        ends, colors = DebugLayerReader(layer).time_differentials(FRAME)
    settings = Settings.of(camera=MEASURING_CAMERA, image_width=WIDTH, exposure=EXPOSURE)
    source = open_scene(scene, settings, False)
    camera = source.at(source.shutter(FRAME, settings)).camera
    picture = grey(made.light, BLACK, WHITE)
    display = np.rint(255 * encode_srgb(colors[None])[0]).astype(np.float64)
    drawn = draw_lines(picture, project(ends, camera, picture.shape[:2]), display)
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    radii = np.linalg.norm(ends.mean(axis=1)[:, :2], axis=1)
    height = len(drawn)
    middle = drawn[height // 5 : height - height // 5]
    rows = [
        f"| {low:g} … {low + 0.5:g} | {np.count_nonzero(within)} | {np.median(lengths[within]):.3f} "
        f"| {np.radians(5.0) * EXPOSURE * np.median(radii[within]):.3f} |"
        for low in (0.0, 0.5, 1.0, 1.5)
        if (within := (radii >= low) & (radii < low + 0.5)).any()
    ]
    text = f"""Cylinder that turns 5° a frame about its left end, frame {FRAME}, exposure {EXPOSURE:g} frame, seen from
above: `/TPD/TimeDifferentials` of the debug layer ({len(ends)} curves of {made.landed} photons landed), projected with
the top camera over the frame. A line runs from a footprint's centre at shutter open to that at shutter close, coloured
by speed; lines lie along the circles about the left end and grow toward the fast end in proportion to the distance.

| distance from the axis of rotation | curves | median length | angle × median distance |
|---|---|---|---|
{chr(10).join(rows)}
"""
    caption = (f"curves of the debug layer: {len(ends)} of {made.landed} photons", f"exposure {EXPOSURE:g} frame, 5°")
    return Figure(9, "projected time differentials of the cylinder", [[Tile(middle, caption)]], text)


if __name__ == "__main__":
    print(publish(make()))
