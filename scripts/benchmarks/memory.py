"""Memory that frames take, held against what the program says beforehand, and its growth over a long sequence."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

SCENES = Path(__file__).resolve().parents[2] / "usd_scenes"
# Photons, width, samples: at rest, then each of them large.
SIZES = ((1024, 64, 1), (2**18, 64, 1), (2**20, 64, 1), (1024, 1024, 1), (1024, 1024, 4))
FRAMES, EARLY = 200, 20
_FRAME = """
import json, sys, tpdwarp
from tpdwarp.studies.memory import peak_bytes
scene, out, photons, width, samples = sys.argv[1:3] + [int(value) for value in sys.argv[3:]]
sizes = {"photons": photons, "image_width": width}
tpdwarp.render(scene, out, frames=3, samples=samples, threads=1, **sizes)
peak = peak_bytes()
print(json.dumps([peak, tpdwarp.info(scene, frames=3, **sizes)["memory_of_a_frame"]["bytes"]]))
"""
_SEQUENCE = """
import json, sys, tpdwarp
from pathlib import Path
from tpdwarp.jobs.progress import Progress
class Watch(Progress):
    def __init__(self):
        self.resident = []
    def end(self, outcome):
        status = Path("/proc/self/status").read_text()
        self.resident.append(int(status.split("VmRSS:")[1].split()[0]) * 1024)
watch = Watch()
frames = [1 + 23 * number / 250 for number in range(int(sys.argv[3]))]
tpdwarp.render(sys.argv[1], sys.argv[2], frames=frames, image_width=64, photons=4096, samples=1, threads=1,
    progress=watch)
print(json.dumps(watch.resident))
"""


def run() -> dict[str, float]:
    """Peaks in MB by size, with estimates, and memory after 200 frames over that after 20."""
    results: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:

        def measured(script: str, *arguments: object) -> list[float]:
            command = [sys.executable, "-c", script, *map(str, arguments)]
            printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
            return json.loads(printed.splitlines()[-1])

        for name in ("wave", "sea"):
            for photons, width, samples in SIZES:
                peak, need = measured(_FRAME, SCENES / f"{name}.usdc", f"{folder}/a.exr", photons, width, samples)
                what = f"{name}, {photons} photons, {width} pixels across, {samples} samples"
                results[what] = peak / 1e6
                said = f"estimate {need / 1e6:.0f} MB, {peak / need:.2f} of it"
                print(f"  {what}: {peak / 1e6:.0f} MB, {said}", flush=True)
        resident = measured(_SEQUENCE, SCENES / "wave.usdc", f"{folder}/a.###.###.exr", FRAMES)
        results["growth"] = resident[FRAMES - 1] / resident[EARLY - 1]
    early, late = resident[EARLY - 1] / 1e6, resident[FRAMES - 1] / 1e6
    print(f"  after {EARLY} frames {early:.1f} MB, after {FRAMES} {late:.1f} MB: {results['growth']:.4f}")
    return results
