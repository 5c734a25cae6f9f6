#!/usr/bin/env python3
"""Makes docs/caustics.png, the README's picture: the sea bottom and the mirror ring, side by side.

    .venv/bin/python scripts/figures/caustics.py
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import tpdwarp
from tpdwarp.io.images import read_image, write_frame

ROOT = Path(__file__).resolve().parents[2]


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        # A finer sea than the shipped one, whose mesh shows in the caustic.
        make = [sys.executable, ROOT / "scripts" / "make_scenes.py", "--out", folder, "sea", "--resolution", "201"]
        subprocess.run(make, check=True)
        panels = []
        for name, scene, frame, settings in (
            ("sea", f"{folder}/sea.usdc", 3, {"photons": 262144, "segments": 2}),
            ("ring", ROOT / "usd_scenes" / "mirror.usdc", 10, {"photons": 131072}),
        ):
            out = f"{folder}/{name}.exr"
            result = tpdwarp.render(scene, out, frames=str(frame), image_width=512, samples=16, **settings)
            assert result.ok
            panels.append(read_image(out)[0])
        joined = {name: np.hstack([panel[name] for panel in panels]) for name in "RGBA"}
        write_frame(ROOT / "docs" / "caustics.png", joined, {})


if __name__ == "__main__":
    main()
