"""The scenes in usd_scenes/: valid USD, animated by the laws they promise, and made by scripts/make_scenes.py."""

from __future__ import annotations

import importlib
import subprocess
import sys
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdRender, UsdShade, UsdValidation

from tpdwarp.scene.description import Shutter
from tpdwarp.scene.requirements import requirements_of
from tpdwarp.settings import StageSettings
from tpdwarp.usd.read.stage import StageScene

ROOT = Path(__file__).resolve().parent.parent
SHIPPED = ROOT / "usd_scenes"
MAKE_SCENES = ROOT / "scripts" / "make_scenes.py"
NAMES = ("wave", "cylinder", "mirror", "sea", "tumbler", "table")
FRAMES = range(1, 26)
# Positions are below 4 units, so that rounding to float32 moves them by less than this.
FLOAT_ROUNDING = 4 * 2.0**-24


@pytest.fixture
def make_scenes(monkeypatch: pytest.MonkeyPatch) -> Callable[..., int]:
    monkeypatch.syspath_prepend(str(MAKE_SCENES.parent))
    main = importlib.import_module(MAKE_SCENES.stem).main
    return lambda *arguments: main(list(arguments))


@pytest.fixture(scope="module")
def remade(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scenes")
    command = [sys.executable, str(MAKE_SCENES), "--out", str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path_factory.getbasetemp())
    assert done.returncode == 0, done.stderr
    return folder


def shipped(name: str) -> Usd.Stage:
    return Usd.Stage.Open(str(SHIPPED / f"{name}.usdc"))


def mesh_values(stage: Usd.Stage, path: str, time: float) -> tuple[np.ndarray, np.ndarray]:
    mesh = UsdGeom.Mesh.Get(stage, path)
    return np.array(mesh.GetPointsAttr().Get(time), float), np.array(mesh.GetNormalsAttr().Get(time), float)


def assert_waves(stage: Usd.Stage, time: float, waves: list[tuple[float, float, float, float]]) -> None:
    """Compares with z = 1 + Σ a·cos(k·d·p − ωt) and its gradient; waves are amplitude, wavelength, speed, degrees."""
    points, normals = mesh_values(stage, "/World/Water", time)
    height, slope_x, slope_y = np.ones(len(points)), 0.0, 0.0
    # Places were rounded to float32; heights and slopes follow them by at most this much.
    steepness = 0.0
    for amplitude, wavelength, speed, degrees in waves:
        k = 2 * np.pi / wavelength
        along = points[:, 0] * np.cos(np.radians(degrees)) + points[:, 1] * np.sin(np.radians(degrees))
        phase = k * (along - speed * (time - 1))
        height = height + amplitude * np.cos(phase)
        slope_x = slope_x - amplitude * k * np.sin(phase) * np.cos(np.radians(degrees))
        slope_y = slope_y - amplitude * k * np.sin(phase) * np.sin(np.radians(degrees))
        steepness += amplitude * k * max(1.0, k)
    tolerance = (2 + 2 * steepness) * FLOAT_ROUNDING
    np.testing.assert_allclose(points[:, 2], height, rtol=0, atol=tolerance)
    expected = np.stack([-slope_x, -slope_y, np.ones(len(points))], axis=1)
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(normals, expected, rtol=0, atol=tolerance)


@pytest.mark.parametrize("name", NAMES)
def test_scene_passes_every_usd_validator(name: str) -> None:
    context = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators())
    messages = [error.GetMessage() for error in context.Validate(shipped(name))]
    # USD from PyPI comes without the definitions of MaterialX's nodes.
    assert [message for message in messages if "shaderId 'ND_" not in message] == []


