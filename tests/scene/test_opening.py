"""Laws of the scene at shutter open and its forward difference."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.photons.traced import Written
from tests.view.scenes import SUN, WATER, quad
from tpdwarp.scene.description import SceneAtShutter, Shutter
from tpdwarp.scene.opening import scene_at_opening

ACCELERATION = 0.25


def falling(shutter: Shutter) -> SceneAtShutter:
    """A pane whose height is ACCELERATION · t², and a light whose position along x is."""

    def height(time: float) -> float:
        return ACCELERATION * time * time

    change = height(shutter.close) - height(shutter.open)
    motion = (0.0, 0.0, change) if shutter.exposure else None
    light = replace(
        SUN, position=np.array([height(shutter.middle), 0, 0]), position_motion=np.array([change, 0.0, 0.0])
    )
    return SceneAtShutter(shutter, (quad("/pane", (-1, -1), (1, 1), height(shutter.middle), WATER, motion),), (light,))


@pytest.mark.parametrize("exposure", [0.5, 1.0, 2.0, 4.0])
def test_the_scene_stands_at_the_opening_and_moves_on_by_the_forward_difference(exposure):
    opening, step = 3.0, min(exposure, 1.0)
    scene = scene_at_opening(Written(falling), Shutter(3, opening, opening + exposure))
    (pane,), (light,) = scene.meshes, scene.lights
    place, way = ACCELERATION * opening**2, ACCELERATION * ((opening + step) ** 2 - opening**2) * exposure / step
    np.testing.assert_allclose(pane.points[:, 2], place, rtol=1e-12)
    np.testing.assert_allclose(pane.motions[:, 2], way, rtol=1e-12)
    assert light.position[0] == pytest.approx(place) and light.position_motion[0] == pytest.approx(way)


def test_the_interval_alone_decides_whether_the_shutter_trails_or_leads():
    leading = scene_at_opening(Written(falling), Shutter(2, 2, 3)).meshes[0]
    trailing = scene_at_opening(Written(falling), Shutter(3, 2, 3)).meshes[0]
    np.testing.assert_array_equal(leading.points, trailing.points)
    np.testing.assert_array_equal(leading.motions, trailing.motions)


def test_a_still_stays_one():
    assert scene_at_opening(Written(falling), Shutter.still(2.0)).meshes[0].motions is None


def test_a_mesh_that_is_another_at_the_opening_stands_as_it_does_half_a_step_on():
    def growing(shutter: Shutter) -> SceneAtShutter:
        scene = falling(shutter)
        if shutter.exposure:
            return scene
        (pane,) = scene.meshes
        return replace(scene, meshes=(replace(pane, points=pane.points[:3], triangles=pane.triangles[:1]),))

    shutter = Shutter(3, 3, 4)
    (pane,) = scene_at_opening(Written(growing), shutter).meshes
    np.testing.assert_array_equal(pane.points, falling(shutter).meshes[0].points)
    assert pane.motions.any()
