"""Sequences small enough to be compared in no time, and ways to break them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from tpdwarp.io.images import write_frame

WIDTH, HEIGHT = 40, 24
SETTINGS = {"photons": 64, "seed": 0, "threads": 2, "exposure": 0.5}


def channels(frame: float = 1, seed: int = 5) -> dict[str, np.ndarray]:
    """A smooth picture with a bright spot that moves with the frame, its caustic, depth and coverage."""
    generator = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    spot = 3.0 * np.exp(-((x - 10 - 2 * frame) ** 2 + (y - 12) ** 2) / 18)
    texture = generator.uniform(0.2, 0.4, (HEIGHT, WIDTH))
    made = {name: texture + part * spot for name, part in zip("RGB", (1.0, 0.8, 0.5), strict=True)}
    made |= {f"caustic.{name}": part * spot + 0.01 for name, part in zip("RGB", (1.0, 0.8, 0.5), strict=True)}
    made |= {"A": np.ones((HEIGHT, WIDTH)), "Z": 5 + 0.1 * x}
    return {name: values.astype(np.float32) for name, values in made.items()}


def metadata(frame: float = 1, **changes: Any) -> dict[str, Any]:
    """What a frame's file says of itself."""
    plain = {
        "tpdwarp:settings": json.dumps(SETTINGS),
        "tpdwarp:frame": float(frame),
        "tpdwarp:shutterOpen": frame - 0.25,
        "tpdwarp:shutterClose": frame + 0.25,
        "tpdwarp:version": "1",
        "tpdwarp:renderSeconds": 1.0,
        "framesPerSecond": 24.0,
        "worldToCamera": np.eye(4),
    }
    return plain | changes


def write(folder: Path, frame: float = 1, name: str = "wave", values: Any = None, **changes: Any) -> Path:
    """Writes one frame, ``wave.0001.exr``, and returns its path."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.{int(frame):04d}.exr"
    write_frame(path, values or channels(frame), metadata(frame, **changes))
    return path


def write_sequence(folder: Path, count: int = 3, **changes: Any) -> Path:
    """Writes frames 1 to ``count`` and returns the folder."""
    for frame in range(1, count + 1):
        write(folder, frame, **changes)
    return folder
