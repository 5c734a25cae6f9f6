"""MaterialX files that a stage references."""

import pytest
from pxr import Sdf, Usd, UsdShade

from tests.usd.stages import SmallStage
from tpdwarp.scene.description import Interaction, Shutter
from tpdwarp.settings import Settings
from tpdwarp.usd.read.stage import StageScene

STILL = Shutter.still(1)
GLASS = """<?xml version="1.0"?>
<materialx version="1.38" colorspace="lin_rec709">
  <nodegraph name="NG">
    <input name="k" type="float" value="0.5"/>
    <multiply name="twice" type="float">
      <input name="in1" type="float" interfacename="k"/><input name="in2" type="float" value="2.0"/>
    </multiply>
    <output name="weight" type="float" nodename="twice"/>
  </nodegraph>
  <standard_surface name="SR" type="surfaceshader">
    <input name="transmission" type="float" nodegraph="NG" output="weight"/>
    <input name="specular_roughness" type="float" value="0"/>
    <input name="specular_IOR" type="float" value="1.25"/>
    <input name="transmission_color" type="color3" value="0.5, 0.25, 1"/>
  </standard_surface>
  <surfacematerial name="Glass" type="material">
    <input name="surfaceshader" type="surfaceshader" nodename="SR"/>
  </surfacematerial>
</materialx>
"""


@pytest.fixture
def small(tmp_path):
    small = SmallStage(tmp_path)
    small.mesh()
    return small


def bound(small, text, path="/Looks", target="/MaterialX", material="/Looks/Materials/Glass", name="look.mtlx"):
    """The material of the mesh, bound to one from a file; and what is warned about."""
    folder = small.file.rsplit("/", 1)[0]
    if text is not None:
        with open(f"{folder}/{name}", "w", encoding="utf-8") as file:
            file.write(text)
    prim = small.stage.DefinePrim(path)
    prim.GetReferences().AddReference(f"./{name}", target) if target else prim.GetReferences().AddReference(f"./{name}")
    api = UsdShade.MaterialBindingAPI.Apply(small.stage.GetPrimAtPath("/Mesh"))
    api.GetPrim().CreateRelationship("material:binding").SetTargets([Sdf.Path(material)])
    source = small.open()
    return source.at(STILL).meshes[0].materials[0], source.warnings.messages


@pytest.mark.parametrize("target", ["/MaterialX", "", "/MaterialX/Materials/Glass"])
def test_a_material_of_a_file_is_read_through_its_graph(small, target):
    material = "/Looks" if target.endswith("Glass") else "/Looks/Materials/Glass"
    found, warnings = bound(small, GLASS, target=target, material=material)
    assert (found.interaction, found.ior, found.path) == (Interaction.DIELECTRIC, 1.25, material)
    assert found.transmittance == (0.5, 0.25, 1.0) and warnings == []


def test_a_definition_made_of_a_graph_is_laid_out_with_its_own_inputs(small):
    text = """<materialx version="1.38">
      <nodedef name="ND_half" node="half">
        <input name="of" type="float" value="1"/><output name="out" type="float"/>
      </nodedef>
      <nodegraph name="NG_half" nodedef="ND_half">
        <multiply name="m" type="float">
          <input name="in1" type="float" interfacename="of"/><input name="in2" type="float" value="0.5"/>
        </multiply>
        <output name="out" type="float" nodename="m"/>
      </nodegraph>
      <half name="h" type="float"><input name="of" type="float" value="3.0"/></half>
      <UsdPreviewSurface name="S" type="surfaceshader">
        <input name="opacity" type="float" value="0"/><input name="ior" type="float" nodename="h"/>
      </UsdPreviewSurface>
      <surfacematerial name="Glass" type="material">
        <input name="surfaceshader" type="surfaceshader" nodename="S"/>
      </surfacematerial>
    </materialx>"""
    found, warnings = bound(small, text)
    assert (found.interaction, found.ior, warnings) == (Interaction.DIELECTRIC, 1.5, [])


def test_materials_of_before_1_38_hold_their_shaders(small):
    text = """<materialx version="1.36">
      <material name="Glass"><shaderref name="SR" node="standard_surface">
        <bindinput name="transmission" type="float" value="1"/>
        <bindinput name="specular_roughness" type="float" value="0"/>
      </shaderref></material>
    </materialx>"""
    found, warnings = bound(small, text)
    assert (found.interaction, warnings) == (Interaction.DIELECTRIC, [])


