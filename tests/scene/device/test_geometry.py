"""Meshes packed for the device: each triangle keeps its own material, object, normals, colours and motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.photons.shapes import MIRROR, ball, floor, glass, moving, ripples
from tests.photons.traced import EPS, scene_of, sun
from tpdwarp.device import Launcher
from tpdwarp.scene.description import Interaction, Material, MeshAtShutter
from tpdwarp.scene.device.geometry import Geometry, geometry_of
from tpdwarp.scene.normalization import Normalization

NORM = Normalization((0.5, 0.0, -0.25), 0.25, 1.0)
RED, BLUE = Material(color=(0.8, 0.1, 0.1), path="/red"), Material(color=(0.1, 0.1, 0.8), path="/blue")
GRID = np.linspace(-1, 1, 7)


def packed(*meshes: MeshAtShutter, with_motions: bool = False, norm: Normalization = NORM) -> Geometry:
    return geometry_of(scene_of(meshes, sun()), norm, Launcher("cpu", 1), with_motions=with_motions)


def striped() -> MeshAtShutter:
    """Two triangles: a blue one with display colours over it, and a mirroring one."""
    materials = (RED, MIRROR, BLUE)
    return replace(
        floor(0.5, 1.0, path="/striped"),
        materials=materials,
        triangle_materials=np.array([2, 1], np.int32),
        colors=np.array([[0.2, 0.3, 0.4], [0.6, 0.5, 0.4]]),
        color_indices=np.array([[0, 1, 1], [-1, -1, -1]], np.int32),
    )


def test_triangles_keep_their_materials_and_equal_materials_are_shared():
    geometry = packed(striped(), floor(1.0, material=RED), ball("/ball", (0, 0, 3), 1, 1, glass(1.33)))
    surfaces = geometry.surfaces
    material_of = surfaces.material_of.numpy()
    assert material_of[0] != material_of[1]
    assert (material_of[2:4] == 0).all() and len(set(material_of[4:])) == 1
    assert len(surfaces.ior.numpy()) == 4
    interactions = surfaces.interaction.numpy()[material_of]
    assert interactions.tolist() == [Interaction.DIFFUSE, Interaction.MIRROR] + [Interaction.DIFFUSE] * 2 + [
        Interaction.DIELECTRIC
    ] * 12
    np.testing.assert_allclose(surfaces.tint.numpy()[material_of[0]], BLUE.color, rtol=EPS)
    np.testing.assert_allclose(surfaces.ior.numpy()[material_of[4:]], 1.33, rtol=EPS)


def test_triangles_know_their_object():
    geometry = packed(floor(path="/a"), ball("/b", (0, 0, 3), 1, 1, glass()), floor(2.0, path="/c"))
    assert geometry.paths == ("/a", "/b", "/c")
    assert geometry.surfaces.object_of.numpy().tolist() == [0] * 2 + [1] * 12 + [2] * 2


def test_copies_are_objects_of_their_own():
    points = np.concatenate([floor(height).points for height in (0.0, 1.0, 2.0)])
    corners = np.concatenate([floor().triangles + 4 * k for k in range(3)])
    copies = replace(floor(path="/copies[0]"), points=points, triangles=corners, copies=("/a", "/b", "/c"))
    geometry = packed(floor(-1.0, path="/first"), copies, floor(5.0, path="/last"))
    assert geometry.paths == ("/first", "/a", "/b", "/c", "/last")
    assert geometry.surfaces.object_of.numpy().tolist() == [0, 0, 1, 1, 2, 2, 3, 3, 4, 4]


def test_indices_are_those_of_the_stacked_arrays():
    first, second = ripples(GRID, GRID, 1.0, 0.1, glass(), True), ball("/b", (0, 0, 3), 1, 2, glass())
    flat = floor(path="/flat")
    surfaces = packed(first, flat, striped(), second, with_motions=True).surfaces
    triangles, indices = surfaces.triangles.numpy(), surfaces.normal_indices.numpy()
    points, normals = surfaces.points.numpy(), surfaces.normals.numpy()
    meshes = (first, flat, striped(), second)
    corners = np.concatenate([NORM.points(m.points)[m.triangles] for m in meshes])
    np.testing.assert_array_equal(points[triangles], corners)
    expected = np.concatenate([first.normals[first.normal_indices], second.normals[second.normal_indices]])
    smooth = indices[:, 0] >= 0
    np.testing.assert_allclose(normals[indices[smooth]], expected, atol=EPS)
    assert smooth.tolist() == [True] * len(first.triangles) + [False] * 4 + [True] * len(second.triangles)
    colored = surfaces.color_indices.numpy()[:, 0] >= 0
    assert np.flatnonzero(colored).tolist() == [len(first.triangles) + 2]
    rates = surfaces.motions.numpy()
    count = len(first.triangles)
    np.testing.assert_allclose(rates[triangles][:count], 0.25 * first.motions[first.triangles], rtol=EPS)
    assert not rates[triangles][count:].any()
    turns = surfaces.normal_motions.numpy()[indices[smooth]]
    np.testing.assert_allclose(turns[:count], first.normal_motions[first.normal_indices], rtol=EPS)
    assert not turns[count:].any()


def test_a_still_scene_carries_no_motions():
    surfaces = packed(ripples(GRID, GRID, 1.0, 0.1, glass(), True)).surfaces
    assert len(surfaces.motions.numpy()) == len(surfaces.normal_motions.numpy()) == 0


def test_geometry_at_another_time_of_the_shutter_has_moved_linearly():
    launcher = Launcher("cpu", 1)
    water = ripples(GRID, GRID, 1.0, 0.1, glass(), True)
    geometry = packed(water, with_motions=True)
    later = geometry.at(0.5, launcher)
    expected = NORM.points(water.points + 0.5 * water.motions)
    np.testing.assert_allclose(later.points.numpy(), expected, atol=2 * EPS)
    assert later.time == 0.5 and geometry.surfaces.time == 0
    np.testing.assert_array_equal(geometry.surfaces.points.numpy(), NORM.points(water.points))
    back = geometry.at(0.0, launcher)
    np.testing.assert_array_equal(back.points.numpy(), NORM.points(water.points))


def test_a_still_geometry_keeps_its_points_and_its_bvh_at_every_time():
    geometry = packed(floor())
    later = geometry.at(0.5, Launcher("cpu", 1))
    assert later.tree.mesh == geometry.surfaces.tree.mesh and later.points is geometry.surfaces.points
    assert later.time == 0.5 and geometry.surfaces.time == 0


def test_meshes_that_only_a_light_moves_past_get_motions_of_zero():
    surfaces = packed(moving(floor(), (0.4, 0, 0)), floor(1.0), with_motions=True).surfaces
    np.testing.assert_allclose(surfaces.motions.numpy(), [[0.1, 0, 0]] * 4 + [[0, 0, 0]] * 4, atol=EPS)
