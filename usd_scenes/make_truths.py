"""Makes the truths of the scenes of solids anew, one after the other; each takes some minutes of two cores.

python -m usd_scenes.make_truths                   # all of them
python -m usd_scenes.make_truths ball-gliding      # one
"""

from __future__ import annotations

import argparse
import sys

from .kept_truths import keep
from .oracle import irradiance
from .solids import SCENES

PHOTONS = 1 << 24
# Where rays are few or fast, or light is spread over more than the picture.
MORE_PHOTONS = {
    "cube-turning": 1 << 25,
    "prism-turning": 1 << 25,
    "ball-behind-a-slab": 1 << 25,
    "board-over-water": 1 << 25,
    "waves-over-a-sphere": 1 << 25,
    "cardioid": 1 << 26,
    "camera-through-water": 1 << 25,
    "folded-wave": 1 << 25,
}


def main() -> int:
    parser = argparse.ArgumentParser(description="Makes truths of the solids benchmark.")
    parser.add_argument("scene", nargs="*", help=f"which of {', '.join(SCENES)}; all by default")
    options = parser.parse_args()
    for name in options.scene:
        if name not in SCENES:
            parser.error(f"there is no scene {name!r}; there are {', '.join(SCENES)}")
    for name in options.scene or SCENES:
        scene = SCENES[name]()
        truth = irradiance(scene, MORE_PHOTONS.get(name, PHOTONS))
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