def test_files_include_others_whether_the_prefix_is_declared_or_not(small):
    folder = small.file.rsplit("/", 1)[0]
    with open(f"{folder}/inner.mtlx", "w", encoding="utf-8") as file:
        file.write(GLASS)
    outer = '<materialx version="1.38"><xi:include href="inner.mtlx"/><xi:include href="stdlib.mtlx"/></materialx>'
    found, warnings = bound(small, outer)
    assert (found.interaction, warnings) == (Interaction.DIELECTRIC, [])


@pytest.mark.parametrize(
    "text", [None, "<materialx", "<html/>", "", "\x00"], ids=["missing", "cut", "html", "empty", "null"]
)
def test_a_file_that_cannot_be_read_is_said_in_one_line(small, text):
    found, warnings = bound(small, text)
    assert found.interaction == Interaction.DIFFUSE
    assert len(warnings) == 1 and "references MaterialX: " in warnings[0]


def test_a_file_that_includes_itself_ends(small):
    _, warnings = bound(small, '<materialx version="1.38"><xi:include href="look.mtlx"/></materialx>')
    assert len(warnings) == 1 and "includes itself" in warnings[0]


def test_a_graph_that_feeds_itself_ends(small):
    text = GLASS.replace('value="0.5"/>', 'nodename="twice"/>')
    text = text.replace('interfacename="k"', 'nodename="twice"')
    found, _ = bound(small, text)
    assert found is not None


def test_graphs_that_double_with_every_level_end(small):
    levels = "".join(
        f"""<nodedef name="ND_{k}" node="n{k}"><output name="out" type="float"/></nodedef>
        <nodegraph name="G_{k}" nodedef="ND_{k}">
          <n{k - 1} name="a" type="float"/><n{k - 1} name="b" type="float"/>
          <add name="c" type="float"><input name="in1" type="float" nodename="a"/>
          <input name="in2" type="float" nodename="b"/></add><output name="out" type="float" nodename="c"/>
        </nodegraph>"""
        for k in range(1, 40)
    )
    text = f"""<materialx version="1.38">{levels}<n39 name="x" type="float"/>
      <standard_surface name="S" type="surfaceshader"><input name="transmission" type="float" nodename="x"/>
      </standard_surface>
      <surfacematerial name="Glass" type="material"><input name="surfaceshader" type="surfaceshader" nodename="S"/>
      </surfacematerial></materialx>"""
    _, warnings = bound(small, text)
    assert len(warnings) == 1 and "more than 10000 nodes" in warnings[0]


def test_a_stage_that_is_handed_over_stays_as_it_is(small):
    bound(small, GLASS)
    stage = Usd.Stage.Open(small.file)
    before = stage.GetSessionLayer().ExportToString()
    material = StageScene.open(stage, Settings()).at(STILL).meshes[0].materials[0]
    assert material.interaction == Interaction.DIELECTRIC
    assert stage.GetSessionLayer().ExportToString() == before


def test_the_file_is_one_of_those_that_frames_are_made_of(small):
    bound(small, GLASS)
    assert any(path.endswith("look.mtlx") for path in small.open().used_files())


def test_textures_lie_beside_the_file_that_names_them(small, tmp_path):
    text = """<materialx version="1.38" fileprefix="maps/">
      <image name="i" type="color3"><input name="file" type="filename" value="a.png" colorspace="srgb_texture"/></image>
      <standard_surface name="S" type="surfaceshader">
        <input name="base_color" type="color3" nodename="i"/>
      </standard_surface>
      <surfacematerial name="Glass" type="material">
        <input name="surfaceshader" type="surfaceshader" nodename="S"/>
      </surfacematerial>
    </materialx>"""
    bound(small, text)
    stage = small.open().stage
    inputs = [
        attribute.Get()
        for prim in stage.Traverse()
        for attribute in prim.GetAttributes()
        if attribute.GetTypeName() == Sdf.ValueTypeNames.Asset and attribute.Get()
    ]
    assert [value.path for value in inputs] == [str(tmp_path / "maps/a.png")]