@pytest.mark.parametrize("name", NAMES)
def test_scene_declares_units_frames_and_a_blurring_camera(name: str) -> None:
    stage = shipped(name)
    assert UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert (stage.GetTimeCodesPerSecond(), stage.GetFramesPerSecond()) == (24, 24)
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1, 24)
    assert stage.GetDefaultPrim().GetPath() == "/World"
    settings = UsdRender.Settings.GetStageRenderSettings(stage)
    assert settings.GetResolutionAttr().Get() == Gf.Vec2i(960, 540)
    camera = UsdGeom.Camera.Get(stage, settings.GetCameraRel().GetTargets()[0])
    assert camera.GetPath() == "/World/Camera"
    for shutter in (camera, UsdGeom.Camera.Get(stage, "/World/TopOrtho")):
        assert (shutter.GetShutterOpenAttr().Get(), shutter.GetShutterCloseAttr().Get()) == (0.0, 1.0)


@pytest.mark.parametrize("name", NAMES)
def test_every_mesh_is_polygonal_bound_and_covered_by_its_extent(name: str) -> None:
    stage = shipped(name)
    meshes = [UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    assert len(meshes) == {"tumbler": 5, "table": 4}.get(name, 2)
    for mesh in meshes:
        assert mesh.GetSubdivisionSchemeAttr().Get() == UsdGeom.Tokens.none
        material, _ = UsdShade.MaterialBindingAPI(mesh.GetPrim()).ComputeBoundMaterial()
        assert material.ComputeSurfaceSource()[0].GetIdAttr().Get() == "UsdPreviewSurface"
        assert mesh.GetExtentAttr().GetTimeSamples() == mesh.GetPointsAttr().GetTimeSamples()
        for time in FRAMES:
            points, normals = mesh_values(stage, str(mesh.GetPath()), time)
            extent = np.array(mesh.GetExtentAttr().Get(time))
            np.testing.assert_array_equal(extent, [points.min(axis=0), points.max(axis=0)])
            # Three components, each rounded to float32.
            np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, rtol=0, atol=3 * 2.0**-25)


def test_scenes_are_small() -> None:
    sizes = [(SHIPPED / f"{name}.usdc").stat().st_size for name in NAMES]
    assert max(sizes) <= 2_000_000
    assert sum(sizes) <= 5_000_000


@pytest.mark.parametrize("name", NAMES)
def test_running_the_script_again_yields_the_shipped_scene(name: str, remade: Path) -> None:
    old, new = shipped(name), Usd.Stage.Open(str(remade / f"{name}.usdc"))
    assert old.GetRootLayer().customLayerData == new.GetRootLayer().customLayerData
    assert [prim.GetPath() for prim in old.Traverse()] == [prim.GetPath() for prim in new.Traverse()]
    for prim in old.Traverse():
        for attribute in prim.GetAuthoredAttributes():
            other = new.GetAttributeAtPath(attribute.GetPath())
            assert attribute.GetTimeSamples() == other.GetTimeSamples()
            for time in attribute.GetTimeSamples() or [Usd.TimeCode.Default()]:
                value, expected = other.Get(time), attribute.Get(time)
                if isinstance(expected, Sdf.AssetPath):
                    value, expected = value.path, expected.path
                value, expected = np.array(value), np.array(expected)
                if expected.dtype.kind == "f":
                    # Sines differ between processors by a bit of double precision, which may round the other way.
                    np.testing.assert_allclose(value, expected, rtol=2.0**-22, atol=2.0**-40)
                else:
                    np.testing.assert_array_equal(value, expected)


def test_wave_is_the_travelling_sinusoid_at_every_sample() -> None:
    stage = shipped("wave")
    assert UsdGeom.Mesh.Get(stage, "/World/Water").GetPointsAttr().GetTimeSamples() == list(FRAMES)
    for time in FRAMES:
        assert_waves(stage, time, [(0.08, 1.3, 1.3 / 8, 0.0)])


def test_a_wave_pays_for_nothing_but_refraction_and_motion() -> None:
    source = StageScene.open(str(SHIPPED / "wave.usdc"), StageSettings(camera="TopOrtho", exposure=1.0))
    needs = requirements_of(source.at(Shutter(3, 3, 4)))
    asked = {field.name for field in fields(needs) if getattr(needs, field.name)}
    # Kernels are compiled for what is asked for here, and for nothing else.
    assert asked == {"moving_meshes", "refraction", "bounces"}


