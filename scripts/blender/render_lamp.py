#!/usr/bin/env python3
"""Renders what ``scripts/mitsuba/side_by_side.py`` has written into a folder with Cycles, and notes the CPU time.

    PYTHON scripts/blender/render_lamp.py FOLDER SAMPLES

PYTHON is one that has Blender (pip install bpy), SAMPLES a multiple of those below. ``cycles.npz`` gets the picture and
its CPU seconds. Light is neither clamped nor made smoother, and both kinds of caustics are on.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import bpy
import mathutils
import numpy as np

# Samples a pixel.
SAMPLES = 1 << 11
DEPTH = 24


def main() -> None:
    """Renders the picture."""
    folder, multiple = Path(sys.argv[1]), float(sys.argv[2])
    bpy.ops.wm.read_factory_settings(use_empty=True)
    described = json.loads((folder / "scene.json").read_text())
    for name, ior in described["meshes"].items():
        _add(name, *_read_ply(folder / f"{name}.ply"), _glass(ior) if ior else _matte(described["albedo"]))
    _add_lamp(described["lamp"])
    _add_camera(described["camera"])
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("Black")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.0
    scene.render.engine, cycles = "CYCLES", scene.cycles
    cycles.device = "CPU"
    scene.render.threads_mode, scene.render.threads = "FIXED", 1
    cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising = int(SAMPLES * multiple), False, False
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = cycles.transmission_bounces = DEPTH
    cycles.caustics_reflective = cycles.caustics_refractive = True
    cycles.blur_glossy, cycles.sample_clamp_direct, cycles.sample_clamp_indirect = 0.0, 0.0, 0.0
    cycles.pixel_filter_type = "BOX"
    scene.render.resolution_x = scene.render.resolution_y = described["camera"]["pixels"]
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.render.filepath = str(folder / "cycles.exr")
    start = time.process_time()
    bpy.ops.render.render(write_still=True)
    seconds = time.process_time() - start
    image = bpy.data.images.load(scene.render.filepath)
    image.colorspace_settings.name = "Non-Color"
    pixels = np.array(image.pixels[:]).reshape(image.size[1], image.size[0], -1)[::-1, :, 0]
    np.savez_compressed(folder / "cycles.npz", **{"Cycles": pixels, "Cycles_seconds": np.array(seconds)})


def _read_ply(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Corners of triangles and their normals, each [3 n, 3]."""
    header, body = path.read_bytes().split(b"end_header\n", 1)
    count = int(header.split(b"element vertex ")[1].split()[0])
    values = np.frombuffer(body, "<f4", 6 * count).reshape(count, 6)
    return values[:, :3], values[:, 3:]


def _add(name: str, points: np.ndarray, normals: np.ndarray, material: bpy.types.Material) -> None:
    mesh = bpy.data.meshes.new(name)
    # Corners that are one vertex are welded, as a closed surface has them.
    unique, corners = np.unique(points, axis=0, return_inverse=True)
    mesh.from_pydata(unique.tolist(), [], corners.reshape(-1, 3).tolist())
    mesh.materials.append(material)
    mesh.shade_smooth()
    mesh.normals_split_custom_set(normals.tolist())
    bpy.context.collection.objects.link(bpy.data.objects.new(name, mesh))


def _material(name: str, kind: str) -> tuple[bpy.types.Material, bpy.types.Node]:
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    output, shader = nodes.new("ShaderNodeOutputMaterial"), nodes.new(kind)
    links.new(shader.outputs[0], output.inputs["Surface"])
    return material, shader


def _glass(ior: float) -> bpy.types.Material:
    material, shader = _material("Glass", "ShaderNodeBsdfGlass")
    shader.inputs["Roughness"].default_value, shader.inputs["IOR"].default_value = 0.0, ior
    return material


def _matte(albedo: float) -> bpy.types.Material:
    material, shader = _material("Matte", "ShaderNodeBsdfDiffuse")
    shader.inputs["Color"].default_value = (albedo,) * 3 + (1.0,)
    return material


def _add_lamp(lamp: dict) -> None:
    """A plane that shines to both sides: nothing lies behind it."""
    material, shader = _material("Lamp", "ShaderNodeEmission")
    shader.inputs["Strength"].default_value = lamp["radiance"]
    x, y = 0.5 * lamp["width"], 0.5 * lamp["height"]
    mesh = bpy.data.meshes.new("Lamp")
    mesh.from_pydata([(-x, -y, 0), (x, -y, 0), (x, y, 0), (-x, y, 0)], [], [(0, 1, 2, 3)])
    mesh.materials.append(material)
    placed = bpy.data.objects.new("Lamp", mesh)
    placed.matrix_world = mathutils.Matrix(lamp["to_world"])
    bpy.context.collection.objects.link(placed)


def _add_camera(camera: dict) -> None:
    """It looks straight down, with y upwards."""
    data = bpy.data.cameras.new("Camera")
    data.angle = np.radians(camera["degrees"])
    placed = bpy.data.objects.new("Camera", data)
    placed.location = camera["eye"]
    bpy.context.collection.objects.link(placed)
    bpy.context.scene.camera = placed


if __name__ == "__main__":
    main()
