"""Shutters, and what meshes and lights say about themselves."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from tests.photons.shapes import DIFFUSE, MIRROR, floor, glass, moving
from tests.photons.traced import axes_along, lamp, sun, turning_sun
from tpdwarp.scene.description import CameraAtShutter, EmissionProfile, Extent, ExtentShape, Shaping, Shutter


@pytest.mark.parametrize("shutter", [Shutter(3, 3, 4), Shutter(3, 2.75, 3.25), Shutter(3, 2, 3)])
def test_segments_cut_the_shutter_without_gap_or_overlap(shutter):
    parts = shutter.segments(4)
    assert [part.frame for part in parts] == [3] * 4
    assert parts[0].open == shutter.open and parts[-1].close == pytest.approx(shutter.close, abs=1e-15)
    assert all(a.close == b.open for a, b in itertools.pairwise(parts))
    assert [part.exposure for part in parts] == pytest.approx([shutter.exposure / 4] * 4)
    assert np.mean([part.middle for part in parts]) == pytest.approx(shutter.middle)


def test_one_segment_is_the_shutter_itself():
    assert Shutter(3, 2.9, 3.3).segments(1) == [Shutter(3, 2.9, 3.3)]


def test_a_still_has_no_duration():
    still = Shutter.still(7.5)
    assert (still.frame, still.middle, still.exposure) == (7.5, 7.5, 0)


def test_a_mesh_is_specular_where_any_of_its_materials_is():
    assert floor(material=glass()).specular and floor(material=MIRROR).specular and not floor().specular
    assert replace(floor(), materials=(DIFFUSE, MIRROR)).specular


def test_a_mesh_moves_where_it_has_motions():
    assert not floor().moves and moving(floor(), (0.1, 0, 0)).moves


def test_lights_move_by_what_changes_their_rays():
    assert not sun().moves and not lamp((0, 0, 1)).moves
    assert lamp((0, 0, 1), (0.1, 0, 0)).moves and turning_sun((0, 0.1, -1), (0, 0.2, -1)).moves
    # A point shines alike all around, so that turning it changes nothing.
    turning = replace(lamp((0, 0, 1)), axes_motion=np.full((3, 3), 0.1))
    assert not turning.moves
    # A cone or a flat surface does not, and what grows moves in its place.
    assert replace(turning, shaping=Shaping(0.5)).moves and replace(turning, profile=EmissionProfile.COSINE).moves
    panel = Extent(ExtentShape.RECT, 0.0, np.eye(3)[:2], 0.1 * np.eye(3)[:2])
    assert replace(lamp((0, 0, 1)), extent=panel).moves


def test_a_camera_moves_by_its_place_or_its_axes():
    camera = CameraAtShutter("/camera", False, np.zeros(3), axes_along((0, 0, -1)), (-1, 1, -1, 1))
    assert not camera.moves
    assert replace(camera, position_motion=np.array([0, 0, 0.1])).moves
    assert replace(camera, axes_motion=np.full((3, 3), 0.1)).moves
