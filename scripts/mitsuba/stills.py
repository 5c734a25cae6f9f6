#!/usr/bin/env python3
"""Averages in-between stills of a moving scene with Mitsuba 3's particle tracer, pass after pass, and notes CPU time.

    PYTHON scripts/mitsuba/stills.py FOLDER

PYTHON is one that has Mitsuba (pip install mitsuba numpy); ``scripts/benchmarks/peers.py`` makes one, writes FOLDER and
reads ``stills.npz`` from it: the mean of all passes so far after each (``pictures`` [n, height, width]) and the CPU
``seconds`` [n] that it took, reading included; and ``direct``, what falls on the floor beside the glass.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import mitsuba as mi
import numpy as np

DEPTH = 24


def main() -> None:
    """Renders passes of 1, 1, 2, 4 … particles a pixel and instant until time is up."""
    # Its other variant on CPUs takes about twice the time, and needs an LLVM that few systems have.
    mi.set_variant("scalar_rgb")
    mi.set_log_level(mi.LogLevel.Warn)
    folder = Path(sys.argv[1])
    described = json.loads((folder / "scene.json").read_text())
    integrator = mi.load_dict({"type": "ptracer", "max_depth": DEPTH})
    start = time.process_time()
    scenes = [_scene_of(described, folder, still, True) for still in range(described["stills"])]
    particles, seed, weighed = 0, 0, np.zeros((described["height"], described["width"]))
    pictures, seconds = [], []
    while not seconds or seconds[-1] < described["seconds"]:
        count = max(particles, 1)
        for scene in scenes:
            seed += 1
            weighed += count * _rendered(scene, integrator, count, seed) / len(scenes)
        particles += count
        pictures.append(weighed / particles)
        seconds.append(time.process_time() - start)
    direct = np.zeros_like(weighed)
    if not described["covered"]:
        for still in range(described["stills"]):
            scene = _scene_of(described, folder, still, False)
            direct += _rendered(scene, integrator, particles, seed + still) / described["stills"]
    np.savez_compressed(folder / "stills.npz", pictures=pictures, seconds=seconds, direct=direct)


def _rendered(scene: mi.Scene, integrator: mi.Integrator, particles: int, seed: int) -> np.ndarray:
    """One still, first channel, shape [height, width]."""
    return np.array(mi.render(scene, integrator=integrator, spp=particles, seed=seed))[:, :, 0].astype(np.float64)


def _scene_of(described: dict, folder: Path, still: int, clear: bool) -> mi.Scene:
    """One still of what ``scene.json`` describes; all that refracts is black where it is not ``clear``."""
    world = {"type": "scene"}
    for name, mesh in described["meshes"].items():
        bsdf: dict = {"type": "diffuse", "reflectance": mesh["albedo"]}
        if mesh["ior"]:
            bsdf = {"type": "dielectric", "int_ior": mesh["ior"], "ext_ior": 1.0}
            if not clear:
                bsdf = {"type": "twosided", "inner": {"type": "diffuse", "reflectance": 0.0}}
        file = folder / (f"{name}.{still}.ply" if mesh["moves"] else f"{name}.ply")
        world[name] = {"type": "ply", "filename": str(file), "bsdf": bsdf, "face_normals": mesh["flat"]}
    for number, lamp in enumerate(described["lamps"]):
        to_world = mi.ScalarTransform4f().look_at(origin=lamp["eye"], target=lamp["target"], up=lamp["up"])
        if "degrees" in lamp:
            beam = 0.9999 * lamp["degrees"]
            emitter = {"type": "spot", "to_world": to_world, "cutoff_angle": lamp["degrees"], "beam_width": beam}
            world[f"lamp{number}"] = emitter | {"intensity": lamp["power"]}
        else:
            sides = mi.ScalarTransform4f().scale([lamp["half"][0], lamp["half"][1], 1.0])
            emitter = {"type": "directionalarea", "radiance": lamp["power"]}
            world[f"lamp{number}"] = {"type": "rectangle", "to_world": to_world @ sides, "emitter": emitter}
    eye = described["eye"]
    world["camera"] = {
        "type": "perspective",
        "fov": described["degrees"],
        "fov_axis": "x",
        "to_world": mi.ScalarTransform4f().look_at(origin=eye, target=[eye[0], eye[1], 0.0], up=[0.0, 1.0, 0.0]),
        "near_clip": 1e-3,
        "film": {
            "type": "hdrfilm",
            "width": described["width"],
            "height": described["height"],
            "rfilter": {"type": "box"},
            "pixel_format": "rgb",
        },
    }
    return mi.load_dict(world)


if __name__ == "__main__":
    main()