def test_wave_options_reach_the_scene(make_scenes: Callable[..., int], tmp_path: Path) -> None:
    chosen = ["--amplitude", "0.05", "--wavelength", "0.65", "--speed", "0.1", "--frames", "3", "--resolution", "33"]
    assert make_scenes("wave", *chosen, "--out", str(tmp_path)) == 0
    stage = Usd.Stage.Open(str(tmp_path / "wave.usdc"))
    assert stage.GetEndTimeCode() == 3
    assert UsdGeom.Mesh.Get(stage, "/World/Water").GetPointsAttr().GetTimeSamples() == [1, 2, 3, 4]
    assert len(mesh_values(stage, "/World/Water", 1)[0]) == 2 * 33
    for time in range(1, 5):
        assert_waves(stage, time, [(0.05, 0.65, 0.1, 0.0)])


def test_wave_measuring_camera_sees_two_units_squared_from_under_the_water() -> None:
    stage = shipped("wave")
    camera = UsdGeom.Camera.Get(stage, "/World/TopOrtho").GetCamera(1)
    lowest = min(mesh_values(stage, "/World/Water", time)[0][:, 2].min() for time in FRAMES)
    assert camera.projection == Gf.Camera.Orthographic
    window = camera.frustum.GetWindow()
    # The aperture is stored as a float, in tenths.
    np.testing.assert_allclose([*window.GetMin(), *window.GetMax()], [-1, -1, 1, 1], rtol=2.0**-23)
    assert 0.85 < camera.transform.ExtractTranslation()[2] < lowest
    assert camera.frustum.ComputeViewDirection() == Gf.Vec3d(0, 0, -1)


@pytest.mark.parametrize("name", ["wave", "sea"])
def test_main_camera_under_water_sees_only_floor_that_lies_below_the_water(name: str) -> None:
    stage = shipped(name)
    water = np.concatenate([mesh_values(stage, "/World/Water", time)[0] for time in FRAMES])
    frustum = UsdGeom.Camera.Get(stage, "/World/Camera").GetCamera(1).frustum
    eye = np.array(frustum.GetPosition())
    assert 0 < eye[2] < water[:, 2].min()
    for corner in list(frustum.ComputeCorners())[4:]:
        ray = np.array(corner) - eye
        assert ray[2] < 0
        seen = eye - ray * eye[2] / ray[2]
        assert np.all(np.abs(seen[:2]) < water[:, :2].max(axis=0))


@pytest.mark.parametrize("name", ["wave", "sea"])
def test_water_is_an_open_dielectric_interface_with_its_front_up(name: str) -> None:
    stage = shipped(name)
    mesh = UsdGeom.Mesh.Get(stage, "/World/Water")
    points, normals = mesh_values(stage, "/World/Water", 1)
    quads = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 4)
    diagonals = points[quads[:, 2]] - points[quads[:, 0]], points[quads[:, 3]] - points[quads[:, 1]]
    assert np.all(np.cross(*diagonals)[:, 2] > 0)
    assert np.all(normals[:, 2] > 0)
    surface = UsdShade.Shader.Get(stage, "/World/Materials/Water/Surface")
    assert surface.GetInput("ior").Get() == np.float32(1.33)
    assert surface.GetInput("opacity").Get() == 0.0


def test_sun_shines_straight_down_with_unit_irradiance() -> None:
    for name in ("wave", "cylinder", "sea"):
        stage = shipped(name)
        sun = UsdLux.DistantLight.Get(stage, "/World/Sun")
        assert (sun.GetAngleAttr().Get(), sun.GetIntensityAttr().Get(), sun.GetExposureAttr().Get()) == (0, 1, 0)
        assert sun.ComputeLocalToWorldTransform(1) == Gf.Matrix4d(1)


