#!/usr/bin/env python3
"""Glass on a floor under a lamp, built in Blender: exported to USD, and rendered by Cycles without and with caustics.

    python -m venv /tmp/blender && /tmp/blender/bin/pip install bpy==5.0.1
    /tmp/blender/bin/python scripts/blender/caustics_pass.py FOLDER

It needs Python 3.11 and the ``bpy`` wheel, which is no dependency of this project. FOLDER then holds ``scene.usda``,
``plain.exr`` and ``caustics.exr``; ``scripts/blender/side_by_side.py`` renders the pass and puts the three together.
"""

from __future__ import annotations

import argparse
import math

import bpy

ALBEDOS = {"Floor": (0.55, 0.5, 0.45), "Cube": (0.1, 0.25, 0.6)}
# Watts, and metres: Cycles by itself finds no lamp much smaller than that through glass.
LAMP_POWER, LAMP_RADIUS = 400.0, 0.2


def main() -> None:
    """Builds, exports and renders."""
    parser = argparse.ArgumentParser(description="Renders glass with Cycles, without and with caustics.")
    parser.add_argument("folder", help="where to")
    parser.add_argument("--samples", type=int, default=1200, help="of the render with caustics [1200]")
    parser.add_argument("--width", type=int, default=320, help="pixels [320]")
    options = parser.parse_args()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    build()
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = options.width, options.width * 5 // 8
    bpy.ops.wm.usd_export(filepath=f"{options.folder}/scene.usda", generate_materialx_network=True)
    set_up_cycles(scene)
    few = max(64, options.samples // 16)
    for name, caustics, samples in (("plain", False, few), ("caustics", True, options.samples)):
        scene.cycles.caustics_reflective = scene.cycles.caustics_refractive = caustics
        scene.cycles.samples = samples
        scene.render.filepath = f"{options.folder}/{name}.exr"
        bpy.ops.render.render(write_still=True)


def build() -> None:
    """A glass ball, a glass ring and a cube on a floor, a lamp and a camera."""
    glass = material("Glass", (1.0, 1.0, 1.0), 1.0)
    add = bpy.ops.mesh
    add.primitive_plane_add(size=8)
    named("Floor", material("Floor", ALBEDOS["Floor"], 0.0))
    add.primitive_uv_sphere_add(radius=0.6, segments=128, ring_count=64, location=(0, 0, 0.75))
    named("Ball", glass)
    ring = {"major_radius": 0.45, "minor_radius": 0.13, "major_segments": 128, "minor_segments": 48}
    add.primitive_torus_add(**ring, location=(1.35, 0.5, 0.4), rotation=(0.5, 0.4, 0))
    named("Ring", glass)
    add.primitive_cube_add(size=0.6, location=(-1.3, 0.7, 0.3), rotation=(0, 0, 0.5))
    named("Cube", material("Cube", ALBEDOS["Cube"], 0.0), smooth=False)
    light = bpy.data.lights.new("Lamp", "POINT")
    light.energy, light.shadow_soft_size = LAMP_POWER, LAMP_RADIUS
    placed("Lamp", light, (-2.2, -1.0, 3.2))
    camera = bpy.data.cameras.new("Camera")
    camera.lens = 40.0
    seen = placed("Camera", camera, (0.6, -4.6, 3.0))
    seen.rotation_euler = (math.radians(60), 0, math.radians(4))
    bpy.context.scene.camera = seen


def named(name: str, surface: bpy.types.Material, smooth: bool = True) -> None:
    """Names the object that was added last and gives it a material."""
    made = bpy.context.object
    made.name = name
    made.data.materials.append(surface)
    if smooth:
        bpy.ops.object.shade_smooth()


def placed(name: str, data: bpy.types.ID, location: tuple[float, float, float]) -> bpy.types.Object:
    """An object of that data."""
    made = bpy.data.objects.new(name, data)
    made.location = location
    bpy.context.scene.collection.objects.link(made)
    return made


def material(name: str, color: tuple[float, float, float], transmission: float) -> bpy.types.Material:
    """A Principled BSDF: smooth glass, or a diffuse surface without a highlight."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    inputs = made.node_tree.nodes["Principled BSDF"].inputs
    inputs["Base Color"].default_value = (*color, 1.0)
    inputs["IOR"].default_value = 1.45
    inputs["Transmission Weight"].default_value = transmission
    inputs["Roughness"].default_value = 1.0 - transmission
    if not transmission:
        inputs["Specular IOR Level"].default_value = 0.0
    return made


def set_up_cycles(scene: bpy.types.Scene) -> None:
    """As exact as Cycles is: nothing clamped, filtered or denoised, one diffuse bounce (which caustics take)."""
    scene.render.engine = "CYCLES"
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    cycles = scene.cycles
    cycles.use_denoising = cycles.use_adaptive_sampling = False
    cycles.max_bounces = cycles.transmission_bounces = 16
    cycles.diffuse_bounces = 1
    cycles.blur_glossy = cycles.sample_clamp_indirect = cycles.sample_clamp_direct = 0.0


if __name__ == "__main__":
    main()
