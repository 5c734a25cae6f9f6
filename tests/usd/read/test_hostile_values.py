"""Every numeric attribute of the schemas that are rendered, with values that mean nothing: the stage is rendered."""

import math

import numpy as np
import pytest
from pxr import Gf, Sdf, UsdGeom, UsdLux

from tests.usd.stages import SmallStage
from tpdwarp.scene.description import Shutter
from tpdwarp.settings import Settings

TYPES = Sdf.ValueTypeNames
REALS = (math.nan, math.inf, -math.inf, 0.0, -1.0, 1e30, 1e-30)
WHOLES = (0, -1, 2**31 - 1)
SHUTTERS = Shutter.still(1), Shutter(1, 1, 2)
LIGHTS = ("DistantLight", "SphereLight", "RectLight", "DiskLight", "CylinderLight", "DomeLight", "DomeLight_1")
GLASS = {
    "UsdPreviewSurface": {"opacity": 0.0},
    "ND_standard_surface_surfaceshader": {"transmission": 1.0},
    "ND_open_pbr_surface_surfaceshader": {"transmission_weight": 1.0},
    "ND_gltf_pbr_surfaceshader": {"transmission": 1.0, "metallic": 0.0},
}
NUMBERS = {
    "UsdPreviewSurface": ("ior", "roughness", "opacity", "opacityThreshold", "metallic", "clearcoat"),
    "ND_standard_surface_surfaceshader": (
        "specular_IOR", "specular_roughness", "transmission_depth", "transmission_dispersion", "base", "metalness",
        "transmission", "emission", "coat", "opacity",
    ),
    "ND_open_pbr_surface_surfaceshader": (
        "specular_ior", "specular_roughness", "transmission_depth", "transmission_dispersion_scale",
        "transmission_dispersion_abbe_number", "base_weight", "base_metalness", "emission_luminance", "coat_weight",
    ),
    "ND_gltf_pbr_surfaceshader": ("ior", "roughness", "attenuation_distance", "dispersion", "alpha", "metallic"),
}  # fmt: skip
COLOURS = {
    "UsdPreviewSurface": ("diffuseColor", "emissiveColor"),
    "ND_standard_surface_surfaceshader": ("base_color", "transmission_color", "emission_color", "coat_color"),
    "ND_open_pbr_surface_surfaceshader": ("base_color", "transmission_color", "emission_color", "coat_color"),
    "ND_gltf_pbr_surfaceshader": ("base_color", "attenuation_color", "emissive"),
}


@pytest.fixture
def small(tmp_path):
    """A floor and a pane of glass."""
    small = SmallStage(tmp_path)
    small.mesh("/Floor")
    small.preview("/Clear", opacity=0.0)
    small.bind(small.mesh("/Pane"), "/Clear")
    return small


def filled(value, number):
    """A vector, quaternion or matrix of the kind of ``value`` that holds nothing but a number; None where it cannot."""
    held = np.array(value)
    if held.dtype.kind not in "fiu":
        return None
    if isinstance(value, Gf.Quath | Gf.Quatf | Gf.Quatd):
        return type(value)(*[number] * 4)
    try:
        return type(value)(*[number] * held.size)
    except (OverflowError, TypeError):
        return None


def hostile(attribute):
    """Values of an attribute's type that mean nothing, with how they are called."""
    kind = attribute.GetTypeName()
    one = kind.scalarType.defaultValue if kind.isArray else kind.defaultValue
    held = np.array(one)
    found = {str(number): filled(one, number) for number in (REALS if held.dtype.kind == "f" else WHOLES)}
    found = {name: value for name, value in found.items() if value is not None}
    if not kind.isArray:
        return found
    now = list(attribute.Get(1.0) or ())
    arrays = {name: [value] * max(len(now), 1) for name, value in found.items()}
    arrays |= {f"the last {name}": [*now[:-1], value] for name, value in found.items()}
    return arrays | {"none": [], "too few": now[:-1], "too many": [*now, one, one]}


def many(stage, prim, names=None):
    """Copies of a prim, each with one attribute that holds what means nothing."""
    layer = stage.GetRootLayer()
    path = prim.GetPath()
    numeric = [a for a in prim.GetAttributes() if np.array(a.GetTypeName().scalarType.defaultValue).dtype.kind in "fiu"]
    made = 0
    for attribute in numeric:
        if names is not None and attribute.GetName() not in names:
            continue
        for value in hostile(attribute).values():
            made += 1
            copy = path.ReplaceName(f"{path.name}_{made}")
            Sdf.CopySpec(layer, path, layer, copy)
            changed = stage.GetAttributeAtPath(copy.AppendProperty(attribute.GetName()))
            times = changed.GetTimeSamples()
            changed.Set(value, *times[:1])
    assert made
    return made


