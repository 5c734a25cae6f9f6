"""What mutated stages have found, each as the smallest change to a small stage."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from tests.small_stage import write_stage
from tpdwarp.cli import main
from usd_scenes.hostile.judge import faults_of_image

QUICK = ["--photons", "64", "--samples", "1", "-w", "8", "-f", "1"]


def value(path: str, of_type: str, held: object) -> Callable[[Sdf.Layer], None]:
    """Authors an attribute anew, whatever was there."""

    def change(layer: Sdf.Layer) -> None:
        where = Sdf.Path(path)
        prim = layer.GetPrimAtPath(where.GetPrimPath())
        if where.name in prim.properties:
            del prim.properties[where.name]
        made = Sdf.AttributeSpec(prim, where.name, Sdf.ValueTypeNames.Find(of_type))
        made.default = held

    return change


def stage_field(name: str, held: object) -> Callable[[Sdf.Layer], None]:
    return lambda layer: layer.pseudoRoot.SetInfo(name, held)


def samples(path: str, of_type: str, held: dict[float, object]) -> Callable[[Sdf.Layer], None]:
    def change(layer: Sdf.Layer) -> None:
        value(path, of_type, Sdf.ValueTypeNames.Find(of_type).defaultValue)(layer)
        for time, one in held.items():
            layer.SetTimeSample(Sdf.Path(path), time, one)

    return change


def tinted_mirror(layer: Sdf.Layer) -> None:
    for name, of_type, held in (
        ("opacity", "float", 1.0),
        ("metallic", "float", 1.0),
        ("roughness", "float", 0.0),
        ("diffuseColor", "color3f", Gf.Vec3f(0, 0, 5)),
    ):
        value(f"/World/Surface/Shader.inputs:{name}", of_type, held)(layer)


def instancer_of_itself(layer: Sdf.Layer) -> None:
    stage = Usd.Stage.Open(layer)
    instancer = UsdGeom.PointInstancer.Define(stage, "/World/Drops")
    instancer.GetPrototypesRel().SetTargets(["/World/Drops"])
    instancer.CreateProtoIndicesAttr([0])
    instancer.CreatePositionsAttr([Gf.Vec3f(0)])


def unknown_op_in_a_prototype(layer: Sdf.Layer) -> None:
    stage = Usd.Stage.Open(layer)
    instancer = UsdGeom.PointInstancer.Define(stage, "/World/Drops")
    UsdGeom.Mesh.Define(stage, "/World/Drops/Chip")
    instancer.GetPrototypesRel().SetTargets(["/World/Drops/Chip"])
    instancer.CreateProtoIndicesAttr([0])
    instancer.CreatePositionsAttr([Gf.Vec3f(0)])
    value("/World/Drops/Chip.xformOpOrder", "token[]", ["vertex"])(layer)


def without_meshes(layer: Sdf.Layer) -> None:
    for path in ("/World/Pane", "/World/Floor"):
        samples(f"{path}.visibility", "token", {1: "invisible", 2: "inherited"})(layer)


def far_vertex(time: float) -> Callable[[Sdf.Layer], None]:
    def change(layer: Sdf.Layer) -> None:
        points = [Gf.Vec3f(*point) for point in layer.QueryTimeSample(Sdf.Path("/World/Pane.points"), 1)]
        points[0] = Gf.Vec3f(0, 1e38, 0)
        layer.SetTimeSample(Sdf.Path("/World/Pane.points"), time, Vt.Vec3fArray(points))

    return change


def blurred_backwards(layer: Sdf.Layer) -> None:
    schemas = Sdf.TokenListOp.CreateExplicit(["MaterialBindingAPI", "MotionAPI"])
    layer.GetPrimAtPath("/World/Pane").SetInfo("apiSchemas", schemas)
    value("/World/Pane.motion:blurScale", "float", -1.0)(layer)


REFUSED = {
    "a pane that leaves for infinity within the shutter": (far_vertex(2), "/World/Pane"),
    "a pane that is nowhere": (
        lambda layer: (
            value("/World/Pane.xformOp:scale", "double3", Gf.Vec3d(1e31))(layer),
            value("/World/Pane.xformOpOrder", "token[]", ["xformOp:scale"])(layer),
        ),
        "/World/Pane",
    ),
}


def changed(folder, change) -> str:
    file = write_stage(folder / "scene.usda")
    layer = Sdf.Layer.FindOrOpen(file)
    layer.Reload()
    change(layer)
    layer.Save()
    return file


@pytest.mark.parametrize("name", REFUSED)
def test_it_is_refused_in_one_line_that_says_where(name, tmp_path, capfd):
    change, where = REFUSED[name]
    file = changed(tmp_path, change)
    assert main(["render", file, str(tmp_path / "a.####.exr"), *QUICK]) == 2
    (line,) = [line for line in capfd.readouterr().err.splitlines() if not line.startswith("warning: ")]
    assert line.startswith(f"error: {file}: ") and where in line and "internal" not in line


RENDERED = {
    "stops beyond all numbers": (value("/World/Sun.inputs:exposure", "float", 1e12), "/World/Sun: "),
    "a shutter of an age": (value("/World/Camera.shutter:close", "double", 1e300), "/World/Camera.shutter:close"),
    "clipping from a distance to the same": (
        value("/World/Camera.clippingRange", "float2", Gf.Vec2f(1, 1)),
        "/World/Camera.clippingRange",
    ),
    "an aperture of no height to speak of": (
        value("/World/Camera.verticalAperture", "float", 1e-45),
        "/World/Camera: its apertures",
    ),
    "a picture of 10¹² rows": (
        value("/World/Camera.verticalAperture", "float", 3e12),
        "/World/Camera: its aperture makes an image",
    ),
    "a place that is no number": (
        value("/World/Camera.xformOp:translate", "double3", Gf.Vec3d(float("nan"))),
        "/World/Camera: its transform",
    ),
    "a scene of 10³⁰": (
        lambda layer: (
            value("/World.xformOp:scale", "double3", Gf.Vec3d(1e30))(layer),
            value("/World.xformOpOrder", "token[]", ["xformOp:scale"])(layer),
        ),
        "/World/Camera: its transform",
    ),
    "blur by less than nothing": (blurred_backwards, "/World/Pane.motion:blurScale"),
    "an up axis to the side": (stage_field("upAxis", "X"), "upAxis"),
    "no time codes in a second": (stage_field("timeCodesPerSecond", 1e-30), "timeCodesPerSecond"),
    "frames beyond counting": (stage_field("framesPerSecond", 1e12), "framesPerSecond"),
    "an op without its attribute's type": (
        value("/World/Camera.xformOp:translate", "string", "up"),
        "/World/Camera.xformOp:translate",
    ),
    "a power that is a string": (value("/World/Sun.inputs:intensity", "string", "9"), "/World/Sun.inputs:intensity"),
    "a power that is a pair": (value("/World/Sun.inputs:intensity", "int2", Gf.Vec2i(1)), "inputs:intensity"),
    "a colour that is a number": (value("/World/Sun.inputs:color", "float", 1.0), "/World/Sun.inputs:color"),
    "an index of refraction of nothing": (
        value("/World/Surface/Shader.inputs:ior", "point3f[]", []),
        "/World/Surface/Shader.inputs:ior",
    ),
    "an index of refraction that is text": (value("/World/Surface/Shader.inputs:ior", "token", ""), "inputs:ior"),
    "a shutter of three numbers": (value("/World/Camera.shutter:open", "float3", Gf.Vec3f(0)), "shutter:open"),
    "a mirror that would give more than it gets": (tinted_mirror, "limited to 1"),
    "an instancer that is its own prototype": (instancer_of_itself, "holds itself"),
    "a frame without a mesh": (without_meshes, "no surface that reflects"),
    "a pane that leaves for infinity in a later frame": (far_vertex(3), ""),
    "points in the plane": (value("/World/Floor.points", "float2[]", [Gf.Vec2f(1)] * 4), "/World/Floor.points"),
    "a subdivision scheme that is blocked": (value("/World/Floor.subdivisionScheme", "token", Sdf.ValueBlock()), ""),
}


@pytest.mark.parametrize("name", RENDERED)
def test_it_is_rendered_and_what_was_made_of_it_is_said(name, tmp_path, capfd):
    change, said = RENDERED[name]
    file = changed(tmp_path, change)
    out = tmp_path / "a.0001.exr"
    assert main(["render", file, str(tmp_path / "a.####.exr"), *QUICK, "--stats", str(tmp_path / "a.json")]) == 0
    assert list(faults_of_image(out)) == []
    lines = capfd.readouterr().err.splitlines()
    assert all(line.startswith("warning: ") for line in lines)
    assert said in " ".join(lines)


def test_what_usd_says_of_prototypes_is_a_warning_of_ours(tmp_path, capfd):
    file = changed(tmp_path, unknown_op_in_a_prototype)
    capfd.readouterr()
    # At the default time nothing varies, so that the prototypes are looked at before any frame is read.
    assert main(["photons", file, str(tmp_path / "a.usda"), "-d", "--photons", "64"]) == 0
    lines = capfd.readouterr().err.splitlines()
    assert any("xformOp 'vertex'" in line for line in lines)
    assert all(line.startswith("warning: ") for line in lines)


def test_errors_of_usd_come_without_its_innards(tmp_path, capfd):
    file = tmp_path / "scene.usda"
    file.write_text('#usda 1.0\n\ndef Xform "A"\n{\n    rel b = [</A, </B>]\n}\n')
    assert main(["info", str(file)]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert "parse error" in line and "pxrInternal" not in line


def test_colours_are_not_negative_on_the_edge_of_a_triangle(tmp_path):
    def corners(layer: Sdf.Layer) -> None:
        colors = [Gf.Vec3f(1, 0, 0), Gf.Vec3f(0, 1, 0), Gf.Vec3f(0, 0, 1), Gf.Vec3f(1, 1, 1)]
        value("/World/Floor.primvars:displayColor", "color3f[]", colors)(layer)
        layer.GetAttributeAtPath("/World/Floor.primvars:displayColor").SetInfo("interpolation", "vertex")

    file = changed(tmp_path, corners)
    assert main(["render", file, str(tmp_path / "a.####.exr"), *QUICK]) == 0
    assert list(faults_of_image(tmp_path / "a.0001.exr")) == []
