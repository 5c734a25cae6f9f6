#!/usr/bin/env python3
"""Scenes as people build them in Blender: exported to USD, and rendered by Cycles without and with caustics.

    python -m venv /tmp/blender && /tmp/blender/bin/pip install bpy==5.0.1
    /tmp/blender/bin/python scripts/blender/exports.py FOLDER [ocean monkey gobo area]

It needs Python 3.11 and the ``bpy`` wheel, which is no dependency of this project. FOLDER then holds a folder for each
scene, with ``scene.usda``, ``plain.exr`` and ``caustics_1.exr`` …, each of other random numbers;
``scripts/blender/compare_exports.py`` renders the scenes here and says how the light compares.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Callable

import bpy

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from caustics_pass import material, named, placed, set_up_cycles

# Dark, so that next to no light goes from the floor through glass to the floor again, which is not rendered here.
GREY = (0.05, 0.05, 0.05)
# Cycles finds light through glass by chance alone, and small lamps hardly ever.
SUN_ANGLE = math.radians(8.0)


def ocean() -> None:
    """Blender's ocean as a slab of glass over a floor, under the sun.

    A sheet alone would not compare: Cycles leaves out by how much radiance changes in water, which cancels behind it.
    """
    bpy.ops.mesh.primitive_plane_add(size=8)
    named("Floor", material("Floor", GREY, 0.0))
    # Aside, so that the camera also sees floor in the sun.
    bpy.ops.mesh.primitive_plane_add(size=1, location=(0, 1.0, 2.0))
    named("Water", material("Water", (1.0, 1.0, 1.0), 1.0))
    waves = bpy.context.object.modifiers.new("Ocean", "OCEAN")
    waves.geometry_mode, waves.resolution, waves.spatial_size = "GENERATE", 8, 6
    waves.size, waves.wave_scale, waves.choppiness = 1.0, 0.5, 0.0
    slab = bpy.context.object.modifiers.new("Solidify", "SOLIDIFY")
    slab.thickness = 0.3
    sun((0.4, 0.2))
    looking_down(0.0, 0.0, 2.25)


def monkey() -> None:
    """A head of glass, smoothed by subdivision, over a floor under the sun."""
    bpy.ops.mesh.primitive_plane_add(size=8)
    named("Floor", material("Floor", GREY, 0.0))
    bpy.ops.mesh.primitive_monkey_add(size=1.4, location=(0, 0, 2.0), rotation=(0.3, 0, 0.4))
    named("Head", material("Glass", (1.0, 1.0, 1.0), 1.0))
    smooth = bpy.context.object.modifiers.new("Subdivision", "SUBSURF")
    smooth.levels = smooth.render_levels = 3
    sun((0.5, 0.3))
    looking_down(-0.55, 0.95, 1.2)


def gobo() -> None:
    """A ball of glass in the light of a sun that shines through a lattice.

    Its light, as the head's, falls on little of the floor, and Cycles meets the sun through glass so seldom that the
    camera sees no more of the floor than that.
    """
    bpy.ops.mesh.primitive_plane_add(size=8)
    named("Floor", material("Floor", GREY, 0.0))
    bpy.ops.mesh.primitive_grid_add(size=3, x_subdivisions=6, y_subdivisions=6, location=(0, 0, 3.2))
    named("Lattice", material("Wood", (0.1, 0.1, 0.1), 0.0), smooth=False)
    bars = bpy.context.object.modifiers.new("Wireframe", "WIREFRAME")
    bars.thickness = 0.15
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.6, segments=96, ring_count=48, location=(0, 0, 1.9))
    named("Ball", material("Glass", (1.0, 1.0, 1.0), 1.0))
    sun((0.0, 0.2))
    looking_down(-0.35, 0.0, 1.0)


def area() -> None:
    """A ring of glass under a rectangular lamp."""
    bpy.ops.mesh.primitive_plane_add(size=8)
    named("Floor", material("Floor", GREY, 0.0))
    ring = {"major_radius": 0.6, "minor_radius": 0.2, "major_segments": 96, "minor_segments": 48}
    bpy.ops.mesh.primitive_torus_add(**ring, location=(0, 0, 1.8), rotation=(0.5, 0.4, 0))
    named("Ring", material("Glass", (1.0, 1.0, 1.0), 1.0))
    light = bpy.data.lights.new("Lamp", "AREA")
    light.shape, light.size, light.size_y, light.energy = "RECTANGLE", 1.0, 0.5, 300.0
    lamp = placed("Lamp", light, (0.5, -0.4, 4.0))
    lamp.rotation_euler = (math.radians(10), math.radians(8), 0)
    looking_down(0.0, 0.0, 2.25)


SCENES: dict[str, Callable[[], None]] = {"ocean": ocean, "monkey": monkey, "gobo": gobo, "area": area}


def main() -> None:
    """Builds, exports and renders."""
    parser = argparse.ArgumentParser(description="Exports scenes from Blender and renders them with Cycles.")
    parser.add_argument("folder", help="where to")
    parser.add_argument("scenes", nargs="*", default=list(SCENES), help=", ".join(SCENES))
    parser.add_argument("--samples", type=int, default=2048, help="of each render with caustics [2048]")
    parser.add_argument("--renders", type=int, default=8, help="with caustics [8]")
    parser.add_argument("--width", type=int, default=96, help="pixels [96]")
    parser.add_argument("--threads", type=int, default=0, help="of Cycles [all]")
    options = parser.parse_args()
    for name in options.scenes:
        folder = os.path.join(options.folder, name)
        os.makedirs(folder, exist_ok=True)
        bpy.ops.wm.read_factory_settings(use_empty=True)
        SCENES[name]()
        scene = bpy.context.scene
        scene.render.resolution_x = scene.render.resolution_y = options.width
        if options.threads:
            scene.render.threads_mode, scene.render.threads = "FIXED", options.threads
        bpy.ops.wm.usd_export(filepath=f"{folder}/scene.usda", generate_materialx_network=True)
        set_up_cycles(scene)
        # Wider filters carry light across the picture's edge.
        scene.cycles.pixel_filter_type = "BOX"
        pictures = [("plain", False, options.samples // 4)]
        pictures += [(f"caustics_{seed}", True, options.samples) for seed in range(1, options.renders + 1)]
        for seed, (picture, caustics, samples) in enumerate(pictures):
            scene.cycles.caustics_reflective = scene.cycles.caustics_refractive = caustics
            scene.cycles.samples, scene.cycles.seed = samples, seed
            scene.render.filepath = f"{folder}/{picture}.exr"
            bpy.ops.render.render(write_still=True)


def sun(tilt: tuple[float, float]) -> None:
    """A sun that stands upright but for turns about x and y [rad]."""
    light = bpy.data.lights.new("Sun", "SUN")
    light.energy, light.angle = 3.0, SUN_ANGLE
    placed("Sun", light, (0, 0, 5)).rotation_euler = (*tilt, 0)


def looking_down(x: float, y: float, reach: float) -> None:
    """A camera below the glass that sees the floor alone, so far to each side of a place."""
    camera = bpy.data.cameras.new("Camera")
    camera.lens = 0.5 * camera.sensor_width / reach
    bpy.context.scene.camera = placed("Camera", camera, (x, y, 1.0))


if __name__ == "__main__":
    main()
