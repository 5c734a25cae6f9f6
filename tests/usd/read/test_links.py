"""Light linking: UsdLux's collections as lists of meshes."""

import pytest
from pxr import Gf, Sdf, UsdGeom, UsdLux

from tests.usd.stages import SmallStage
from tpdwarp.scene.description import Shutter

STILL = Shutter.still(1)


@pytest.fixture
def small(tmp_path):
    small = SmallStage(tmp_path)
    for path in ("/A/One", "/A/Two", "/B/Three"):
        small.mesh(path)
    return small


def links(small):
    source = small.open()
    (light,) = source.at(STILL).lights
    assert source.warnings.messages == []
    return light.unlit, light.passed


def of(light, which="GetLightLinkCollectionAPI"):
    return getattr(UsdLux.LightAPI(light), which)()


def test_a_light_shines_on_everything_unless_told(small):
    assert links(small) == (frozenset(), frozenset())


def test_a_light_shines_on_what_its_collection_holds(small):
    collection = of(small.light)
    collection.CreateIncludeRootAttr(False)
    collection.GetIncludesRel().SetTargets(["/A"])
    collection.GetExcludesRel().SetTargets(["/A/Two"])
    assert links(small) == ({"/A/Two", "/B/Three"}, frozenset())


def test_what_is_left_out_alone_is_not_lit(small):
    of(small.light).GetExcludesRel().SetTargets(["/B"])
    assert links(small) == ({"/B/Three"}, frozenset())


def test_what_throws_no_shadow_is_passed(small):
    of(small.light, "GetShadowLinkCollectionAPI").GetExcludesRel().SetTargets(["/A/One"])
    assert links(small) == (frozenset(), {"/A/One"})


def test_a_light_without_shadows_passes_everything(small):
    UsdLux.ShadowAPI.Apply(small.light.GetPrim()).CreateShadowEnableAttr(False)
    assert links(small) == (frozenset(), {"/A/One", "/A/Two", "/B/Three"})


@pytest.mark.parametrize("count", [2, 500], ids=["few", "many together"])
def test_instances_belong_to_the_collection_of_their_instancer(small, count):
    instancer = UsdGeom.PointInstancer.Define(small.stage, "/Many")
    small.mesh("/Many/Proto")
    instancer.CreateProtoIndicesAttr([0] * count)
    instancer.CreatePositionsAttr([Gf.Vec3f(number, 0, 0) for number in range(count)])
    instancer.GetPrototypesRel().SetTargets([Sdf.Path("/Many/Proto")])
    of(small.light).GetExcludesRel().SetTargets(["/Many"])
    assert links(small)[0] == {f"/Many[{number}]/Proto" for number in range(count)}
