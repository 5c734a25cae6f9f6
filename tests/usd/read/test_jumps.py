"""Held animation stands still until the next step: a shutter that closes on the step belongs to what came before."""

import numpy as np
import pytest
from pxr import Gf, Sdf, UsdGeom

from tests.usd.stages import SQUARE, SmallStage
from tpdwarp.scene.description import Shutter
from tpdwarp.usd.read.jumps import jumps_of, settled

CORNERS = np.array(SQUARE)
HAIR = 1e-3


@pytest.fixture
def small(tmp_path):
    return SmallStage(tmp_path)


def stepped(attribute, value, last=6):
    """Holds ``value(time)`` from each whole time until just before the next."""
    for time in range(1, last):
        for at in (float(time), time + 1 - HAIR):
            attribute.Set(value(time), at)


def test_jumps_are_pairs_a_hair_apart_and_not_samples_that_are_close_alike():
    assert jumps_of([1, 2 - HAIR, 2, 3 - HAIR, 3]) == [(2 - HAIR, 2), (3 - HAIR, 3)]
    assert jumps_of([0.001 * k for k in range(10)]) == []
    assert jumps_of([1, 2, 3]) == jumps_of([1, 1 + HAIR]) == jumps_of([]) == []


def test_a_shutter_ends_before_the_jump_it_closes_on_and_begins_after_the_one_it_opens_in():
    jumps = [(2 - HAIR, 2.0)]
    assert settled(Shutter(1, 1, 2), jumps) == Shutter(1, 1, 2 - HAIR)
    assert settled(Shutter(2, 2 - 0.5 * HAIR, 3), jumps) == Shutter(2, 2, 3)
    for whole in (Shutter(1, 1, 1.5), Shutter(2, 2, 3), Shutter(1, 1.5, 2.5), Shutter.still(2)):
        assert settled(whole, jumps) == whole


@pytest.mark.parametrize("motion", ["linear", "cubic"])
@pytest.mark.parametrize("what", ["transform", "points", "instances", "parent"])
def test_what_is_held_stands_still_until_the_shutter_closes(small, what, motion):
    mesh = small.mesh("/Group/Mesh", points=None if what == "points" else SQUARE)
    if what == "transform":
        stepped(mesh.AddTranslateOp().GetAttr(), lambda time: Gf.Vec3d(time, 0, 0))
    elif what == "parent":
        parent = UsdGeom.Xform.Define(small.stage, "/Group")
        stepped(parent.AddTranslateOp().GetAttr(), lambda time: Gf.Vec3d(time, 0, 0))
    elif what == "points":
        stepped(mesh.GetPointsAttr(), lambda time: [Gf.Vec3f(*map(float, p + np.array([time, 0, 0]))) for p in CORNERS])
    else:
        small.stage.GetPrimAtPath("/Group").SetSpecifier(Sdf.SpecifierClass)
        many = UsdGeom.PointInstancer.Define(small.stage, "/Many")
        many.CreatePrototypesRel().SetTargets(["/Group/Mesh"])
        many.CreateProtoIndicesAttr([0])
        stepped(many.CreatePositionsAttr(), lambda time: [Gf.Vec3f(time, 0, 0)])
    scene = small.open(motion=motion)
    for shutter in (Shutter(3, 3, 4), Shutter(3, 3, 3.5), Shutter(3, 3.875, 4)):
        (found,) = scene.at(shutter).meshes
        np.testing.assert_allclose(found.points, CORNERS + np.array([3, 0, 0]), atol=1e-6)
        assert found.motions is None or abs(found.motions).max() < 1e-6


def test_held_cameras_stand_still(small):
    small.mesh()
    camera = UsdGeom.Camera.Define(small.stage, "/Camera")
    stepped(camera.AddTranslateOp().GetAttr(), lambda time: Gf.Vec3d(time, 0, 0))
    assert not small.open().at(Shutter(3, 3, 4)).camera.moves
