#!/usr/bin/env python3
"""Renders what ``side_by_side.py`` has written into a folder with Mitsuba 3, and notes the CPU time.

    PYTHON scripts/mitsuba/render.py FOLDER

PYTHON is one that has Mitsuba (pip install mitsuba). ``pictures.npz`` gets two pictures of each integrator that differ
by their seed alone, so that their difference tells the noise, and their CPU seconds: ``ptracer`` traces particles from
the lamp, ``path`` paths from the camera. Kernels are compiled by a picture that is not timed.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import drjit
import mitsuba as mi
import numpy as np

# Samples a pixel of each of the two pictures.
SAMPLES = {"ptracer": 1 << 12, "path": 1 << 11}
DEPTH = 24


def main() -> None:
    """Renders both integrators."""
    mi.set_variant("llvm_ad_rgb")
    folder = Path(sys.argv[1])
    scene = scene_of(json.loads((folder / "scene.json").read_text()), folder)
    found: dict[str, np.ndarray] = {}
    for name, samples in SAMPLES.items():
        integrator = mi.load_dict({"type": name, "max_depth": DEPTH})
        rendered(scene, integrator, samples, 0)
        start = time.process_time()
        found[name] = np.stack([rendered(scene, integrator, samples, seed) for seed in (1, 2)])
        found[f"{name}_seconds"] = np.array(0.5 * (time.process_time() - start))
    np.savez_compressed(folder / "pictures.npz", **found)


def rendered(scene: mi.Scene, integrator: mi.Integrator, samples: int, seed: int) -> np.ndarray:
    """One picture, first channel, shape [height, width]."""
    image = mi.render(scene, integrator=integrator, spp=samples, seed=seed)
    drjit.eval(image)
    return np.array(image)[:, :, 0]


def scene_of(described: dict, folder: Path) -> mi.Scene:
    """The scene that ``scene.json`` describes."""
    world = {"type": "scene"}
    for name, ior in described["meshes"].items():
        bsdf: dict = {"type": "twosided", "inner": {"type": "diffuse", "reflectance": described["albedo"]}}
        if ior:
            bsdf = {"type": "dielectric", "int_ior": ior, "ext_ior": 1.0}
        world[name] = {"type": "ply", "filename": str(folder / f"{name}.ply"), "bsdf": bsdf}
    lamp = described["lamp"]
    # Mitsuba's rectangle goes from −1 to 1 and faces +z, USD's shines along −z.
    to_world = mi.ScalarTransform4f(lamp["to_world"]) @ mi.ScalarTransform4f().rotate([0, 1, 0], 180)
    to_world = to_world @ mi.ScalarTransform4f().scale([0.5 * lamp["width"], 0.5 * lamp["height"], 1])
    world["lamp"] = {
        "type": "rectangle",
        "to_world": to_world,
        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [lamp["radiance"]] * 3}},
    }
    camera = described["camera"]
    world["camera"] = {
        "type": "perspective",
        "fov": camera["degrees"],
        "to_world": mi.ScalarTransform4f().look_at(
            origin=camera["eye"], target=camera["target"], up=camera["up"]
        ),
        "film": {
            "type": "hdrfilm",
            "width": camera["pixels"],
            "height": camera["pixels"],
            "rfilter": {"type": "box"},
            "pixel_format": "rgb",
        },
    }
    return mi.load_dict(world)


if __name__ == "__main__":
    main()
