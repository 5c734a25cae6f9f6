"""What a scene requires is what it holds, and nothing else."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np

from tests.photons.shapes import DIFFUSE, MIRROR, floor, glass, moving
from tests.photons.traced import axes_along, lamp, scene_of, sun
from tests.view.lit_by_surfaces import LIGHTS
from tpdwarp.scene.description import CameraAtShutter
from tpdwarp.scene.requirements import MOST_BOUNCES, requirements_of

CAMERA = CameraAtShutter("/camera", False, np.zeros(3), axes_along((0, 0, -1)), (-1, 1, -1, 1))


def test_a_diffuse_still_requires_nothing():
    needs = requirements_of(scene_of([floor()], sun()))
    assert not (needs.caustics or needs.refraction or needs.reflection or needs.photon_motion or needs.view_motion)
    assert needs.bounces == 0 and needs.moving_meshes == needs.moving_lights == ()


def test_materials_decide_between_refraction_and_reflection():
    water, mirror = floor(1.0, material=glass()), floor(2.0, material=MIRROR)
    cases = (([water], True, False), ([mirror], False, True), ([water, mirror], True, True))
    for meshes, refraction, reflection in cases:
        needs = requirements_of(scene_of([*meshes, floor()], sun()))
        assert (needs.refraction, needs.reflection, needs.caustics) == (refraction, reflection, True)


def test_a_material_of_a_few_triangles_counts():
    mixed = replace(floor(), materials=(DIFFUSE, MIRROR), triangle_materials=np.array([0, 1], np.int32))
    assert requirements_of(scene_of([mixed], sun())).reflection


def test_paths_are_followed_as_far_as_light_goes_or_as_is_asked():
    scene = scene_of([floor(1.0, material=glass())], sun())
    assert requirements_of(scene).bounces == MOST_BOUNCES
    assert requirements_of(scene, bounces=3).bounces == 3
    assert requirements_of(scene_of([floor()], sun()), bounces=3).bounces == 0


def test_photons_carry_time_where_a_mesh_or_a_light_moves():
    water = floor(1.0, material=glass(), path="/water")
    assert not requirements_of(scene_of([water, floor()], sun())).photon_motion
    needs = requirements_of(scene_of([moving(water, (0, 0, 0.1)), floor()], sun()))
    assert needs.photon_motion and needs.view_motion and needs.moving_meshes == ("/water",)
    needs = requirements_of(scene_of([water, floor()], lamp((0, 0, 3), (0.1, 0, 0))))
    assert needs.photon_motion and not needs.view_motion and needs.moving_lights == ("/lamp",)


def test_a_moving_camera_changes_the_view_and_not_the_photons():
    scene = scene_of([floor(1.0, material=glass()), floor()], sun())
    still, moved = CAMERA, replace(CAMERA, position_motion=np.array([0.1, 0, 0]))
    assert not requirements_of(replace(scene, camera=still)).view_motion
    needs = requirements_of(replace(scene, camera=moved))
    assert needs.moving_camera and needs.view_motion and not needs.photon_motion


def test_mirrors_look_for_lights_where_there_are_any_that_they_show():
    def needs(roughness, light):
        found = requirements_of(scene_of([floor(1.0, material=replace(MIRROR, roughness=roughness)), floor()], light))
        return found.glints, found.mirrored_lights

    panel = LIGHTS["rectangle overhead"]
    assert needs(0.0, lamp((0, 0, 3))) == (False, False)
    assert needs(0.0, panel) == (False, True)
    assert needs(0.05, lamp((0, 0, 3))) == (True, False)
    assert needs(0.05, panel) == (True, False)
    # Meshes that shine are seen themselves.
    assert needs(0.0, replace(panel, meshed=True)) == needs(0.05, replace(panel, meshed=True)) == (False, False)
    water = requirements_of(scene_of([floor(1.0, material=glass()), floor()], panel))
    assert not (water.glints or water.mirrored_lights)


def test_requirements_are_json_and_name_the_columns():
    still = requirements_of(scene_of([floor(1.0, material=glass())], sun())).as_dict()
    moved = requirements_of(scene_of([moving(floor(1.0, material=glass()), (0, 0, 1))], sun())).as_dict()
    assert json.loads(json.dumps(still))["differentials"] == ["u", "v"]
    assert json.loads(json.dumps(moved))["differentials"] == ["u", "v", "t"]
