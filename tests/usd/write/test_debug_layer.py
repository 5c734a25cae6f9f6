"""The debug layer holds the photons as traced, opens in any viewer and lies over the scene it came from."""

import json
import resource
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdValidation

from tpdwarp.errors import FrameError, InputError
from tpdwarp.photons.paths import PhotonPaths
from tpdwarp.photons.record import PhotonRecord
from tpdwarp.usd.read.debug_layer import DebugLayerReader
from tpdwarp.usd.write.colors import STEPS, speed_colors
from tpdwarp.usd.write.debug_layer import LEAST_CURVE_WIDTH, PRIMVARS, DebugLayerWriter, view_path
from tpdwarp.usd.write.outlines import COARSE, FINE, MOST_FINE

CURVES = ("TimeDifferentials", "Footprints", "SweptFootprints")
PRIMS = (*CURVES, "Photons")
POINTS_A_PHOTON = {"TimeDifferentials": 2, "Footprints": FINE, "SweptFootprints": FINE + 2, "Photons": 1}
SETTINGS = {"photons": 64, "mask": ["/World"], "exposure": None}


def photons(
    side: int = 8, seed: int = 3, first_id: int = 0, paths: tuple[str, ...] = ("/World/Floor",)
) -> PhotonRecord:
    """A lattice of side × side photons with arbitrary tangent differentials on planes of arbitrary tilt."""
    count = side * side
    generator = np.random.default_rng(seed)
    normals = generator.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)

    def tangent() -> np.ndarray:
        vectors = generator.normal(size=(count, 3))
        return vectors - np.einsum("ni,ni->n", vectors, normals)[:, None] * normals

    cells = np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).reshape(-1, 2)
    return PhotonRecord(
        ids=np.arange(count, dtype=np.int64) + first_id,
        positions=generator.uniform(-5, 5, (count, 3)),
        normals=normals,
        dxdu=tangent(),
        dxdv=tangent(),
        dxdt=tangent(),
        flux=generator.uniform(0, 1, (count, 3)),
        emission=cells + 0.5,
        bounces=generator.integers(1, 4, count).astype(np.int32),
        receivers=generator.integers(0, max(len(paths), 1), count).astype(np.int32),
        receiver_paths=paths,
        lights=generator.integers(0, 2, count).astype(np.int32),
        light_paths=("/World/Sun", "/World/Lamp"),
    )


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "scene" / "shot.usda"
    path.parent.mkdir()
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 0.1)
    stage.SetTimeCodesPerSecond(48)
    stage.SetFramesPerSecond(24)
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(10)
    world = UsdGeom.Xform.Define(stage, "/World")
    stage.SetDefaultPrim(world.GetPrim())
    UsdGeom.Sphere.Define(stage, "/World/Floor")
    stage.Save()
    return path