def test_sea_is_three_crossing_waves_and_loops_in_eight_frames() -> None:
    stage = shipped("sea")
    waves = [(0.06 * s, s, s / 8, heading) for s, heading in ((1.0, 15.0), (0.77, 85.0), (0.62, -40.0))]
    for time in FRAMES:
        assert_waves(stage, time, waves)
    for time in FRAMES[:-8]:
        np.testing.assert_array_equal(
            mesh_values(stage, "/World/Water", time), mesh_values(stage, "/World/Water", time + 8)
        )


def test_cylinder_turns_five_degrees_a_frame_about_the_vertical_through_one_end() -> None:
    stage = shipped("cylinder")
    mesh = UsdGeom.Mesh.Get(stage, "/World/Cylinder")
    points, _ = mesh_values(stage, "/World/Cylinder", 1)
    ends = [points[points[:, 0] == x].mean(axis=0) for x in (0.0, 2.0)]
    place = {time: mesh.ComputeLocalToWorldTransform(time) for time in FRAMES}
    angles = []
    for time in FRAMES:
        fixed, moving = (np.array(place[time].Transform(Gf.Vec3d(*end))) for end in ends)
        # Means of 128 points rounded to float32.
        np.testing.assert_allclose(fixed[:2], 0, atol=FLOAT_ROUNDING)
        np.testing.assert_allclose(moving[2], fixed[2], atol=FLOAT_ROUNDING)
        angles.append(np.degrees(np.arctan2(moving[1], moving[0])))
    np.testing.assert_allclose(np.diff(angles), 5.0, atol=1e-5)


def volume_of(stage: Usd.Stage, path: str) -> float:
    """Volume of a mesh, which is closed, whose faces and normals are outward."""
    mesh = UsdGeom.Mesh.Get(stage, path)
    points, normals = mesh_values(stage, path, 1)
    indices, counts = (np.array(a.Get()) for a in (mesh.GetFaceVertexIndicesAttr(), mesh.GetFaceVertexCountsAttr()))
    corners = np.split(np.arange(len(indices)), np.cumsum(counts)[:-1])
    edges, volume = set(), 0.0
    for face in corners:
        polygon = indices[face]
        for edge in zip(polygon, np.roll(polygon, -1), strict=True):
            assert edge not in edges
            edges.add(edge)
        fan = points[polygon]
        areas = np.cross(fan[1:-1] - fan[0], fan[2:] - fan[0]) / 2
        volume += np.sum(areas @ fan[0]) / 3
        assert np.all(normals[face] @ areas.sum(axis=0) > 0)
    assert all((end, start) in edges for start, end in edges)
    return volume


def test_cylinder_is_closed_faces_outward_and_has_the_volume_of_its_prism() -> None:
    volume, sides = volume_of(shipped("cylinder"), "/World/Cylinder"), 128
    prism = 0.5 * sides * np.sin(2 * np.pi / sides) * 0.15**2 * 2.0
    # Every radius and length is off by a float's rounding at most: twice the radius, once the length, and the sums.
    assert volume == pytest.approx(prism, rel=8 * 2.0**-24)


def test_the_bodies_of_the_tumbler_are_closed_and_have_the_volumes_of_frusta_and_cubes() -> None:
    stage, sides = shipped("tumbler"), 96

    def frustum(low: float, high: float, height: float) -> float:
        return sides / 2 * np.sin(2 * np.pi / sides) * height * (low**2 + low * high + high**2) / 3

    # Outside less inside, base and all.
    glass = frustum(0.32, 0.38, 0.93) - frustum(0.31, 0.35, 0.85)
    expected = {"Glass": glass, "Water": frustum(0.32, 0.348, 0.61), "IceA": 0.17**3, "IceB": 0.17**3}
    for name, volume in expected.items():
        assert volume_of(stage, f"/World/{name}") == pytest.approx(volume, rel=1e-5)


