"""The presets beside the front of error against CPU time, on scenes whose irradiance is known exactly."""

from __future__ import annotations

from typing import Any

from comparison import Point, front_of, measured, scenes

from tpdwarp.presets import PRESETS

NAMES = ("draft", "standard", "final")
PHOTONS = (1 << 10, 1 << 12, 1 << 14, 1 << 16, 1 << 18, 1 << 20)
SAMPLES = (1, 2, 4, 16)
SEGMENTS = (1, "auto")
# Dearer combinations of these cannot lie on a front that others of the same photons reach with fewer samples.
MOST_COST = 1 << 23


def settings_swept() -> list[dict[str, Any]]:
    """Photons × samples × segments, without those that take minutes."""
    return [
        {"photons": photons, "samples": samples, "segments": segments}
        for photons in PHOTONS
        for samples in SAMPLES
        for segments in SEGMENTS
        if photons * samples <= MOST_COST and (photons < 1 << 20 or segments == "auto")
    ]


def described(settings: dict[str, Any]) -> str:
    """Settings in a few words."""
    return f"{settings['photons']:8d} photons, K {settings['segments']!s:4s}, {settings['samples']:2d} samples"


def run() -> list[dict[str, object]]:
    """The front of each scene, and what each preset costs beside the cheapest settings that err no more."""
    results = []
    for scene in scenes():
        print(f"{scene.name}: relative RMSE and CPU seconds, settings that none is both cheaper and more exact than")
        measured(scene, "warm", photons=64)
        measured(scene, "warm", photons=2048, segments="auto", samples=1)
        points = [measured(scene, described(settings), **settings) for settings in settings_swept()]
        for point in front_of(points):
            print(f"  {point.what}: {point.error:.4f}, {point.seconds:6.2f} s", flush=True)
        for name in NAMES:
            preset = measured(scene, f"--preset {name}", **PRESETS[name])
            cheapest = cheapest_of([*points, preset], preset.error)
            times = preset.seconds / cheapest.seconds
            found = f"{preset.error:.4f}, {preset.seconds:6.2f} s, {times:.1f} times the cheapest"
            print(f"  --preset {name}: {found} ({cheapest.what.strip()})", flush=True)
            results.append({"scene": scene.name, "preset": name, "error": preset.error, "seconds": preset.seconds})
            results[-1]["times the cheapest"] = times
    return results


def cheapest_of(points: list[Point], error: float) -> Point:
    """The cheapest point that errs by no more than ``error``."""
    return min((point for point in points if point.error <= error), key=lambda point: point.seconds)