@pytest.fixture
def file_size_limit() -> Iterator[Callable[[int], None]]:
    """Makes writes beyond a file size fail, as they do on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield lambda size: resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def writer(path: Path, scene: Path, curves: int | None = None) -> DebugLayerWriter:
    return DebugLayerWriter(path, str(scene), SETTINGS, (2, 4), 0.5, 48, 24, "Z", 0.1, curves)


def write(path: Path, scene: Path, frames: dict[float, PhotonRecord], curves: int | None = None) -> Usd.Stage:
    with writer(path, scene, curves) as layer:
        for time, record in frames.items():
            layer.add_frame(time, record, smoothing=1.5)
    return Usd.Stage.Open(str(path))


def prim(stage: Usd.Stage, name: str) -> UsdGeom.PointBased:
    kind = UsdGeom.Points if name == "Photons" else UsdGeom.BasisCurves
    return kind(stage.GetPrimAtPath(f"/TPD/{name}"))


def shown_colors(stage: Usd.Stage, name: str, time: float) -> np.ndarray:
    return np.array(prim(stage, name).GetDisplayColorPrimvar().ComputeFlattened(time))


def paths(record: PhotonRecord, count: int) -> PhotonPaths:
    """Paths of the first photons: 2, 3, 4, 2, 3, … vertices from above to where they land."""
    ends, counts = record.rows(np.arange(len(record)) < count), np.arange(count, dtype=np.int32) % 3 + 2
    points = np.repeat(ends.positions, counts, axis=0)
    last = np.cumsum(counts) - 1
    points[np.setdiff1d(np.arange(len(points)), last), 2] += 1.0
    return PhotonPaths(ends, counts, points)


def validation_errors(stage: Usd.Stage) -> list[str]:
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert validators
    return [error.GetMessage() for error in UsdValidation.ValidationContext(validators).Validate(stage)]


@pytest.mark.parametrize("extension", ["usdc", "usda", "usd"])
def test_layer_and_view_pass_all_validators(tmp_path: Path, scene: Path, extension: str) -> None:
    path = tmp_path / f"shot.debug.{extension}"
    write(path, scene, {2: photons(), 3: photons(0), 4: photons(3)})
    for written in (path, tmp_path / "shot.view.usda"):
        assert validation_errors(Usd.Stage.Open(str(written))) == []


def test_validators_do_find_missing_metadata() -> None:
    stage = Usd.Stage.CreateInMemory()
    stage.DefinePrim("/TPD", "Scope")
    assert validation_errors(stage)


@pytest.mark.parametrize("extension", ["usdc", "usd"])
def test_layer_is_a_crate_unless_asked_for_text(tmp_path: Path, scene: Path, extension: str) -> None:
    path = tmp_path / f"a.{extension}"
    write(path, scene, {2: photons()})
    assert path.read_bytes().startswith(b"PXR-USDC")
    write(tmp_path / "a.usda", scene, {2: photons()})
    assert (tmp_path / "a.usda").read_bytes().startswith(b"#usda")


@pytest.mark.parametrize("extension", ["usdc", "usda"])
@pytest.mark.parametrize("name", PRIMS)
def test_every_array_has_the_size_its_interpolation_asks_for(
    tmp_path: Path, scene: Path, name: str, extension: str
) -> None:
    frames = {2: photons(8), 3: photons(0), 4: photons(5)}
    stage = write(tmp_path / f"a.{extension}", scene, frames)
    shape = prim(stage, name)
    for time, record in frames.items():
        points = shape.GetPointsAttr().Get(time)
        assert len(points) == len(record) * POINTS_A_PHOTON[name]
        interpolation = "vertex" if name == "Photons" else "uniform"
        if name != "Photons":
            assert list(shape.GetCurveVertexCountsAttr().Get(time)) == [POINTS_A_PHOTON[name]] * len(record)
            assert shape.ComputeUniformDataSize(time) == len(record)
        primvars = UsdGeom.PrimvarsAPI(shape)
        for primvar in [primvars.GetPrimvar(key) for key in (*PRIMVARS, "displayColor")]:
            size = len(primvar.Get(time))
            assert size == len(record) and primvar.GetInterpolation() == interpolation, primvar.GetName()
            if name != "Photons" and size > 1:
                assert shape.ComputeInterpolationForSize(size, time) == interpolation
        widths = shape.GetWidthsAttr().Get(time)
        assert shape.GetWidthsInterpolation() == ("vertex" if name == "Photons" else "constant")
        assert len(widths) == (len(record) if name == "Photons" else 1)
        assert all(width > 0 for width in widths)


@pytest.mark.parametrize("name", PRIMS)
def test_all_that_changes_has_a_sample_at_every_frame_and_at_no_other_time(
    tmp_path: Path, scene: Path, name: str
) -> None:
    stage = write(tmp_path / "a.usdc", scene, {2: photons(), 3.5: photons(4), 4: photons(0)})
    shape = prim(stage, name)
    primvars = UsdGeom.PrimvarsAPI(shape)
    attributes = [shape.GetPointsAttr(), shape.GetExtentAttr(), shape.GetDisplayColorAttr()]
    attributes += [primvars.GetPrimvar(key).GetAttr() for key in PRIMVARS]
    attributes += (
        [shape.GetIdsAttr(), shape.GetWidthsAttr()] if name == "Photons" else [shape.GetCurveVertexCountsAttr()]
    )
    for attribute in attributes:
        assert attribute.GetTimeSamples() == [2, 3.5, 4], attribute.GetName()


def test_photons_come_back_as_they_were_traced(tmp_path: Path, scene: Path) -> None:
    record = photons(paths=("/World/Floor", "/World/Wall"))
    stage = write(tmp_path / "a.usdc", scene, {2: record})
    single = {"rtol": 2**-23, "atol": 1e-30}
    for name in PRIMS:
        primvars = UsdGeom.PrimvarsAPI(prim(stage, name))

        def value(key: str, primvars: UsdGeom.PrimvarsAPI = primvars) -> np.ndarray:
            return np.array(primvars.GetPrimvar(key).Get(2))

        np.testing.assert_array_equal(value("tpd:photonId"), record.ids)
        np.testing.assert_array_equal(value("tpd:bounces"), record.bounces)
        np.testing.assert_allclose(value("tpd:flux"), record.flux, **single)
        np.testing.assert_allclose(value("tpd:DuX"), record.dxdu, **single)
        np.testing.assert_allclose(value("tpd:DvX"), record.dxdv, **single)
        np.testing.assert_allclose(value("tpd:DtX"), record.dxdt, **single)
        np.testing.assert_allclose(value("tpd:emission"), record.emission, **single)
        paths = list(primvars.GetPrimvar("tpd:receivers").Get())
        assert [paths[k] for k in value("tpd:receiver")] == [record.receiver_paths[k] for k in record.receivers]
    np.testing.assert_allclose(prim(stage, "Photons").GetPointsAttr().Get(2), record.positions, **single)
    np.testing.assert_array_equal(prim(stage, "Photons").GetIdsAttr().Get(2), record.ids)


def test_types_are_those_that_viewers_take(tmp_path: Path, scene: Path) -> None:
    stage = write(tmp_path / "a.usdc", scene, {2: photons()})
    types = {
        "photonId": "int[]", "flux": "color3f[]", "DuX": "vector3f[]", "DvX": "vector3f[]", "DtX": "vector3f[]",
        "emission": "float2[]", "bounces": "int[]", "receiver": "int[]", "receivers": "string[]", "light": "int[]",
        "lights": "string[]",
    }  # fmt: skip
    for name in PRIMS:
        found = UsdGeom.PrimvarsAPI(prim(stage, name)).FindPrimvarsWithInheritance()
        found = {primvar.GetPrimvarName(): str(primvar.GetTypeName()) for primvar in found}
        assert {key.removeprefix("tpd:"): kind for key, kind in found.items() if key.startswith("tpd:")} == types
    for name, wrap in zip(CURVES, ("nonperiodic", "periodic", "periodic"), strict=True):
        assert prim(stage, name).GetTypeAttr().Get() == "linear" and prim(stage, name).GetWrapAttr().Get() == wrap
        assert not prim(stage, name).GetNormalsAttr().HasAuthoredValue()


def test_ids_beyond_32_bits_stay_whole_on_points_and_fold_in_the_primvar(tmp_path: Path, scene: Path) -> None:
    record = photons(first_id=2**31 - 10)
    stage = write(tmp_path / "a.usdc", scene, {2: record})
    points = prim(stage, "Photons")
    np.testing.assert_array_equal(points.GetIdsAttr().Get(2), record.ids)
    folded = np.array(UsdGeom.PrimvarsAPI(points).GetPrimvar("tpd:photonId").Get(2))
    assert folded.min() >= 0
    np.testing.assert_array_equal(folded, record.ids % 2**31)


def test_receivers_keep_their_index_when_a_frame_lists_others(tmp_path: Path, scene: Path) -> None:
    frames = {2: photons(paths=("/A", "/B")), 3: photons(paths=("/B", "/C", "/A")), 4: photons(0, paths=())}
    stage = write(tmp_path / "a.usdc", scene, frames)
    primvars = UsdGeom.PrimvarsAPI(prim(stage, "Footprints"))
    paths = list(primvars.GetPrimvar("tpd:receivers").Get())
    assert sorted(paths) == ["/A", "/B", "/C"]
    assert primvars.GetPrimvar("tpd:receivers").GetInterpolation() == "constant"
    for time, record in frames.items():
        written = [paths[k] for k in primvars.GetPrimvar("tpd:receiver").Get(time)]
        assert written == [record.receiver_paths[k] for k in record.receivers]


@pytest.mark.parametrize("name", PRIMS)
def test_extents_enclose_all_points_and_little_more(tmp_path: Path, scene: Path, name: str) -> None:
    frames = {2: photons(), 3: photons(4, seed=9)}
    stage = write(tmp_path / "a.usdc", scene, frames)
    shape = prim(stage, name)
    width = shape.GetWidthsAttr().Get(2)[0]
    for time in frames:
        points = np.array(shape.GetPointsAttr().Get(time))
        low, high = np.array(shape.GetExtentAttr().Get(time))
        # Half a width is enough; USD may pad by a whole one, and by the rounding of coordinates up to 16.
        slack = width + 16 * 2**-23
        assert (low <= points.min(axis=0)).all() and (high >= points.max(axis=0)).all()
        assert (low >= points.min(axis=0) - slack).all() and (high <= points.max(axis=0) + slack).all()


def test_frame_without_photons_has_an_empty_extent(tmp_path: Path, scene: Path) -> None:
    stage = write(tmp_path / "a.usdc", scene, {2: photons(0), 3: photons()})
    cache = UsdGeom.BBoxCache(2, ["default", "guide"])
    assert cache.ComputeWorldBound(stage.GetPrimAtPath("/TPD")).GetRange().IsEmpty()
    cache.SetTime(3)
    assert not cache.ComputeWorldBound(stage.GetPrimAtPath("/TPD")).GetRange().IsEmpty()


def test_time_differentials_run_from_shutter_open_to_shutter_close(tmp_path: Path, scene: Path) -> None:
    record = photons()
    stage = write(tmp_path / "a.usdc", scene, {2: record})
    points = prim(stage, "TimeDifferentials").GetPointsAttr().Get(2)
    ends = np.array(points).reshape(-1, 2, 3)
    # Single precision of coordinates below 8.
    np.testing.assert_allclose(ends[:, 1] - ends[:, 0], record.dxdt, rtol=0, atol=8 * 2**-23)
    np.testing.assert_allclose(ends.mean(axis=1), record.positions, rtol=0, atol=8 * 2**-23)


def test_speeds_of_all_frames_share_one_scale(tmp_path: Path, scene: Path) -> None:
    slow, fast = photons(), replace(photons(), dxdt=10 * photons().dxdt)
    stage = write(tmp_path / "a.usdc", scene, {2: slow, 3: fast})
    fastest = stage.GetRootLayer().customLayerData["tpdwarp"]["fastestColor"]
    speeds = np.concatenate([np.linalg.norm(record.dxdt, axis=1) for record in (slow, fast)])
    np.testing.assert_allclose(fastest, np.percentile(speeds, 99), rtol=1e-6)
    for time, record in ((2, slow), (3, fast)):
        expected = speed_colors(np.linalg.norm(record.dxdt, axis=1), fastest)
        for name in PRIMS:
            colors = prim(stage, name).GetDisplayColorAttr().Get(time)
            # Speeds are kept in single precision, which the ramp's slope of at most 4 a stop magnifies.
            np.testing.assert_allclose(colors, expected, rtol=0, atol=1e-5)


def test_photons_that_stand_still_are_coloured_by_their_flux(tmp_path: Path, scene: Path) -> None:
    record = replace(photons(), dxdt=np.zeros((64, 3)))
    stage = write(tmp_path / "a.usdc", scene, {2: record})
    flux = record.flux.sum(axis=1)
    expected = speed_colors(flux, float(np.percentile(flux, 99)))
    np.testing.assert_allclose(prim(stage, "Photons").GetDisplayColorAttr().Get(2), expected, rtol=0, atol=1e-5)
    colours = stage.GetPrimAtPath("/TPD").GetVariantSet("colour")
    colours.SetVariantSelection("speed")
    slowest = np.tile(speed_colors(np.zeros(1), 1.0), (64, 1))
    np.testing.assert_allclose(shown_colors(stage, "Photons", 2), slowest, rtol=1e-6)


def test_colours_show_what_their_variant_says(tmp_path: Path, scene: Path) -> None:
    record = photons(paths=("/World/A", "/World/B", "/World/C"))
    stage = write(tmp_path / "a.usdc", scene, {2: record})
    colours = stage.GetPrimAtPath("/TPD").GetVariantSet("colour")
    assert colours.GetVariantSelection() == "speed"
    # Receivers and lights are told apart from the second step of their ramp on.
    for name, values in (("bounces", record.bounces), ("receiver", record.receivers + 1), ("light", record.lights + 1)):
        colours.SetVariantSelection(name)
        for of in PRIMS:
            # A step of the table, times the ramp's slope of at most 4 a stop.
            expected = speed_colors(values, float(values.max()))
            np.testing.assert_allclose(shown_colors(stage, of, 2), expected, rtol=0, atol=4 / STEPS)


@pytest.mark.parametrize(("moves", "first"), [(True, "differentials"), (False, "footprints")])
def test_the_view_shows_one_kind_at_a_time_and_all_on_demand(tmp_path: Path, scene: Path, moves, first) -> None:
    record = photons() if moves else replace(photons(), dxdt=np.zeros((64, 3)))
    write(tmp_path / "a.debug.usdc", scene, {2: record})
    stage = Usd.Stage.Open(str(tmp_path / "a.view.usda"))
    what = stage.GetPrimAtPath("/TPD").GetVariantSet("what")
    assert what.GetVariantSelection() == first
    kinds = {"differentials": CURVES[:1], "footprints": CURVES[1:2], "swept": CURVES[2:], "photons": ("Photons",)}
    for choice, names in {**kinds, "paths": ("Paths",), "all": (*PRIMS, "Paths")}.items():
        what.SetVariantSelection(choice)
        shown = UsdGeom.Tokens.inherited
        assert {name for name in (*PRIMS, "Paths") if prim(stage, name).ComputeVisibility(2) == shown} == set(names)


@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e4])
def test_widths_follow_footprints_and_are_seen_in_the_scene(tmp_path: Path, scene: Path, scale: float) -> None:
    record = photons()
    record = replace(record, dxdu=scale * record.dxdu, dxdv=scale * record.dxdv)
    stage = write(tmp_path / "a.usdc", scene, {1: photons(0), 2: record})
    diameter = 1.5 * np.sqrt(np.median(np.linalg.norm(np.cross(record.dxdu, record.dxdv), axis=1)))
    spread = np.linalg.norm(np.ptp(record.positions, axis=0))
    for name in PRIMS:
        width = prim(stage, name).GetWidthsAttr().Get(2)[0]
        assert max(0.01 * diameter, 0.5 * LEAST_CURVE_WIDTH * spread) < width < max(0.2 * diameter, 2e-3 * spread)


def test_widths_of_collapsed_footprints_follow_the_scene(tmp_path: Path, scene: Path) -> None:
    record = replace(photons(), dxdv=np.zeros((64, 3)))
    stage = write(tmp_path / "a.usdc", scene, {2: record})
    spread = np.linalg.norm(np.ptp(record.positions, axis=0))
    for name in PRIMS:
        assert 0 < prim(stage, name).GetWidthsAttr().Get(2)[0] < 0.01 * spread


def test_layer_takes_the_metadata_of_its_scene(tmp_path: Path, scene: Path) -> None:
    write(tmp_path / "shot.debug.usdc", scene, {2: photons()})
    original = Usd.Stage.Open(str(scene))
    for path in ("shot.debug.usdc", "shot.view.usda"):
        stage = Usd.Stage.Open(str(tmp_path / path))
        for read in (
            UsdGeom.GetStageUpAxis, UsdGeom.GetStageMetersPerUnit, Usd.Stage.GetTimeCodesPerSecond,
            Usd.Stage.GetFramesPerSecond, Usd.Stage.GetStartTimeCode, Usd.Stage.GetEndTimeCode,
        ):  # fmt: skip
            assert read(stage) == read(original), (path, read)


def test_layer_of_a_scene_without_a_range_covers_the_frames(tmp_path: Path, scene: Path) -> None:
    layer = Sdf.Layer.FindOrOpen(str(scene))
    layer.ClearStartTimeCode()
    layer.ClearEndTimeCode()
    stage = write(tmp_path / "a.usdc", scene, {2: photons()})
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (2, 4)


def test_layer_records_where_its_photons_come_from(tmp_path: Path, scene: Path) -> None:
    stage = write(tmp_path / "a.usdc", scene, {2: photons()})
    recorded = stage.GetRootLayer().customLayerData["tpdwarp"]
    assert recorded["frameRange"] == Gf.Vec2d(2, 4)
    assert recorded["exposure"] == 0.5
    assert recorded["scene"] == str(scene)
    assert json.loads(recorded["settings"]) == SETTINGS
    assert recorded["version"]


def test_layer_alone_is_a_guide_and_the_view_shows_it_with_the_scene(tmp_path: Path, scene: Path) -> None:
    debug = write(tmp_path / "shot.debug.usdc", scene, {2: photons()})
    assert debug.GetDefaultPrim().GetPath() == "/TPD" and debug.GetDefaultPrim().GetTypeName() == "Scope"
    view = Usd.Stage.Open(str(tmp_path / "shot.view.usda"))
    for name in PRIMS:
        assert prim(debug, name).ComputePurpose() == "guide"
        assert prim(view, name).ComputePurpose() == "default"
        assert prim(view, name).GetPointsAttr().Get(2) == prim(debug, name).GetPointsAttr().Get(2)
        assert prim(view, name).GetPointsAttr().GetTimeSamples() == [2]
    assert view.GetPrimAtPath("/World/Floor").GetTypeName() == "Sphere"
    assert view.GetDefaultPrim().GetPath() == "/World"


def test_view_finds_its_layers_after_all_have_moved_together(tmp_path: Path, scene: Path) -> None:
    write(tmp_path / "out" / "shot.debug.usdc", scene, {2: photons()})
    moved = tmp_path / "moved"
    moved.mkdir()
    for folder in ("out", "scene"):
        (tmp_path / folder).rename(moved / folder)
    view = Usd.Stage.Open(str(moved / "out" / "shot.view.usda"))
    assert view.GetPrimAtPath("/World/Floor") and view.GetPrimAtPath("/TPD/Photons")


@pytest.mark.parametrize(
    ("debug", "view"),
    [("shot.debug.usdc", "shot.view.usda"), ("shot.usdc", "shot.view.usda"), ("a.b.debug.usda", "a.b.view.usda")],
)
def test_view_is_named_after_the_layer(debug: str, view: str) -> None:
    assert view_path(f"out/{debug}") == Path("out") / view


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_interrupted_layer_leaves_no_file(tmp_path: Path, scene: Path, error: type) -> None:
    out = tmp_path / "out"
    with pytest.raises(error), writer(out / "a.debug.usdc", scene) as layer:
        layer.add_frame(2, photons(), 1.0)
        raise error
    assert list(out.iterdir()) == []


def test_layer_appears_on_close_and_alone_with_its_view(tmp_path: Path, scene: Path) -> None:
    out = tmp_path / "out"
    layer = writer(out / "a.debug.usdc", scene)
    layer.add_frame(2, photons(), 1.0)
    assert not (out / "a.debug.usdc").exists() and not (out / "a.view.usda").exists()
    layer.close()
    layer.close()
    assert sorted(path.name for path in out.iterdir()) == ["a.debug.usdc", "a.view.usda"]


@pytest.mark.parametrize("extension", ["usdc", "usda"])
def test_layer_that_finds_the_disk_full_fails_and_leaves_nothing(
    tmp_path: Path, scene: Path, extension: str, file_size_limit: Callable[[int], None]
) -> None:
    out = tmp_path / "out"
    with (
        pytest.raises(FrameError, match=rf"a\.{extension}: cannot be written"),
        writer(out / f"a.{extension}", scene) as layer,
    ):
        file_size_limit(20000)
        layer.add_frame(2, photons(16), 1.0)
    assert list(out.iterdir()) == []


def test_crate_goes_to_disk_with_every_frame(tmp_path: Path, scene: Path) -> None:
    out = tmp_path / "out"
    with writer(out / "a.usdc", scene) as layer:
        for count in (1, 2, 3):
            layer.add_frame(count, photons(16, seed=count), 1.0)
            written = sum(path.stat().st_size for path in out.iterdir())
            assert written > count * 256 * sum(POINTS_A_PHOTON.values()) * 12


def test_layer_without_frames_is_legal(tmp_path: Path, scene: Path) -> None:
    stage = write(tmp_path / "a.debug.usdc", scene, {})
    assert validation_errors(stage) == []


@pytest.mark.parametrize("name", ["positions", "dxdu", "dxdv", "dxdt", "flux", "emission"])
def test_photon_that_is_not_finite_is_named(tmp_path: Path, scene: Path, name: str) -> None:
    record = photons(first_id=100)
    getattr(record, name)[7, 1] = np.nan
    with pytest.raises(FrameError, match=f"frame 2: {name} of photon 107"), writer(tmp_path / "a.usdc", scene) as layer:
        layer.add_frame(2, record, 1.0)


def test_thinned_layer_keeps_the_same_photons_in_every_frame(tmp_path: Path, scene: Path) -> None:
    everything = photons(16)
    landed = np.random.default_rng(5).random((6, len(everything))) < 0.9
    frames = {float(k): everything.rows(rows) for k, rows in enumerate(landed)}
    stage = write(tmp_path / "a.usdc", scene, frames, curves=50)
    points = prim(stage, "Photons")
    kept = {time: set(points.GetIdsAttr().Get(time)) for time in frames}
    for time, record in frames.items():
        assert 0 < len(kept[time]) <= 50
        for earlier in (t for t in frames if t < time):
            assert kept[time] & set(frames[earlier].ids) <= kept[earlier]
        assert set(record.ids) >= kept[time]
    assert len(kept[0.0]) == 50


def test_layer_with_room_for_all_photons_leaves_none_out(tmp_path: Path, scene: Path) -> None:
    stage = write(tmp_path / "a.usdc", scene, {2: photons(8)}, curves=64)
    points = prim(stage, "Photons")
    assert len(points.GetIdsAttr().Get(2)) == 64


def test_layers_that_cannot_be_written_are_refused_at_once(tmp_path: Path, scene: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    (tmp_path / "taken.view.usda").mkdir()
    for path, why in (
        (tmp_path / "file" / "a.usdc", "cannot be written"),
        (tmp_path / "taken.debug.usdc", "is a folder"),
        (tmp_path / "a.abc", r"\.usdc, \.usda, \.usd"),
        (scene, "is the scene itself"),
    ):
        with pytest.raises(InputError, match=why):
            writer(path, scene)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "scene", "taken.view.usda"]
    assert Usd.Stage.Open(str(scene)).GetPrimAtPath("/World/Floor")


def test_view_over_the_scene_itself_is_refused(tmp_path: Path, scene: Path) -> None:
    renamed = scene.rename(scene.with_name("shot.view.usda"))
    with pytest.raises(InputError, match="is the scene itself"):
        writer(scene.with_name("shot.debug.usdc"), renamed)


@pytest.mark.parametrize("content", [None, b"#usda 1.0\n( nonsense", b"binary"])
def test_scene_that_cannot_be_opened_is_refused_in_one_line(tmp_path: Path, content: bytes | None) -> None:
    broken = tmp_path / "broken.usda"
    if content is not None:
        broken.write_bytes(content)
    with pytest.raises(InputError) as refusal:
        writer(tmp_path / "a.usdc", broken)
    assert str(refusal.value).startswith(str(broken)) and "\n" not in str(refusal.value)


def test_thinning_to_nothing_is_refused(tmp_path: Path, scene: Path) -> None:
    with pytest.raises(InputError, match=r"^curves "):
        writer(tmp_path / "a.usdc", scene, curves=0)


def test_a_link_planted_in_place_of_the_layer_is_replaced_and_not_followed(tmp_path: Path, scene: Path) -> None:
    precious = tmp_path / "precious.usdc"
    precious.write_bytes(b"precious")
    out = tmp_path / "out"
    out.mkdir()
    for name in ("shot.debug.usdc", "shot.view.usda"):
        (out / name).symlink_to(precious)
    write(out / "shot.debug.usdc", scene, {2: photons()})
    assert precious.read_bytes() == b"precious"
    view = Sdf.Layer.FindOrOpen(str(out / "shot.view.usda"))
    assert view.subLayerPaths[0] == "./shot.debug.usdc"
    assert Usd.Stage.Open(view).GetPrimAtPath("/TPD/Photons")


def test_paths_end_where_their_photons_land(tmp_path: Path, scene: Path) -> None:
    record = photons()
    with writer(tmp_path / "a.usdc", scene) as layer:
        layer.add_frame(2, record, 1.0, paths(record, 7))
        layer.add_frame(3, record, 1.0)
    stage = Usd.Stage.Open(str(tmp_path / "a.usdc"))
    curves = prim(stage, "Paths")
    counts = np.array(curves.GetCurveVertexCountsAttr().Get(2))
    np.testing.assert_array_equal(counts, [2, 3, 4, 2, 3, 4, 2])
    ends = np.array(curves.GetPointsAttr().Get(2))[np.cumsum(counts) - 1]
    np.testing.assert_allclose(ends, record.positions[:7], rtol=0, atol=8 * 2**-23)
    primvars = UsdGeom.PrimvarsAPI(curves)
    np.testing.assert_array_equal(primvars.GetPrimvar("tpd:photonId").Get(2), record.ids[:7])
    assert curves.ComputeUniformDataSize(2) == len(curves.GetDisplayColorAttr().Get(2)) == 7
    assert len(curves.GetCurveVertexCountsAttr().Get(3)) == 0
    assert validation_errors(Usd.Stage.Open(str(tmp_path / "a.view.usda"))) == []


def test_thinned_layers_hold_no_more_paths_than_photons(tmp_path: Path, scene: Path) -> None:
    record = photons()
    with writer(tmp_path / "a.usdc", scene, curves=5) as layer:
        layer.add_frame(2, record, 1.0, paths(record, 40))
    stage = Usd.Stage.Open(str(tmp_path / "a.usdc"))
    assert prim(stage, "Paths").ComputeUniformDataSize(2) == 5


def test_outlines_of_many_photons_have_fewer_corners(tmp_path: Path, scene: Path) -> None:
    side = int(np.sqrt(MOST_FINE)) + 1
    stage = write(tmp_path / "a.usdc", scene, {2: photons(side), 3: photons(2)})
    for time in (2, 3):
        assert set(prim(stage, "Footprints").GetCurveVertexCountsAttr().Get(time)) == {COARSE}
        assert set(prim(stage, "SweptFootprints").GetCurveVertexCountsAttr().Get(time)) == {COARSE + 2}


def test_a_hundred_thousand_curves_take_less_than_ten_megabytes(tmp_path: Path, scene: Path) -> None:
    record, path = photons(100), tmp_path / "a.usdc"
    write(path, scene, {2: record, 3: replace(record, positions=record.positions + 0.1)})
    curves = 2 * 3 * len(record)
    assert path.stat().st_size < 10e6 * curves / 1e5


def test_columns_of_lights_with_extent_are_there_where_there_are_any(tmp_path: Path, scene: Path) -> None:
    record, generator = photons(), np.random.default_rng(3)
    a, b = generator.normal(size=(2, len(record), 3))
    plain = write(tmp_path / "plain.usda", scene, {2.0: record})
    stage = write(tmp_path / "lit.usda", scene, {2.0: replace(record, dxda=a, dxdb=b), 3.0: record})
    for name in ("Photons", "Footprints"):
        primvars = UsdGeom.PrimvarsAPI(prim(stage, name))
        assert not UsdGeom.PrimvarsAPI(prim(plain, name)).HasPrimvar("tpd:DaX")
        for label, column in (("tpd:DaX", a), ("tpd:DbX", b)):
            np.testing.assert_allclose(np.array(primvars.GetPrimvar(label).Get(2.0)), column, rtol=1e-6)
            assert not np.array(primvars.GetPrimvar(label).Get(3.0)).any()
    read = DebugLayerReader(tmp_path / "lit.usda").at(2.0)
    np.testing.assert_allclose(read.dxda, a, rtol=1e-6)
