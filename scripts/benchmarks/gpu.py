"""Seconds of a further frame on a CUDA device and on all cores beside it, and how far the two pictures are apart."""

from __future__ import annotations

import os
import statistics
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

import tpdwarp
from tpdwarp.io.images import read_image

SCENES = Path(__file__).resolve().parents[2] / "usd_scenes"
CASES: tuple[tuple[str, dict[str, Any]], ...] = (
    ("wave", {"image_width": 512, "photons": 16384, "samples": 4}),
    ("wave", {"image_width": 512, "photons": 1_000_000, "samples": 1}),
    ("cylinder", {"image_width": 512, "photons": 65536, "samples": 4}),
    ("tumbler", {"image_width": 720, "photons": 16384, "samples": 4}),
    ("sea", {"image_width": 1920, "photons": 65536, "samples": 4}),
)
FRAMES = (1, 2, 3, 4)


def run() -> list[dict[str, Any]]:
    wp.init()
    if not wp.get_cuda_device_count():
        print("there is no CUDA device")
        return []
    rows = []
    print(f"{wp.get_device('cuda:0').name} and {os.cpu_count()} cores; seconds of a further frame:")
    for name, settings in CASES:
        row: dict[str, Any] = {"scene": name, **settings}
        pictures = []
        with tempfile.TemporaryDirectory() as folder:
            for device in ("cpu", "cuda:0"):
                out = f"{folder}/{device.replace(':', '')}.####.exr"
                options = {**settings, "exposure": 1.0, "aovs": ("irradiance",), "device": device}
                result = tpdwarp.render(SCENES / f"{name}.usdc", out, frames=FRAMES, **options)
                further = result.outcomes[1:]
                row[device] = statistics.median(outcome.total_seconds for outcome in further)
                stages = {name for outcome in further for name in outcome.seconds}
                row[f"{device} stages"] = {
                    name: statistics.median(outcome.seconds.get(name, 0.0) for outcome in further) for name in stages
                }
                channels, _ = read_image(out.replace("####", f"{FRAMES[-1]:04d}"))
                pictures.append(channels["irradiance.G"].astype(float))
        one, other = pictures
        row["difference"] = float(np.sqrt(np.mean((one - other) ** 2)) / one.mean())
        rows.append(row)
        print(
            f"  {name:9s} {settings['image_width']:4d} px {settings['photons']:8d} photons, "
            f"{settings['samples']} samples: CPU {row['cpu']:6.2f}  GPU {row['cuda:0']:6.2f}  "
            f"relative RMS difference {row['difference']:.1e}",
            flush=True,
        )
        for device in ("cpu", "cuda:0"):
            longest = sorted(row[f"{device} stages"].items(), key=lambda stage: -stage[1])
            print(f"    {device}: " + ", ".join(f"{name} {seconds:.2f}" for name, seconds in longest), flush=True)
    return rows
