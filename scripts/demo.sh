#!/usr/bin/env bash
# Renders eight frames of the travelling wave with motion blur: EXR, PNG and the photons as a debug layer, in out/.
set -euo pipefail

root=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd -P)
"$root/scripts/setup.sh"
cd "$root"
mkdir -p out
.venv/bin/python -m tpdwarp render usd_scenes/wave.usdc out/wave.####.exr \
    --frames 1:8 -w 512 --debug-layer out/wave.debug.usdc --curves 4096 ${CI:+--progress plain}
.venv/bin/python scripts/to_png.py out/wave.????.exr
cat <<END

Frames (linear):     $root/out/wave.0001.exr … 0008
Frames (sRGB):       $root/out/wave.0001.png … 0008
Photons:             $root/out/wave.debug.usdc
Photons and scene:   $root/out/wave.view.usda   (usdview out/wave.view.usda)
END
