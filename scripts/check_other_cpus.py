"""Shows that one baseline serves other processors: the shipped scenes, rendered as these would, raise no alarm.

    python scripts/check_other_cpus.py [--width 192] [--seeds 6] [--scenes wave,mirror] [--builds sse2] [--keep DIR]

Processors differ in how they round: whether a product and a sum are fused, how wide sums are cut up, which variant of
a library's sine is taken. One machine can do it in all these ways: Warp compiles its kernels for a named processor
(``warp.config.cpu_compiler_flags``), and NumPy, OpenBLAS and the C library are told by their environment variables to
do without what the named processor lacks. Each scene's baseline is rendered by the ordinary build with all channels and
a debug layer, is rendered again by every build below, and both are checked at default and at calibrated limits.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import tpdwarp
from tpdwarp.checks.calibrate import calibrate
from tpdwarp.checks.findings import CheckResult
from tpdwarp.checks.limits import Limits

SCENES = Path(__file__).resolve().parent.parent / "usd_scenes"
NAMES = ("wave", "mirror", "sea", "cylinder")
FRAMES = "3:4"
AOVS = "caustic,direct,irradiance,motion,photons,Z,N,P"
_X86 = platform.machine().lower() in ("x86_64", "amd64")


def _without(*features: str, core: str) -> dict[str, str]:
    """Environment in which NumPy, the C library and OpenBLAS do without some of the processor's instructions."""
    dispatched = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
    level = "V4" if "AVX2" not in features else "V"
    unwanted = [name for name in dispatched if name.startswith((*features, f"X86_{level}"))]
    switches = ",".join(f"-{name}" for name in features)
    return {
        "NPY_DISABLE_CPU_FEATURES": " ".join(unwanted),
        "GLIBC_TUNABLES": f"glibc.cpu.hwcaps={switches}",
        "OPENBLAS_CORETYPE": core,
    }


_AVX512 = ("AVX512F", "AVX512VL", "AVX512BW", "AVX512DQ", "AVX512CD", "AVX512_")


@dataclass(frozen=True)
class Build:
    """How another processor would compute.

    Attributes:
        title: What it stands for.
        flags: For Warp's compiler.
        environment: For NumPy, OpenBLAS and the C library.
    """

    title: str
    flags: str
    environment: dict[str, str]


def builds() -> dict[str, Build]:
    """Builds by name."""
    without_avx = _without(*_AVX512, "AVX2", "FMA", "AVX", core="Nehalem")
    x86 = {
        "haswell": Build("Haswell: AVX2, FMA", "-target-cpu haswell", _without(*_AVX512, core="Haswell")),
        "sandybridge": Build("Sandy Bridge: AVX, no FMA", "-target-cpu sandybridge", without_avx),
        "sse2": Build("any x86-64: SSE2, no FMA", "", without_avx),
    }
    others = {"fused": Build("products and sums fused", "-march=native -ffp-contract=fast", {})}
    return (x86 if _X86 else {}) | others


_RENDER = """
import sys
import warp
if sys.argv[1] != "ordinary":
    warp.config.cpu_compiler_flags = sys.argv[2]
from tpdwarp.cli import main
sys.exit(main(sys.argv[3:]))
"""


def render(scene: Path, folder: Path, width: int, photons: int, build: Build | None = None) -> None:
    """Renders two frames and their debug layer in a process of its own; None takes the ordinary build.

    Raises:
        SystemExit: It could not.
    """
    which = ("ordinary", "") if build is None else ("other", build.flags)
    command = [sys.executable, "-c", _RENDER, *which, "render", str(scene), str(folder / "frame.####.exr")]
    command += ["-f", FRAMES, "-w", str(width), "--photons", str(photons), "--samples", "4", "--exposure", "0.5"]
    command += ["--aov", AOVS, "--debug-layer", str(folder / "photons.debug.usdc"), "--progress", "none"]
    environment = {**os.environ, **(build.environment if build else {})}
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{scene.name}: {done.stdout}{done.stderr}")


def complaints(result: CheckResult, severity: str) -> list[str]:
    """What fails in a check, or what it warns of."""
    found = [(frame.name, finding) for frame in result.frames for finding in frame.findings]
    return [f"frame {name}: {finding}" for name, finding in found if finding.severity == severity]


def largest(result: CheckResult, measure: str) -> float:
    """The largest of a measure over the frames and channel groups."""
    found = [getattr(measures, measure) for frame in result.frames for measures in frame.measures.values()]
    return max((abs(value) for value in found if value is not None), default=0.0)


def same_photons(result: CheckResult) -> bool:
    """Whether the debug layers agree to the last bit."""
    return all(frame.identical for frame in result.frames if frame.name.startswith("photons"))


@contextlib.contextmanager
def workplace(keep: Path | None) -> Iterator[Path]:
    """A folder to work in, kept where one is named."""
    if keep is not None:
        keep.mkdir(parents=True, exist_ok=True)
        yield keep
        return
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder)


def main() -> int:
    """Prints a line a scene and build; returns 1 where one raised an alarm."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--width", type=int, default=192, help="Width of the frames in pixels. [192]")
    parser.add_argument("--photons", type=int, default=16384, help="Photons a frame. [16384]")
    parser.add_argument("--seeds", type=int, default=6, help="Seeds to calibrate by; 0 for none. [6]")
    parser.add_argument("--scenes", default=",".join(NAMES), help=f"Which. [{','.join(NAMES)}]")
    parser.add_argument("--builds", help=f"Which, of {', '.join(builds())}. [all]")
    parser.add_argument("--keep", type=Path, help="Folder for the frames and reports. [temporary]")
    options = parser.parse_args()
    wrong = 0
    wanted = options.builds.split(",") if options.builds else builds()
    chosen = {name: build for name, build in builds().items() if name in wanted}
    with workplace(options.keep) as folder:
        print(f"{'':42} alarms, warnings at limits")
        print(f"{'scene':8} {'as rendered by':30}   default calibrated     RMSE  largest   energy  photons")
        for name in options.scenes.split(","):
            scene, baseline = SCENES / f"{name}.usdc", folder / name / "baseline"
            render(scene, baseline, options.width, options.photons)
            limits = [Limits()]
            if options.seeds:
                file = folder / name / "calibrated.toml"
                limits.append(calibrate(scene, baseline, seeds=options.seeds, limits=file))
            for number, build in enumerate(chosen.values()):
                frames = folder / name / f"build {number}"
                render(scene, frames, options.width, options.photons, build)
                reports = [frames.with_suffix(".html") if options.keep else None, None]
                results = [
                    tpdwarp.check(frames, baseline, limits=allowed, report=report)
                    for allowed, report in zip(limits, reports, strict=False)
                ]
                failures, warnings = ([complaints(result, kind) for result in results] for kind in ("fail", "warn"))
                counts = [f"{len(failed)}, {len(warned)}" for failed, warned in zip(failures, warnings, strict=True)]
                counts += ["-"] * (2 - len(counts))
                sizes = " ".join(f"{largest(results[0], measure):8.1e}" for measure in ("rmse", "hard", "energy"))
                layer = "same" if same_photons(results[0]) else "differ"
                print(f"{name:8} {build.title:30} {counts[0]:>9} {counts[1]:>10} {sizes} {layer:>8}", flush=True)
                for line in [line for found in (*failures, *warnings) for line in found]:
                    print(f"    {line}", flush=True)
                wrong += any(failures)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
