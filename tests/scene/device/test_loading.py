"""Scenes on the device: what a scene has in common with the one before is not packed again."""

import numpy as np
import pytest

from tests.usd.stages import SmallStage
from tpdwarp.device import Launcher
from tpdwarp.scene.description import Shutter
from tpdwarp.scene.device.loading import SceneLoader


@pytest.fixture
def moving(tmp_path):
    small = SmallStage(tmp_path)
    points = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], float)
    return small, {time: points + np.array([0, 0, time]) for time in (1, 5)}


def faces(small, frames):
    loader = SceneLoader(small.open(), Launcher("cpu", 1))
    return [loader.load(Shutter(frame, frame - 0.25, frame + 0.25)).geometry for frame in frames]


def test_faces_that_stay_the_same_are_packed_once_for_frames_that_follow_each_other(moving):
    small, points = moving
    small.moving("/Mesh", points, counts=(4,), indices=(0, 1, 2, 3))
    first, second = faces(small, (2, 4))
    assert second.faces is first.faces
    # The stage's unit is the tracer's times a scale: between the frames it rose by two.
    heights = [geometry.surfaces.points.numpy()[:, 2] for geometry in (first, second)]
    side = np.ptp(first.surfaces.points.numpy()[:, 0])
    np.testing.assert_allclose(heights[1] - heights[0], 2.0 * side, rtol=1e-5)


def test_faces_that_change_are_packed_anew(moving):
    small, points = moving
    mesh = small.moving("/Mesh", points, counts=(4,), indices=(0, 1, 2, 3))
    mesh.GetFaceVertexIndicesAttr().Set([0, 1, 2, 3], 1)
    mesh.GetFaceVertexIndicesAttr().Set([3, 2, 1, 0], 4)
    first, second = faces(small, (2, 5))
    assert second.faces is not first.faces
    assert not np.array_equal(first.faces.triangles.numpy(), second.faces.triangles.numpy())