def checked(scene):
    """What is read of a stage over a still and a moving shutter, all of it finite."""
    assert scene.shutter(1, Settings()).exposure >= 0
    assert min(scene.resolution()) > 0
    for shutter in SHUTTERS:
        found = scene.at(shutter)
        for mesh in found.meshes:
            for values in (mesh.points, mesh.normals, mesh.colors, mesh.coordinates):
                assert values is None or np.isfinite(values).all(), mesh.path
            assert all(0 < m.ior < math.inf and np.isfinite([m.roughness, *m.color]).all() for m in mesh.materials)
        assert {"/Floor", "/Pane"} <= {mesh.path for mesh in found.meshes}
        for light in found.lights:
            assert np.isfinite([*light.power, *light.position]).all() and min(light.power) >= 0, light.path
        assert np.isfinite([*found.camera.window, *found.camera.position, found.camera.exposure_scale]).all()
    scene.describe()
    return found


@pytest.mark.parametrize("kind", LIGHTS)
def test_lights(small, kind):
    light = getattr(UsdLux, kind).Define(small.stage, "/Lamp")
    if kind not in ("DomeLight", "DomeLight_1", "DistantLight"):
        UsdLux.ShapingAPI.Apply(light.GetPrim())
    many(small.stage, light.GetPrim())
    checked(small.open())


def test_cameras(small):
    camera = UsdGeom.Camera.Define(small.stage, "/Camera")
    camera.AddTranslateOp().Set(Gf.Vec3d(0, 0, 5))
    many(small.stage, camera.GetPrim())
    scene = small.open()
    for path in [prim.GetPath() for prim in small.stage.Traverse() if prim.IsA(UsdGeom.Camera)]:
        one = small.open(camera=str(path))
        assert min(one.resolution()) > 0 and one.shutter(1, Settings()).exposure >= 0
        for shutter in SHUTTERS:
            found = one.camera_over(shutter)
            assert np.isfinite([*found.window, *found.position, found.near, found.far, found.exposure_scale]).all()
    assert len(scene.at(SHUTTERS[0]).meshes) == 2


@pytest.mark.parametrize("kind", GLASS)
def test_materials(small, kind):
    made = 0
    for names, type_ in ((NUMBERS[kind], TYPES.Float), (COLOURS[kind], TYPES.Color3f)):
        for name in names:
            for number in (*REALS, 2.0):
                made += 1
                shader = small.preview(f"/M{made}", **GLASS[kind])
                shader.CreateIdAttr(kind)
                shader.CreateInput(name, type_).Set(number if type_ == TYPES.Float else Gf.Vec3f(number))
                small.bind(small.mesh(f"/Pane{made}"), f"/M{made}")
    checked(small.open())


@pytest.mark.parametrize(
    "kind", ["Sphere", "Cube", "Cylinder", "Cylinder_1", "Cone", "Capsule", "Capsule_1", "Plane"]
)
def test_shapes(small, kind):
    many(small.stage, getattr(UsdGeom, kind).Define(small.stage, "/Shape").GetPrim())
    checked(small.open())


@pytest.mark.parametrize("scheme", ["none", "catmullClark"])
def test_meshes(small, scheme):
    mesh = small.mesh("/Mesh", scheme=scheme)
    mesh.GetPointsAttr().Set(mesh.GetPointsAttr().Get(), 1)
    mesh.CreateVelocitiesAttr().Set([Gf.Vec3f(0, 0, 1)] * 4, 1)
    mesh.CreateAccelerationsAttr().Set([Gf.Vec3f(0, 0, 1)] * 4, 1)
    mesh.CreateNormalsAttr([Gf.Vec3f(0, 0, 1)] * 4)
    mesh.CreateHoleIndicesAttr([0])
    mesh.CreateCreaseIndicesAttr([0, 1])
    mesh.CreateCreaseLengthsAttr([2])
    mesh.CreateCreaseSharpnessesAttr([2.0])
    mesh.CreateCornerIndicesAttr([2])
    mesh.CreateCornerSharpnessesAttr([1.0])
    mesh.CreateDisplayColorAttr([Gf.Vec3f(0.5)])
    mesh.CreateDisplayOpacityAttr([0.5])
    many(small.stage, mesh.GetPrim())
    checked(small.open())


def test_points_and_curves(small):
    points = UsdGeom.Points.Define(small.stage, "/Points")
    points.CreatePointsAttr([Gf.Vec3f(0), Gf.Vec3f(1)])
    points.CreateWidthsAttr([0.1, 0.2])
    curves = UsdGeom.BasisCurves.Define(small.stage, "/Curves")
    nurbs = UsdGeom.NurbsCurves.Define(small.stage, "/Nurbs")
    hermite = UsdGeom.HermiteCurves.Define(small.stage, "/Hermite")
    for each in (curves, nurbs, hermite):
        each.CreatePointsAttr([Gf.Vec3f(k, k % 2, 0) for k in range(4)])
        each.CreateCurveVertexCountsAttr([4])
        each.CreateWidthsAttr([0.1])
        each.SetWidthsInterpolation("constant")
    hermite.CreateTangentsAttr([Gf.Vec3f(1, 0, 0)] * 4)
    nurbs.CreateOrderAttr([4])
    nurbs.CreateKnotsAttr([0, 0, 0, 0, 1, 1, 1, 1])
    nurbs.CreateRangesAttr([Gf.Vec2d(0, 1)])
    nurbs.CreatePointWeightsAttr([1.0] * 4)
    for each in (points, curves, nurbs, hermite):
        many(small.stage, each.GetPrim())
    checked(small.open())


