"""Scenes on the device: what a scene has in common with the one before is not packed again."""

import numpy as np
import pytest

from tests.usd.stages import SmallStage
from tpdwarp.device import Launcher
from tpdwarp.scene.description import Shutter
from tpdwarp.scene.device import geometry
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


CORNERS = (np.arange(19)[:, None] * 20 + np.arange(19)).ravel()
QUADS = np.stack([CORNERS, CORNERS + 20, CORNERS + 21, CORNERS + 1], axis=1)
GRID = {"counts": (4,) * len(QUADS), "indices": QUADS.ravel().tolist()}


def grid_at_three_times() -> dict[float, np.ndarray]:
    """Points of a sheet that is raised, and then thrown together."""
    u, v = np.meshgrid(np.arange(20.0), np.arange(20.0), indexing="ij")
    points = np.stack([u, v, 0 * u], axis=-1).reshape(-1, 3)
    return {1: points, 2: points + np.array([0, 0, 1]), 3: np.random.default_rng(0).permutation(points)}


def test_a_large_tree_is_kept_from_frame_to_frame_until_its_boxes_have_grown(tmp_path, monkeypatch):
    monkeypatch.setattr("tpdwarp.scene.device.geometry.SHARED_FROM", 1)
    small = SmallStage(tmp_path)
    small.moving("/Mesh", grid_at_three_times(), **GRID)
    loader = SceneLoader(small.open(), Launcher("cpu", 1))
    first, second, third = (loader.load(Shutter.still(frame)).geometry for frame in (1, 2, 3))
    assert second.trees is first.trees
    assert third.trees is not second.trees and third.trees.grown == 1.0


def test_points_of_what_stays_the_same_are_those_that_were_packed(moving, monkeypatch):
    small, points = moving
    small.moving("/Mesh", points, counts=(4,), indices=(0, 1, 2, 3))
    small.mesh("/Still", points[1] - [0, 0, 3], counts=(4,), indices=(0, 1, 2, 3))
    loader = SceneLoader(small.open(), Launcher("cpu", 1))
    first = loader.load(Shutter.still(2))
    packed = []
    points_of = type(loader.normalization).points
    monkeypatch.setattr(
        type(loader.normalization), "points", lambda of, given: (packed.append(len(given)), points_of(of, given))[1]
    )
    second = loader.load(Shutter.still(4), beside=first)
    # Four points of the mesh that moves, and the boxes of both.
    assert sorted(packed) == [4, 4]
    np.testing.assert_array_equal(second.geometry.vertices[4:], first.geometry.vertices[4:])
    assert not np.array_equal(second.geometry.vertices[:4], first.geometry.vertices[:4])


def test_a_small_tree_is_made_like_that_of_the_scene_before_until_its_boxes_would_be_large(tmp_path, monkeypatch):
    built = []
    trees_of = geometry._trees
    monkeypatch.setattr(geometry, "_trees", lambda *given: (built.append(1), trees_of(*given))[1])
    small = SmallStage(tmp_path)
    small.moving("/Mesh", grid_at_three_times(), **GRID)
    loader = SceneLoader(small.open(), Launcher("cpu", 1))
    first = loader.load(Shutter.still(1))
    second = loader.load(Shutter.still(2), beside=first)
    assert len(built) == 1 and second.geometry.trees is not first.geometry.trees
    # Both stay good.
    assert first.geometry.surfaces.points.numpy()[:, 2].max() < second.geometry.surfaces.points.numpy()[:, 2].min()
    third = loader.load(Shutter.still(3))
    assert len(built) == 2 and third.geometry.trees.grown == 1.0
