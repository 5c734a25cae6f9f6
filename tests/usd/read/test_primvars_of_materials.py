"""Inputs of materials that are primvars: one value over a mesh is that value, and meshes differ by it."""

from __future__ import annotations

import pytest
from pxr import Gf, Sdf, UsdGeom, UsdShade

from tests.usd.stages import SmallStage, mesh_named, set_inputs
from tpdwarp.scene.description import Interaction, Shutter

STILL = Shutter.still(1)
FLOAT, COLOR = Sdf.ValueTypeNames.Float, Sdf.ValueTypeNames.Color3f


@pytest.fixture
def small(tmp_path):
    return SmallStage(tmp_path)


def read_by(small, shader, input_name, primvar, kind="UsdPrimvarReader_float", of_type=FLOAT, **fallback):
    """Feeds an input by a primvar."""
    reader = UsdShade.Shader.Define(small.stage, f"{shader.GetPath().GetParentPath()}/Read_{input_name}")
    reader.CreateIdAttr(kind)
    name = "geomprop" if kind.startswith("ND_") else "varname"
    reader.CreateInput(name, Sdf.ValueTypeNames.String).Set(primvar)
    set_inputs(reader, **fallback)
    shader.CreateInput(input_name, of_type).ConnectToSource(reader.ConnectableAPI(), "result")


def given(prim, name, value, of_type=FLOAT, interpolation="constant"):
    UsdGeom.PrimvarsAPI(prim).CreatePrimvar(name, of_type, interpolation).Set(value)


def test_meshes_of_one_material_differ_by_their_constant_primvars(small):
    shader = small.preview("/Glass", opacity=0.0)
    read_by(small, shader, "ior", "index", fallback=1.2)
    for name, index in (("/A", 1.4), ("/B", 1.7), ("/C", None)):
        mesh = small.mesh(name)
        small.bind(mesh, "/Glass")
        if index:
            given(mesh, "index", index)
    group = UsdGeom.Xform.Define(small.stage, "/Group")
    given(group, "index", [1.9], Sdf.ValueTypeNames.FloatArray)
    small.bind(small.mesh("/Group/D"), "/Glass")
    source = small.open()
    scene = source.at(STILL)
    found = {path: mesh_named(scene, path).materials[0].ior for path in ("/A", "/B", "/C", "/Group/D")}
    assert found == pytest.approx({"/A": 1.4, "/B": 1.7, "/C": 1.2, "/Group/D": 1.9})
    # Where there is none the fallback is what the stage asks for.
    assert source.warnings.messages == []


def test_a_constant_primvar_may_decide_what_a_surface_is_and_change_with_time(small):
    shader = small.preview("/Look")
    read_by(small, shader, "opacity", "there", fallback=1.0)
    for name, values in (("/Clear", {1: 0.0}), ("/Solid", {1: 1.0}), ("/Later", {1: 1.0, 2: 0.0})):
        mesh = small.mesh(name)
        small.bind(mesh, "/Look")
        primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("there", FLOAT, "constant")
        for time, value in values.items():
            primvar.Set(value, time)
    source = small.open()
    for time, clear in ((1, {"/Clear"}), (2, {"/Clear", "/Later"}), (1, {"/Clear"})):
        meshes = source.at(Shutter.still(time)).meshes
        assert {m.path for m in meshes if m.materials[0].interaction != Interaction.DIFFUSE} == clear
    assert source.warnings.messages == []


def test_colours_of_metal_come_from_materialx_readers_and_copies_do_not_share_them(small):
    for copy in ("/Assets/One", "/Assets/Two"):
        material = UsdShade.Material.Define(small.stage, f"{copy}/Metal")
        shader = UsdShade.Shader.Define(small.stage, f"{copy}/Metal/S")
        shader.CreateIdAttr("ND_standard_surface_surfaceshader")
        set_inputs(shader, metalness=1.0, base=1.0, specular_roughness=0.0)
        read_by(small, shader, "base_color", "tint", "ND_geompropvalue_color3", COLOR)
        material.CreateSurfaceOutput("mtlx").ConnectToSource(shader.ConnectableAPI(), "out")
    for name, color in (("One", (0.9, 0.5, 0.1)), ("Two", (0.2, 0.3, 0.9))):
        mesh = small.mesh(f"/{name}")
        given(mesh, "tint", Gf.Vec3f(*color), COLOR)
        small.bind(mesh, f"/Assets/{name}/Metal")
    scene = small.open().at(STILL)
    for name, color in (("One", (0.9, 0.5, 0.1)), ("Two", (0.2, 0.3, 0.9))):
        material = mesh_named(scene, f"/{name}").materials[0]
        assert material.interaction == Interaction.MIRROR and material.color == pytest.approx(color)


@pytest.mark.parametrize("of_type", ["another size", "of each point", "no number"])
def test_what_is_no_value_of_that_kind_leaves_the_fallback(of_type, small):
    shader = small.preview("/Glass", opacity=0.0)
    read_by(small, shader, "ior", "index", fallback=1.2)
    mesh = small.mesh("/A")
    small.bind(mesh, "/Glass")
    if of_type == "another size":
        given(mesh, "index", Gf.Vec3f(1.4), COLOR)
    elif of_type == "of each point":
        given(mesh, "index", [1.3, 1.4, 1.5, 1.6], Sdf.ValueTypeNames.FloatArray, "vertex")
    else:
        given(mesh, "index", float("nan"))
    source = small.open()
    assert mesh_named(source.at(STILL), "/A").materials[0].ior == pytest.approx(1.2)
    assert any("its fallback is used" in line for line in source.warnings.messages)
