#!/usr/bin/env bash
# Renders eight frames of a shallow sea with motion blur: EXR, PNG and the photons as a debug layer, in out/.
set -euo pipefail

root=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd -P)
"$root/scripts/setup.sh"
cd "$root"
mkdir -p out
.venv/bin/python -m tpdwarp render usd_scenes/sea.usdc out/sea.####.exr \
    --frames 1:8 -w 512 --exposure 0.5 --debug-layer out/sea.debug.usdc --curves 4096 ${CI:+--progress plain}
.venv/bin/python scripts/to_png.py out/sea.????.exr
cat <<END

Photons:             $root/out/sea.debug.usdc
Photons and scene:   $root/out/sea.view.usda   (usdview out/sea.view.usda)
Frames (linear):     $root/out/sea.0001.exr … 0008
Frames (sRGB):       $root/out/sea.0001.png … 0008
END
