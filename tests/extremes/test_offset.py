"""The same scene far from the origin is the same frame."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdValidation, Vt

import tpdwarp
from tests.photons.traced import EPS, lamp
from tests.small_stage import write_stage
from tpdwarp.checks.limits import Limits
from tpdwarp.checks.photons import compare_layers
from tpdwarp.io.images import read_image
from tpdwarp.usd.read.debug_layer import DebugLayerReader

from .cases import MOTIONS, SAME, assert_same_frame, in_other_units, render

OFFSETS = [10.0, 1e3, 1e5, 1e7]


def placed(offset: float) -> np.ndarray:
    return offset * np.array([1.0, -1.0, 0.5])


@pytest.mark.parametrize("offset", OFFSETS)
@pytest.mark.parametrize("motion", MOTIONS)
def test_the_distance_from_the_origin_does_not_change_the_frame(motion, offset):
    here = MOTIONS[motion]()
    frame, far = render(here), render(in_other_units(here, offset=placed(offset)))
    assert_same_frame(far, frame)
    # Positions go out in single precision: they are as fine as that is out there.
    seen = frame.channels["A"] > 0
    for k, axis in enumerate("XYZ"):
        moved = far.channels[f"P.{axis}"].astype(float) - placed(offset)[k]
        error = np.abs(moved - frame.channels[f"P.{axis}"])[seen]
        assert error.max() <= 2 * EPS * (abs(placed(offset)[k]) + 16)


@pytest.mark.parametrize("offset", OFFSETS)
def test_photons_far_away_keep_their_places_and_differentials(offset):
    here = MOTIONS["rigid"](lamp((0.4, 0.1, 3)))
    near, far = (render(in_other_units(here, offset=o)).photons for o in (placed(0.0), placed(offset)))
    _, here, there = np.intersect1d(near.ids, far.ids, return_indices=True)
    # Those on the rim of the ball, where little is refracted, may miss it.
    assert near.flux[here].sum() > 0.99 * near.flux.sum()
    for name, size in (("positions", 3.0), ("dxdu", 0.1), ("dxdv", 0.1), ("dxdt", 0.3)):
        moved = placed(offset) if name == "positions" else 0.0
        error = np.abs(getattr(far, name)[there] - moved - getattr(near, name)[here])
        # Ten roundings and those of float64 out there, which glass amplifies up to some hundred times.
        assert np.quantile(error, 0.95) < 100 * (10 * EPS + 2.0**-53 * offset) * size, name


def stage_at(path: Path, offset: float) -> Path:
    """Writes the small stage with everything in it moved by ``placed(offset)`` in double precision."""
    write_stage(path)
    ops = 'uniform token[] xformOpOrder = ["xformOp:translate"]'
    moved = f"double3 xformOp:translate = {tuple(placed(offset).tolist())}\n    {ops}"
    path.write_text(path.read_text().replace('def Xform "World"\n{\n', f'def Xform "World"\n{{\n    {moved}\n'))
    return path


def rendered(path: Path, offset: float) -> dict[str, np.ndarray]:
    """Channels of the small stage moved by ``placed(offset)``."""
    stage_at(path, offset)
    options = {"photons": 256, "samples": 1, "image_width": 24, "threads": 1, "aovs": ("caustic", "Z", "motion")}
    result = tpdwarp.render(path, path.with_suffix(".exr"), frames=[2], **options)
    assert result.ok
    return read_image(path.with_suffix(".exr"))[0]


@pytest.mark.parametrize("offset", OFFSETS)
def test_transforms_of_a_stage_are_taken_in_double_precision(tmp_path, offset):
    near, far = rendered(tmp_path / "near.usda", 0.0), rendered(tmp_path / "far.usda", offset)
    # Seen through one interface of index 1.5, which leaves the square of that of the radiance.
    assert near["caustic.R"].max() > 0.05 / 1.5**2
    for name, values in near.items():
        # Colours are stored as half: a unit in the last place there is 2⁻¹¹ of the value.
        tolerance = (SAME if name[0] in "ZmP" else 2.0**-11) * np.abs(values).max()
        np.testing.assert_allclose(far[name], values, rtol=0, atol=tolerance, err_msg=name)


SCENE = 4.0
"""Width of the small stage's floor."""


def layer_at(folder: Path, offset: float) -> Path:
    """A debug layer of the small stage moved by ``placed(offset)``."""
    folder.mkdir()
    layer = folder / "s.debug.usdc"
    result = tpdwarp.write_photons(stage_at(folder / "s.usda", offset), layer, frames="1:3", photons=64, exposure=0.5)
    assert result.ok
    return layer


