#!/usr/bin/env python3
"""Renders what ``side_by_side.py`` has written into a folder with Mitsuba 3, and notes the CPU time.

    PYTHON scripts/mitsuba/render.py FOLDER SAMPLES

PYTHON is one that has Mitsuba (pip install mitsuba), SAMPLES a multiple of those below. ``mitsuba.npz`` gets the
picture of each integrator and its CPU seconds: ``ptracer`` traces particles from the lamp, ``path`` paths from the
camera.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import mitsuba as mi
import numpy as np

# Samples a pixel.
SAMPLES = {"ptracer": 1 << 12, "path": 1 << 11}
DEPTH = 24


def main() -> None:
    """Renders both integrators."""
    # Dr.Jit's kernels need a newer LLVM than some systems have.
    mi.set_variant("scalar_rgb")
    folder, multiple = Path(sys.argv[1]), float(sys.argv[2])
    scene = scene_of(json.loads((folder / "scene.json").read_text()), folder)
    found: dict[str, np.ndarray] = {}
    for name, samples in SAMPLES.items():
        integrator = mi.load_dict({"type": name, "max_depth": DEPTH})
        start = time.process_time()
        found[f"Mitsuba {name}"] = rendered(scene, integrator, int(samples * multiple), 1)
        found[f"Mitsuba {name}_seconds"] = np.array(time.process_time() - start)
    np.savez_compressed(folder / "mitsuba.npz", **found)


def rendered(scene: mi.Scene, integrator: mi.Integrator, samples: int, seed: int) -> np.ndarray:
    """One picture, first channel, shape [height, width]."""
    return np.array(mi.render(scene, integrator=integrator, spp=samples, seed=seed))[:, :, 0]


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
