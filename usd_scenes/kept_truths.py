"""What light truly does in a scene, kept in small files beside this module."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from .brute_force import Scene, Truth

FOLDER = Path(__file__).resolve().parent / "truths"
# Float32 coordinates of another machine may differ in the last place; a scene that was changed differs by more.
SAME = 1e-5


def keep(scene: Scene, truth: Truth) -> Path:
    """Writes the truth of a scene, irradiance as float16 (half a thousandth of each pixel); its path.

    Raises:
        ValueError: Irradiance beyond what float16 holds.
    """
    if truth.irradiance.max() > np.finfo(np.float16).max:
        raise ValueError(f"{scene.name}: irradiance of {truth.irradiance.max():g} W/m² is too high to be kept")
    FOLDER.mkdir(exist_ok=True)
    path = FOLDER / f"{scene.name}.npz"
    np.savez_compressed(
        path,
        irradiance=truth.irradiance.astype(np.float16),
        mask=np.packbits(truth.mask),
        error=truth.error,
        energy=json.dumps(truth.energy),
        counts=np.array([truth.photons, truth.rays]),
        seconds=truth.seconds,
        traits=_traits(scene),
    )
    return path


def kept_truth(scene: Scene) -> Truth:
    """The truth that is kept for a scene.

    Raises:
        FileNotFoundError: None is.
        ValueError: It is of another scene of that name.
    """
    with np.load(FOLDER / f"{scene.name}.npz") as kept:
        traits = _traits(scene)
        if kept["traits"].shape != traits.shape or not np.allclose(kept["traits"], traits, rtol=SAME, atol=SAME):
            raise ValueError(f"{scene.name} has changed (make its truth anew: python -m usd_scenes.make_truths)")
        irradiance = kept["irradiance"].astype(np.float64)
        mask = np.unpackbits(kept["mask"], count=irradiance.size).astype(bool).reshape(irradiance.shape)
        photons, rays = (int(count) for count in kept["counts"])
        energy = json.loads(str(kept["energy"]))
        return Truth(irradiance, mask, float(kept["error"]), energy, photons, rays, float(kept["seconds"]))


def _traits(scene: Scene) -> np.ndarray:
    """A few numbers that change when a scene does, shape [n]."""
    rows = [
        (*np.abs(ends).mean(axis=0, dtype=np.float64), len(ends), mesh.interaction, mesh.ior, mesh.tint)
        for mesh in scene.meshes
        for ends in (*mesh.points, *(mesh.normals or ()))
    ]
    lights = [
        (light.power, *np.ravel(light.direction if light.position is None else light.position))
        for light in scene.lights
    ]
    camera = (*np.ravel(scene.camera.position), scene.camera.size, scene.camera.width, scene.camera.height)
    return np.concatenate([np.ravel(rows), *lights, camera])