def prims_of(stage: Usd.Stage) -> dict[str, UsdGeom.PointBased]:
    kinds = {"Photons": UsdGeom.Points}
    names = ("TimeDifferentials", "Footprints", "SweptFootprints", "Photons")
    return {name: kinds.get(name, UsdGeom.BasisCurves).Get(stage, f"/TPD/{name}") for name in names}


def world_points(prim: UsdGeom.PointBased, frame: float) -> np.ndarray:
    """Points as a viewer places them, in double precision."""
    matrix = prim.ComputeLocalToWorldTransform(frame)
    return np.array([matrix.Transform(Gf.Vec3d(point)) for point in prim.GetPointsAttr().Get(frame)])


@pytest.mark.parametrize("offset", OFFSETS)
def test_a_debug_layer_far_away_shows_what_it_shows_near_the_origin(tmp_path, offset):
    places = {"near": 0.0, "far": offset}
    near, far = (Usd.Stage.Open(str(layer_at(tmp_path / name, o))) for name, o in places.items())
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert UsdValidation.ValidationContext(validators).Validate(far) == []
    cache = UsdGeom.BBoxCache(0, ["default", "guide"])
    for name, prim in prims_of(far).items():
        there = prims_of(near)[name]
        for frame in (1.0, 2.0, 3.0):
            points, expected = world_points(prim, frame), world_points(there, frame) + placed(offset)
            np.testing.assert_allclose(points, expected, rtol=0, atol=1e-5 * SCENE, err_msg=name)
            cache.SetTime(frame)
            bounds = cache.ComputeWorldBound(prim.GetPrim()).ComputeAlignedRange()
            pad = prim.GetWidthsAttr().Get(frame)[0] + 1e-5 * SCENE
            for bound, corner in ((bounds.GetMin(), points.min(axis=0)), (bounds.GetMax(), points.max(axis=0))):
                assert np.abs(np.array(bound) - corner).max() <= pad
            if name == "TimeDifferentials":
                ends = points.reshape(-1, 2, 3)
                dxdt = np.array(UsdGeom.PrimvarsAPI(prim).GetPrimvar("tpd:DtX").Get(frame))
                np.testing.assert_allclose(ends[:, 1] - ends[:, 0], dxdt, rtol=0, atol=1e-5 * SCENE)


@pytest.mark.parametrize("offset", OFFSETS)
def test_photons_are_read_back_where_they_are_in_the_world(tmp_path, offset):
    layer = layer_at(tmp_path / "far", offset)
    traced = tpdwarp.trace_photons(layer.with_name("s.usda"), 2, photons=64, exposure=0.5)
    reader = DebugLayerReader(layer)
    np.testing.assert_allclose(reader.at(2).positions, traced.positions, rtol=0, atol=1e-5 * SCENE)
    middles = reader.time_differentials(2)[0].mean(axis=1)
    np.testing.assert_allclose(middles, traced.positions, rtol=0, atol=1e-5 * SCENE)


@pytest.mark.parametrize("offset, translated", [(0.0, False), (10.0, False), (1e3, True), (1e7, True)])
def test_only_layers_far_from_the_origin_have_one_of_their_own(tmp_path, offset, translated):
    stage = Usd.Stage.Open(str(layer_at(tmp_path / "layer", offset)))
    for prim in prims_of(stage).values():
        ops = [op.GetOpName() for op in prim.GetOrderedXformOps()]
        assert ops == (["xformOp:translate"] if translated else [])
        assert not translated or prim.GetOrderedXformOps()[0].GetPrecision() == UsdGeom.XformOp.PrecisionDouble


@pytest.mark.parametrize("drop", [False, True])
def test_layers_compare_whether_their_points_are_relative_or_not(tmp_path, drop):
    """The same photons with points in the world, as other programs may write them, are the same as far as they tell."""
    offset = 1e3
    layer, other = layer_at(tmp_path / "far", offset), tmp_path / "other.usdc"
    shutil.copy(layer, other)
    stage = Usd.Stage.Open(str(other))
    points = UsdGeom.Points.Get(stage, "/TPD/Photons")
    for frame in points.GetPointsAttr().GetTimeSamples():
        world = world_points(points, frame).astype(np.float32)
        points.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(world), frame)
    if drop:
        points.ClearXformOpOrder()
    stage.Save()
    findings = [f for compared in compare_layers(str(other), str(layer), Limits()) for f in compared.findings]
    assert [finding.kind for finding in findings] == ([] if drop else ["position"] * 3)
