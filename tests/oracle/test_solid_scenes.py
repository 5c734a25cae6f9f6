"""The scenes of solids: stages hold what the oracle traces, and kept truths belong to them."""

import math

import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdLux

from usd_scenes.brute_force.description import DIELECTRIC, DIFFUSE
from usd_scenes.kept_truths import FOLDER, kept_truth
from usd_scenes.solids import SCENES, write
from usd_scenes.stage import BULB_RADIUS, CAMERA, FRAME


@pytest.mark.parametrize("name", SCENES)
def test_a_stage_holds_the_vertices_and_lights_of_the_oracle_to_the_last_bit(name, tmp_path):
    scene, stage = SCENES[name](), Usd.Stage.Open(str(write(name, tmp_path)))
    for mesh in scene.meshes:
        prim = UsdGeom.Mesh.Get(stage, mesh.name)
        assert set(prim.GetFaceVertexCountsAttr().Get()) == {3}
        np.testing.assert_array_equal(np.reshape(prim.GetFaceVertexIndicesAttr().Get(), (-1, 3)), mesh.triangles)
        for step in range(2):
            np.testing.assert_array_equal(prim.GetPointsAttr().Get(FRAME + step), mesh.points[step])
            normals = prim.GetNormalsAttr().Get(FRAME + step)
            assert (normals is None) == (mesh.normals is None)
            if mesh.normals is not None:
                np.testing.assert_array_equal(normals, mesh.normals[step])
        middle = 0.5 * (mesh.points[0].astype(float) + mesh.points[1])
        np.testing.assert_allclose(prim.GetPointsAttr().Get(FRAME + 0.5), middle, atol=1e-6)
    for light in scene.lights:
        api = UsdLux.LightAPI(stage.GetPrimAtPath(light.name))
        matrix = np.array(UsdGeom.Xformable(api).ComputeLocalToWorldTransform(FRAME + 0.5))
        if light.direction is not None:
            np.testing.assert_allclose(-matrix[2, :3], light.direction, atol=1e-12)
            assert api.GetIntensityAttr().Get() == light.power
        else:
            np.testing.assert_allclose(matrix[3, :3], 0.5 * (light.position[0] + light.position[1]), atol=1e-12)
            assert api.GetIntensityAttr().Get() * math.pi * BULB_RADIUS**2 == pytest.approx(light.power, rel=1e-6)
    camera = UsdGeom.Camera.Get(stage, CAMERA)
    for step in range(2):
        view = camera.GetCamera(FRAME + step)
        np.testing.assert_allclose(view.transform.ExtractTranslation(), scene.camera.position[step], atol=1e-12)
        assert view.frustum.window.GetSize()[0] == pytest.approx(scene.camera.size, rel=1e-6)


@pytest.mark.parametrize("name", SCENES)
def test_glass_is_closed_or_open_upwards_and_normals_point_out_of_it(name):
    for mesh in SCENES[name]().meshes:
        a, b, c = (mesh.points[0].astype(float)[mesh.triangles[:, k]] for k in range(3))
        areas = 0.5 * np.cross(b - a, c - a)
        if mesh.normals is not None:
            assert (np.einsum("mi,mki->mk", areas, mesh.normals[0][mesh.triangles]) > 0).all()
        if mesh.interaction != DIELECTRIC:
            continue
        if mesh.name.endswith("Water"):
            assert (areas[:, 2] > 0).all()
        else:
            np.testing.assert_allclose(areas.sum(axis=0), 0.0, atol=1e-6)
            assert np.sum(areas * a) > 0


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.npz")), ids=lambda path: path.stem)
def test_a_kept_truth_belongs_to_its_scene_and_accounts_for_its_light(path):
    scene = SCENES[path.stem]()
    truth = kept_truth(scene)
    assert truth.irradiance.shape == truth.mask.shape == (scene.camera.height, scene.camera.width)
    assert truth.mask.mean() > 0.5 and truth.irradiance[truth.mask].mean() > 0
    energy = dict(truth.energy)
    receivers = {mesh.name for mesh in scene.meshes if mesh.interaction == DIFFUSE}
    assert receivers >= set(energy) - {"sent", "direct", "escaped", "absorbed", "lost", "roulette"}
    came, _ = energy.pop("sent") + energy.pop("roulette"), energy.pop("direct")
    assert sum(energy.values()) == pytest.approx(came, rel=1e-9)
    # No picture holds more light than has landed.
    seen = truth.irradiance[truth.mask].sum() * scene.camera.pixel**2
    assert seen <= sum(energy.get(name, 0.0) for name in receivers) * 1.001
