"""Light filters: those that scale a light do, those that filter nothing are not mentioned, and the others are named."""

from __future__ import annotations

import pytest
from pxr import Gf, Sdf, UsdGeom, UsdLux

from tests.usd.stages import SmallStage
from tpdwarp.scene.description import Shutter

STILL = Shutter.still(1)


@pytest.fixture
def small(tmp_path):
    stage = SmallStage(tmp_path)
    stage.mesh()
    return stage


def filtered(small, type_name="MoonrayLightFilter", path="/Filter", **attributes):
    prim = small.stage.DefinePrim(path, type_name)
    for name, value in attributes.items():
        kind = {bool: Sdf.ValueTypeNames.Bool, str: Sdf.ValueTypeNames.Token, float: Sdf.ValueTypeNames.Float}
        of_color = Sdf.ValueTypeNames.Color3f
        prim.CreateAttribute(name.replace("__", ":"), kind.get(type(value), of_color)).Set(value)
    UsdLux.LightAPI(small.light.GetPrim()).CreateFiltersRel().AddTarget(path)
    return prim


def lit(small, shutter=STILL):
    source = small.open()
    (light,) = source.at(shutter).lights
    return light.power, [line for line in source.warnings.messages if "filter" in line]


def test_filters_of_intensity_multiply_the_light_in_any_renderers_words(small):
    color = Gf.Vec3f(0.5, 1.0, 0.25)
    filtered(small, moonray__class="IntensityLightFilter", moonray__intensity=3.0, moonray__color=color)
    filtered(small, "PxrIntMultLightFilter", "/Other", inputs__ri__lightFilter__exposure=-1.0)
    assert lit(small) == (pytest.approx((0.75, 1.5, 0.375)), [])


def test_a_filter_that_changes_has_its_mean_over_the_shutter(small):
    prim = filtered(small, moonray__class="IntensityLightFilter", moonray__intensity=1.0)
    prim.GetAttribute("moonray:intensity").Set(0.0, 1)
    prim.GetAttribute("moonray:intensity").Set(1.0, 2)
    assert lit(small, Shutter(1, 1, 2))[0] == pytest.approx((0.5,) * 3)


@pytest.mark.parametrize("how", ["inactive", "invisible", "off", "generic", "one"])
def test_what_filters_nothing_is_not_mentioned(how, small):
    kind = "" if how == "generic" else "RodLightFilter"
    if how == "one":
        filtered(small, moonray__class="IntensityLightFilter", moonray__intensity=1.0)
    else:
        prim = filtered(small, "LightFilter", moonray__class=kind, moonray__on=how != "off")
        if how == "inactive":
            prim.SetActive(False)
        if how == "invisible":
            UsdGeom.Imageable(prim).MakeInvisible()
    assert lit(small) == ((1.0,) * 3, [])


def test_the_others_are_named_with_their_kind_and_what_is_not_there_is_said(small):
    filtered(small, moonray__class="RodLightFilter", moonray__intensity=2.0)
    filtered(small, path="/Inverted", moonray__class="IntensityLightFilter", moonray__invert=True)
    UsdLux.LightAPI(small.light.GetPrim()).GetFiltersRel().AddTarget("/Nowhere")
    power, said = lit(small)
    assert power == (1.0,) * 3 and len(said) == 3
    for words in ("RodLightFilter (/Filter), is not", "IntensityLightFilter (/Inverted)", "/Nowhere, which does"):
        assert any(words in line for line in said), words