def test_patches_and_solids(small):
    patch = UsdGeom.NurbsPatch.Define(small.stage, "/Patch")
    patch.CreatePointsAttr([Gf.Vec3f(x, y, 0) for y in (0, 1) for x in (0, 1)])
    for name, value in (("VertexCount", 2), ("Order", 2), ("Knots", [0, 0, 1, 1]), ("Range", Gf.Vec2d(0, 1))):
        for side in "UV":
            getattr(patch, f"Create{side}{name}Attr")(value)
    patch.CreatePointWeightsAttr([1.0] * 4)
    solid = UsdGeom.TetMesh.Define(small.stage, "/Solid")
    solid.CreatePointsAttr([Gf.Vec3f(0), Gf.Vec3f(1, 0, 0), Gf.Vec3f(0, 1, 0), Gf.Vec3f(0, 0, 1)])
    solid.CreateTetVertexIndicesAttr([Gf.Vec4i(0, 1, 2, 3)])
    solid.CreateSurfaceFaceVertexIndicesAttr(
        [Gf.Vec3i(0, 2, 1), Gf.Vec3i(0, 1, 3), Gf.Vec3i(0, 3, 2), Gf.Vec3i(1, 2, 3)]
    )
    for each in (patch, solid):
        many(small.stage, each.GetPrim())
    checked(small.open())


def test_instancers(small):
    instancer = UsdGeom.PointInstancer.Define(small.stage, "/Many")
    UsdGeom.Cube.Define(small.stage, "/Many/Cube")
    instancer.CreatePrototypesRel().SetTargets(["/Many/Cube"])
    instancer.CreateProtoIndicesAttr([0, 0])
    instancer.CreatePositionsAttr([Gf.Vec3f(0), Gf.Vec3f(3, 0, 0)])
    instancer.CreateOrientationsAttr([Gf.Quath(1)] * 2)
    instancer.CreateScalesAttr([Gf.Vec3f(1)] * 2)
    instancer.CreateVelocitiesAttr([Gf.Vec3f(0)] * 2)
    instancer.CreateAngularVelocitiesAttr([Gf.Vec3f(0)] * 2)
    instancer.CreateAccelerationsAttr([Gf.Vec3f(0)] * 2)
    instancer.CreateIdsAttr([0, 1])
    instancer.CreateInvisibleIdsAttr([1])
    many(small.stage, instancer.GetPrim())
    checked(small.open())


def test_transforms(small):
    shape = UsdGeom.Xformable(small.mesh("/Moved"))
    shape.AddTranslateOp().Set(Gf.Vec3d(0))
    shape.AddRotateXYZOp().Set(Gf.Vec3f(0))
    shape.AddOrientOp().Set(Gf.Quatf(1))
    shape.AddScaleOp().Set(Gf.Vec3f(1))
    shape.AddTransformOp().Set(Gf.Matrix4d(1))
    UsdGeom.MotionAPI.Apply(shape.GetPrim()).CreateMotionBlurScaleAttr(1.0)
    many(small.stage, shape.GetPrim())
    lamp = UsdLux.SphereLight.Define(small.stage, "/Lamp")
    UsdGeom.Xformable(lamp).AddTransformOp().Set(Gf.Matrix4d(1))
    many(small.stage, lamp.GetPrim(), ["xformOp:transform"])
    checked(small.open())


@pytest.mark.parametrize(
    "name, value",
    [
        *(("timeCodesPerSecond", v) for v in (0.0, -1.0, math.nan, math.inf, 1e30)),
        *(("framesPerSecond", v) for v in (0.0, -1.0, math.nan, math.inf, 1e30)),
        *(("metersPerUnit", v) for v in (0.0, -1.0, math.nan, math.inf)),
        *(("startTimeCode", v) for v in (math.nan, math.inf, -math.inf)),
        *(("endTimeCode", v) for v in (math.nan, math.inf, -5.0)),
        *(("upAxis", v) for v in ("X", "", "up")),
    ],
)
def test_what_a_stage_says_of_itself(small, name, value):
    small.stage.GetRootLayer().pseudoRoot.SetInfo(name, value)
    scene = small.open()
    checked(scene)
    assert all(math.isfinite(time) for time in (scene.start, scene.end)) and scene.end >= scene.start
    assert scene.up_axis in ("Y", "Z") and 0 < scene.time_codes_per_second < math.inf
