"""Irradiance in the pixels of a camera, averaged over the shutter, with an estimate of its own error."""

from __future__ import annotations

import itertools
import os
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from .description import Scene
from .mesh_tracer import ABSORBED, DIRECT, ESCAPED, LOST, MESHES, RAYS, ROULETTE_GAIN, SENT, Tracer, load

# Instants and rays a pixel at which the camera looks whether it sees one receiver all the time.
LOOKS, LOOKS_ACROSS = 9, 3


@dataclass(frozen=True, eq=False)
class Truth:
    """Irradiance by brute force.

    Attributes:
        irradiance: Mean over pixel and shutter of light that met something specular first, [height, width], W/m².
        mask: Where a pixel sees one and the same receiver, directly, all the time; shape [height, width].
        error: Its own relative RMSE within the mask (by the mean there), from two independent halves.
        energy: W, by ``sent``, ``direct``, ``escaped``, ``absorbed``, ``lost``, ``roulette``, and prim paths.
        photons: Photons sent in all.
        rays: Rays traced in all.
        seconds: CPU time it took.
    """

    irradiance: np.ndarray
    mask: np.ndarray
    error: float
    energy: dict[str, float]
    photons: int
    rays: int
    seconds: float


def irradiance(scene: Scene, photons: int, parts: int = 64, seed: int = 1, threads: int | None = None) -> Truth:
    """Traces a scene in two independent halves.

    In each of the equal parts of the shutter, photons follow a scrambled Sobol sequence jointly over the time in that
    part and over the part of each light's domain that holds the specular meshes then.

    Args:
        scene: What to trace.
        photons: Photons in all.
        parts: Into which the shutter is cut, so that the boxes in which triangles move stay small.
        seed: Of scrambling and roulette.
        threads: Threads; None for one a core.
    """
    start = time.process_time()
    load()
    shares = np.array([light.share for light in scene.lights])
    counts = np.maximum(1, np.round(photons / (2 * parts) * shares / shares.sum())).astype(int)
    workers = threads or os.cpu_count() or 1
    tracers = [[Tracer(scene) for _ in range(workers)] for _ in range(2)]

    def work(worker: int) -> None:
        for half, part in itertools.product(range(2), range(worker, parts, workers)):
            tracer = tracers[half][worker]
            tracer.open(part / parts, (part + 1) / parts)
            for index, light in enumerate(scene.lights):
                number = ((seed * 2 + half) * parts + part) * len(scene.lights) + index
                tracer.send(light, int(counts[index]), number)

    with ThreadPoolExecutor(workers) as pool:
        for done in [pool.submit(work, worker) for worker in range(workers)]:
            done.result()
    halves = [sum(tracer.picture for tracer in half) / parts for half in tracers]
    account = sum(tracer.account for half in tracers for tracer in half) / (2 * parts)
    mask = clear_view(scene)
    mean = 0.5 * (halves[0] + halves[1])
    difference = (halves[0] - halves[1])[mask]
    error = 0.5 * float(np.sqrt(np.mean(difference**2)) / mean[mask].mean())
    energy = {
        "sent": account[SENT],
        "direct": account[DIRECT],
        "escaped": account[ESCAPED],
        "absorbed": account[ABSORBED],
        "lost": account[LOST],
        "roulette": account[ROULETTE_GAIN],
    }
    energy |= {mesh.name: account[MESHES + i] for i, mesh in enumerate(scene.meshes) if account[MESHES + i]}
    return Truth(
        mean,
        mask,
        error,
        {name: float(value) for name, value in energy.items()},
        int(counts.sum()) * 2 * parts,
        int(round(account[RAYS] * 2 * parts)),
        time.process_time() - start,
    )


def clear_view(scene: Scene) -> np.ndarray:
    """Where a pixel sees one and the same receiver, directly, all the time; shape [height, width]."""
    tracer = Tracer(scene)
    seen = np.full((scene.camera.height, scene.camera.width), -1, np.int32)
    for s in np.linspace(0.0, 1.0, LOOKS):
        tracer.look(float(s), seen, LOOKS_ACROSS)
    return seen >= 0
