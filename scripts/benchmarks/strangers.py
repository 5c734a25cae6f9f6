#!/usr/bin/env python3
"""Error of the renderer on scenes as people bring them (``usd_scenes/strangers.py``).

Their truth is brute force where bodies glide and for some that turn, and else many instants.

.venv/bin/python scripts/benchmarks/strangers.py                                # all of them, 16 384 photons
.venv/bin/python scripts/benchmarks/strangers.py pendulum-lens --segments auto --segments 1 --segments 4
.venv/bin/python scripts/benchmarks/strangers.py lens-over-stairs --target-error 0.1 --target-error 0.05
.venv/bin/python scripts/benchmarks/strangers.py --make-truths                  # made anew, hours of CPU time
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from solids import channel
from truths import CONVERGED, LEFT

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import tpdwarp
from tpdwarp.jobs.opening import open_scene, spread_shutters
from tpdwarp.rendering.error_target import settled
from tpdwarp.settings import Settings
from usd_scenes.brute_force.photon_histogram import irradiance
from usd_scenes.stage import CAMERA, FRAME
from usd_scenes.strangers import PIXELS, STRANGERS, write

PHOTONS = 1 << 14
SAMPLES = 4
# Photons of brute force, for bodies that glide: it takes light at edges as it falls.
BRUTE_PHOTONS = 16_000_000
# So have these that turn, in pieces of the shutter in which vertices go straight.
BY_BRUTE_FORCE = ("mirror-beside-a-dome", "prism-200", "paddle-under-a-blob")
PIECES = 64
# Photons and instants of two truths, of which the second is kept. Light sweeps over 25 pixels at most, so that there
# are five instants a pixel; of a sharp focus these still are stripes.
TRUTHS = ((1 << 14, 64), (1 << 16, 128))
OF_SHARP_LIGHT = {"pendulum-lens": ((1 << 14, 384), (1 << 14, 1024))}


def run(scenes: Sequence[str] = ()) -> list[dict[str, object]]:
    """Errors of each scene with automatic segments; prints them as they come."""
    return compare(scenes, (PHOTONS,), ("auto",))


def compare(
    scenes: Sequence[str], photons: Sequence[int], segments: Sequence[int | str], samples: int = SAMPLES
) -> list[dict[str, object]]:
    """Errors of each scene, number of photons and number of segments; prints a row each.

    Returns:
        A row a render: ``scene``, ``photons``, ``asked`` (segments), ``segments``, ``relative_rmse`` (by the truth's
        mean), ``truth_error``, ``irradiance_ratio`` (of the means), ``landed``, ``lost`` and ``cpu_seconds``.
    """
    rows: list[dict[str, object]] = []
    print(f"  {'scene':24s} {'photons':>8s} {'K':>3s} {'rel.RMSE':>9s} {'truth':>6s}", end=" ")
    print(f"{'mean':>6s} {'lost':>8s} {'CPU s':>6s}")
    for name in scenes or STRANGERS:
        truth, error = kept_truth(name)
        with tempfile.TemporaryDirectory() as folder:
            stage = write(name, Path(folder))
            for count in photons:
                for asked in segments:
                    row = {"scene": name, "photons": count, "asked": asked, "truth_error": error}
                    row |= _measured(stage, truth, photons=count, segments=asked, samples=samples)
                    rows.append(row)
                    print(
                        f"  {name:24s} {count:8d} {row['segments']:3d} {row['relative_rmse']:9.4f} {error:6.3f} "
                        f"{row['irradiance_ratio']:6.3f} {row['lost']:8.1e} {row['cpu_seconds']:6.2f}",
                        flush=True,
                    )
    return rows


def compare_targets(scenes: Sequence[str], wanted: Sequence[float]) -> list[dict[str, object]]:
    """The error that is asked for beside the one that comes out; prints a row each.

    Returns:
        A row a scene and wanted error: ``scene``, ``wanted``, ``photons``, ``chosen`` (segments), ``expected``,
        ``relative_rmse``, ``pilot_seconds`` and ``cpu_seconds`` (of the frame).
    """
    rows: list[dict[str, object]] = []
    print(f"  {'scene':24s} {'asked':>6s} {'photons':>8s} {'K':>3s} {'told':>6s} {'got':>6s}", end=" ")
    print(f"{'got/asked':>9s} {'truth':>6s} {'pilot s':>8s} {'frame s':>8s}")
    for name in scenes or STRANGERS:
        truth, error = kept_truth(name)
        with tempfile.TemporaryDirectory() as folder:
            stage = write(name, Path(folder))
            for asked in wanted:
                base = Settings(camera=CAMERA, image_width=PIXELS, exposure=1.0, samples=SAMPLES, target_error=asked)
                source = open_scene(stage, base, False)
                start = time.process_time()
                found, target = settled(source, base, spread_shutters(source, base), PIXELS, PIXELS)
                pilot = time.process_time() - start
                # With the truth's samples, which see the same places.
                chosen = {"photons": found.photons, "segments": found.segments, "samples": found.samples}
                row = {"scene": name, "wanted": asked, "chosen": found.segments, "expected": target.expected}
                row |= {"photons": found.photons, "pilot_seconds": pilot} | _measured(stage, truth, **chosen)
                rows.append(row)
                print(
                    f"  {name:24s} {asked:6.3f} {found.photons:8d} {found.segments:3d} {target.expected:6.3f} "
                    f"{row['relative_rmse']:6.3f} {row['relative_rmse'] / asked:9.2f} {error:6.3f} {pilot:8.1f} "
                    f"{row['cpu_seconds']:8.1f}",
                    flush=True,
                )
    return rows


def make_truths(scenes: Sequence[str]) -> None:
    """Makes truths anew and keeps them; their own error is told by the change from coarser ones, or by two halves."""
    for name in scenes or STRANGERS:
        stranger = STRANGERS[name]()
        if stranger.glides or name in BY_BRUTE_FORCE:
            pieces = stranger.pieces(1 if stranger.glides else PIECES)
            found = [irradiance(piece, BRUTE_PHOTONS // len(pieces)) for piece in pieces]
            light = np.mean([truth.irradiance for truth in found], axis=0)
            # Pieces err on their own; one without light has no error.
            of_each = [np.nan_to_num(truth.error) * truth.irradiance.mean() / len(pieces) for truth in found]
            error = float(np.linalg.norm(of_each) / light.mean())
            np.savez_compressed(_path_of(name), light=light.astype(np.float16), error=error)
            print(f"{name}: errs by {error:.4f}, {sum(truth.seconds for truth in found):.0f} CPU s", flush=True)
            continue
        with tempfile.TemporaryDirectory() as folder:
            stage = write(name, Path(folder))
            start = time.process_time()
            coarse, fine = (
                _light(stage, estimator="accumulation", photons=photons, accumulation_times=instants)[0]
                for photons, instants in OF_SHARP_LIGHT.get(name, TRUTHS)
            )
        error = float(np.sqrt(np.mean((coarse - fine) ** 2)) / fine.mean()) * LEFT / (1.0 - LEFT)
        np.savez_compressed(_path_of(name), light=fine.astype(np.float16), error=error)
        print(f"{name}: errs by {error:.4f}, {time.process_time() - start:.0f} CPU s", flush=True)


def kept_truth(name: str) -> tuple[np.ndarray, float]:
    """Irradiance that is kept for a scene, shape [height, width], and its own relative RMSE."""
    with np.load(_path_of(name)) as kept:
        return kept["light"].astype(np.float64), float(kept["error"])


def _path_of(name: str) -> Path:
    return CONVERGED / f"{name}.npz"


def _measured(stage: Path, truth: np.ndarray, **settings: Any) -> dict[str, object]:
    """One render compared with the truth."""
    start = time.process_time()
    found, energy = _light(stage, **settings)
    return {
        "relative_rmse": float(np.sqrt(np.mean((found - truth) ** 2)) / truth.mean()),
        "irradiance_ratio": float(found.mean() / truth.mean()),
        "landed": energy.deposited / energy.sent,
        "lost": sum(energy.lost.values()) / energy.sent,
        "segments": int(energy.counts.get("segments traced", 1)),
        "cpu_seconds": time.process_time() - start,
    }


def _light(stage: Path, **settings: Any) -> tuple[np.ndarray, Any]:
    """Irradiance of a frame, shape [height, width], and where the flux went."""
    with tempfile.TemporaryDirectory() as folder:
        picture = Path(folder) / "light.exr"
        result = tpdwarp.render(
            stage, picture, frames=FRAME, camera=CAMERA, image_width=PIXELS, aovs=("irradiance",), exposure=1.0,
            **{"samples": SAMPLES, **settings},
        )  # fmt: skip
        return channel(picture, "irradiance.R"), result.energy[float(FRAME)]


def main() -> int:
    parser = argparse.ArgumentParser(description="Measures errors on scenes as people bring them.")
    parser.add_argument("scene", nargs="*", help=f"which of {', '.join(STRANGERS)}; all by default")
    parser.add_argument("--photons", type=int, action="append", help=f"photons a frame; {PHOTONS} by default")
    parser.add_argument("--segments", action="append", help="number of segments; auto by default")
    parser.add_argument("--samples", type=int, default=SAMPLES, help="camera samples a pixel; %(default)s by default")
    parser.add_argument("--target-error", type=float, action="append", help="asks for this error")
    parser.add_argument("--make-truths", action="store_true", help="makes the truths of these scenes anew")
    options = parser.parse_args()
    for name in options.scene:
        if name not in STRANGERS:
            parser.error(f"there is no scene {name!r}; there are {', '.join(STRANGERS)}")
    if options.make_truths:
        make_truths(options.scene)
    elif options.target_error:
        compare_targets(options.scene, options.target_error)
    else:
        segments = [asked if asked == "auto" else int(asked) for asked in options.segments or ("auto",)]
        compare(options.scene, options.photons or (PHOTONS,), segments, options.samples)
    return 0


if __name__ == "__main__":
    sys.exit(main())
