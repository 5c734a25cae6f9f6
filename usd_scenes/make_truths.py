"""Makes the truths of the scenes of solids anew, one after the other; each takes some minutes of two cores.

python -m usd_scenes.make_truths                   # all of them
python -m usd_scenes.make_truths ball-gliding      # one
"""

from __future__ import annotations

import argparse
import sys

from .brute_force import irradiance
from .kept_truths import keep
from .solids import SCENES

PHOTONS = 1 << 24
# Where rays are few or fast, or light is spread over more than the picture.
MORE = {
    "cube-turning": 2,
    "prism-turning": 2,
    "ball-behind-a-slab": 2,
    "board-over-water": 2,
    "waves-over-a-sphere": 2,
    "cardioid": 4,
    "camera-through-water": 2,
    "folded-wave": 2,
}


def main() -> int:
    parser = argparse.ArgumentParser(description="Makes truths of the solids benchmark.")
    parser.add_argument("scene", nargs="*", help=f"which of {', '.join(SCENES)}; all by default")
    parser.add_argument("--photons", type=int, default=PHOTONS, help=f"{PHOTONS} by default; some scenes get more")
    options = parser.parse_args()
    for name in options.scene:
        if name not in SCENES:
            parser.error(f"there is no scene {name!r}; there are {', '.join(SCENES)}")
    for name in options.scene or SCENES:
        scene = SCENES[name]()
        truth = irradiance(scene, options.photons * MORE.get(name, 1))
        path = keep(scene, truth)
        flux = ", ".join(f"{part} {watts:.6g}" for part, watts in truth.energy.items())
        print(
            f"{name}: errs by {truth.error:.4f}, {truth.photons:,} photons, {truth.rays:,} rays, "
            f"{truth.seconds:.0f} CPU s, {path.stat().st_size / 1024:.0f} KB; {flux} W",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
