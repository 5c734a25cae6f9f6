"""Faces on the device: numbered through all meshes, and known again while only points move."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from tpdwarp.device import Launcher
from tpdwarp.scene.description import Interaction, Material, MeshAtShutter
from tpdwarp.scene.device.faces import faces_of, placed

DIFFUSE = Material()
GLASS = Material(Interaction.DIELECTRIC, path="/Glass")
LAUNCHER = Launcher("cpu", 1)


def two(copies=()):
    points = np.random.default_rng(0).normal(size=(4, 3))
    triangles = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    plain = MeshAtShutter("/Plain", points, triangles, materials=(DIFFUSE,))
    shaded = MeshAtShutter(
        "/Shaded", points, triangles, normals=np.eye(3), normal_indices=np.array([[0, 1, 2], [-1, -1, -1]], np.int32),
        materials=(GLASS, DIFFUSE), triangle_materials=np.array([1, 0], np.int32),
        colors=np.ones((2, 3)), color_indices=np.array([[0, 1, 0], [1, 1, -1]], np.int32), copies=copies,
    )  # fmt: skip
    return shaded, plain, shaded


def test_numbers_go_on_from_mesh_to_mesh_and_what_is_none_stays_none():
    faces = faces_of(two(), LAUNCHER)
    corners = np.array([[0, 1, 2], [0, 2, 3]])
    np.testing.assert_array_equal(faces.triangles.numpy(), np.concatenate([corners, corners + 4, corners + 8]))
    none = [-1, -1, -1]
    assert faces.normal_indices.numpy().tolist() == [[0, 1, 2], none, none, none, [3, 4, 5], none]
    assert faces.color_indices.numpy().tolist() == [[0, 1, 0], [1, 1, -1], none, none, [2, 3, 2], [3, 3, -1]]
    assert [faces.materials[k].path for k in faces.material_of.numpy()] == ["", "/Glass", "", "", "", "/Glass"]
    assert faces.object_of.numpy().tolist() == [0, 0, 1, 1, 2, 2] and faces.object_count == 3
    assert faces.diffuse.tolist() == [1, 0, 1, 1, 1, 0] and len(faces.colors) == 4
    assert faces_of(two(("/A", "/B")), LAUNCHER).object_of.numpy().tolist() == [0, 1, 2, 2, 3, 4]


def test_faces_are_known_again_where_points_move_and_not_where_anything_else_changes():
    meshes = two()
    faces = faces_of(meshes, LAUNCHER)
    assert faces.of(meshes)
    moved = replace(meshes[1], points=meshes[1].points + 1.0, motions=np.ones((4, 3)))
    assert faces.of((meshes[0], moved, meshes[2]))
    assert not faces.of(meshes[:2]) and not faces.of((meshes[1], meshes[0], meshes[2]))


@pytest.mark.parametrize(
    "change",
    [
        {"triangles": np.array([[0, 2, 1], [0, 2, 3]], np.int32)},
        {"points": np.zeros((5, 3))},
        {"normals": np.eye(3)[:2]},
        {"normals": None, "normal_indices": None},
        {"colors": np.zeros((2, 3))},
        {"triangle_materials": np.array([0, 0], np.int32)},
        {"materials": (DIFFUSE, DIFFUSE)},
        {"copies": ("/A", "/B")},
    ],
)
def test_whatever_is_packed_with_faces_makes_other_faces(change):
    meshes = two()
    assert not faces_of(meshes, LAUNCHER).of((*meshes[:2], replace(meshes[2], **change)))


def test_what_does_not_move_has_motions_of_zero_among_what_does():
    moves = np.random.default_rng(1).normal(size=(3, 3))
    found = placed([None, moves, None], [2, 3, 1], 0.1)
    expected = np.concatenate([np.zeros((2, 3)), moves * 0.1, np.zeros((1, 3))]).astype(np.float32)
    np.testing.assert_array_equal(found, expected)
    assert found.dtype == np.float32 and placed([], [], 1.0).shape == (0, 3)


def test_packing_holds_little_more_than_what_is_packed():
    count = 200_000
    triangles = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    mesh = MeshAtShutter("/Many", np.zeros((3 * count, 3)), triangles, copies=tuple(map(str, range(100))))
    few = MeshAtShutter("/Few", np.zeros((3, 3)), triangles[:1])
    faces_of((few,), LAUNCHER)
    tracemalloc.start()
    faces = faces_of((few, mesh), LAUNCHER)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    names = ("triangles", "normal_indices", "color_indices", "material_of", "object_of")
    assert peak < 1.1 * sum(getattr(faces, name).numpy().nbytes for name in names)