def test_the_ice_of_the_tumbler_turns_six_degrees_a_frame_within_the_water() -> None:
    stage = shipped("tumbler")
    water, _ = mesh_values(stage, "/World/Water", 1)
    for name, side in (("IceA", 1), ("IceB", -1)):
        mesh = UsdGeom.Mesh.Get(stage, f"/World/{name}")
        corners, _ = mesh_values(stage, f"/World/{name}", 1)
        place = {time: mesh.ComputeLocalToWorldTransform(time) for time in FRAMES}
        ahead = np.array([place[time].TransformDir(Gf.Vec3d(1, 0, 0)) for time in FRAMES])
        angles = np.degrees(np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0])))
        np.testing.assert_allclose(np.diff(angles), side * 6.0, atol=1e-9)
        seen = np.array([[place[time].Transform(Gf.Vec3d(*corner)) for corner in corners] for time in FRAMES])
        # It swims: partly above the water, none of it in the glass.
        assert np.all(seen[..., 2].max(axis=1) > water[:, 2].max()) and seen[..., 2].min() > 0.1
        assert np.hypot(seen[..., 0], seen[..., 1]).max() < 0.31


def test_mirror_ring_reflects_inward_and_stands_still() -> None:
    stage = shipped("mirror")
    mesh = UsdGeom.Mesh.Get(stage, "/World/Ring")
    points, normals = mesh_values(stage, "/World/Ring", 1)
    assert not mesh.GetPointsAttr().ValueMightBeTimeVarying()
    quads = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 4)
    facing = np.cross(points[quads[:, 2]] - points[quads[:, 0]], points[quads[:, 3]] - points[quads[:, 1]])
    outward = points[quads].mean(axis=1) * [1, 1, 0]
    assert np.all(np.sum(facing * outward, axis=1) < 0)
    np.testing.assert_allclose(normals, -points * [1, 1, 0], atol=FLOAT_ROUNDING)
    surface = UsdShade.Shader.Get(stage, "/World/Materials/Metal/Surface")
    assert (surface.GetInput("metallic").Get(), surface.GetInput("roughness").Get()) == (1.0, 0.0)


def test_mirror_light_is_a_point_that_orbits_seven_and_a_half_degrees_a_frame() -> None:
    stage = shipped("mirror")
    lamp = UsdLux.SphereLight.Get(stage, "/World/Lamp")
    assert lamp.GetTreatAsPointAttr().Get()
    # Radiant intensity of a sphere [W/sr]; two values rounded to float32, one of them squared.
    radiant_intensity = lamp.GetIntensityAttr().Get() * np.pi * lamp.GetRadiusAttr().Get() ** 2
    assert radiant_intensity == pytest.approx(13.0, rel=3 * 2.0**-24)
    places = np.array([lamp.ComputeLocalToWorldTransform(time).ExtractTranslation() for time in FRAMES])
    # Rotations are in double precision; half steps too, because the shutter opens and closes between samples.
    np.testing.assert_allclose(np.linalg.norm(places[:, :2], axis=1), 2.2, atol=1e-12)
    np.testing.assert_allclose(places[:, 2], 1.8, atol=1e-12)
    angles = np.unwrap(np.arctan2(places[:, 1], places[:, 0]))
    np.testing.assert_allclose(np.degrees(np.diff(angles)), 7.5, atol=1e-10)
    halfway = lamp.ComputeLocalToWorldTransform(1.5).ExtractTranslation()
    assert np.hypot(halfway[0], halfway[1]) == pytest.approx(2.2, abs=1e-12)


@pytest.mark.parametrize(
    ("arguments", "option"),
    [
        (("wave", "--amplitude", "2"), "--amplitude"),
        (("wave", "--wavelength", "0"), "--wavelength"),
        (("wave", "--speed", "nan"), "--speed"),
        (("sea", "--frames", "0"), "--frames"),
        (("cylinder", "--radius", "1"), "--radius"),
        (("mirror", "--resolution", "2"), "--resolution"),
    ],
)
def test_unusable_option_is_refused_in_one_line_and_writes_nothing(
    arguments: tuple[str, ...],
    option: str,
    make_scenes: Callable[..., int],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert make_scenes(*arguments, "--out", str(tmp_path)) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"error: {option} ") and said.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
