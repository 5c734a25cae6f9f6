"""Normal maps of diffuse surfaces: direct light falls by the cosine of the normal that the map makes."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.view.scenes import SHUTTER, SUN, looking_down, quad, see, turned
from tpdwarp.scene.description import Material, SceneAtShutter, Texture
from tpdwarp.scene.requirements import requirements_of

# Normals are kept in half precision.
HALF = 2.0**-10
AXES = turned((0.5, -0.3, 0.2))
SLANTED = replace(SUN, axes=AXES)
COLOR = (0.2, 0.4, 0.8)
MAPS = [(0.0, 0.0, 1.0), (0.3, 0.0, 0.9), (0.0, -0.4, 0.8), (0.2, 0.3, 0.5)]


def card(leans, st=((0, 0), (1, 0), (1, 1), (0, 1)), **change):
    """The square (−1, −1) … (1, 1) with one normal all over, in the frame of the coordinates at its corners."""
    pixels = np.broadcast_to(np.array(leans, np.float16), (2, 2, 3))
    mesh = quad("/card", (-1, -1), (1, 1), 0.0, Material(color=COLOR, normal_map=Texture({(0, 0): pixels})))
    corners = np.round((mesh.points[:, :2] + 1) / 2).astype(int)
    order = {(0, 0): 0, (1, 0): 1, (1, 1): 2, (0, 1): 3}
    coordinates = np.array([st[order[tuple(corner)]] for corner in corners.tolist()], float)
    return replace(mesh, coordinates=coordinates, coordinate_indices=mesh.triangles, **change)


def direct(mesh, camera=None):
    scene = SceneAtShutter(SHUTTER, (mesh,), (SLANTED,), camera or looking_down())
    return see(scene, 8, 8, [(4.0, 4.0)], textures=True, normal_maps=True)[0].direct[0]


def expected(normal):
    """Albedo/π times the cosine of a normal, of a sun of irradiance 1."""
    return np.array(COLOR) / math.pi * max(np.dot(normal, AXES[2]) / np.linalg.norm(normal), 0.0)


@pytest.mark.parametrize("leans", MAPS)
def test_light_falls_by_the_cosine_of_the_mapped_normal(leans):
    np.testing.assert_allclose(direct(card(leans)), expected(leans), rtol=4 * HALF)


@pytest.mark.parametrize(
    ("st", "along_s", "along_t"),
    [
        (((0, 0), (0, 1), (-1, 1), (-1, 0)), (0, -1, 0), (1, 0, 0)),
        (((1, 0), (0, 0), (0, 1), (1, 1)), (-1, 0, 0), (0, 1, 0)),
        (((0, 0), (3, 0), (3, 1), (0, 1)), (1, 0, 0), (0, 1, 0)),
    ],
    ids=["turned", "mirrored", "stretched"],
)
def test_a_map_lies_along_its_coordinates(st, along_s, along_t):
    leans = (0.2, 0.3, 0.5)
    normal = leans[0] * np.array(along_s) + leans[1] * np.array(along_t) + (0, 0, leans[2])
    np.testing.assert_allclose(direct(card(leans, st)), expected(normal), rtol=4 * HALF)


def test_a_map_leans_from_the_interpolated_normal():
    up = np.array([0.0, math.sin(0.4), math.cos(0.4)])
    smooth = card((0.0, 0.5, 0.5), normals=up[None], normal_indices=np.zeros((2, 3), np.int32))
    # t grows along y, less the part of it along the normal.
    along_t = np.array([0, 1.0, 0]) - up * up[1]
    normal = 0.5 * along_t / np.linalg.norm(along_t) + 0.5 * up
    np.testing.assert_allclose(direct(smooth), expected(normal), rtol=4 * HALF)


def test_coordinates_of_no_extent_leave_the_normal_as_it_is():
    np.testing.assert_allclose(direct(card((0.5, 0.5, 0.1), ((0, 0),) * 4)), expected((0, 0, 1)), rtol=1e-5)


def test_maps_cost_something_only_where_a_mesh_has_coordinates_for_one():
    mapped = card((0, 0, 1))
    bare = replace(mapped, coordinates=None, coordinate_indices=None)
    needs = [
        requirements_of(SceneAtShutter(SHUTTER, (mesh,), (SLANTED,), looking_down())) for mesh in (mapped, bare)
    ]
    assert [need.normal_maps for need in needs] == [need.textures for need in needs] == [True, False]
