"""Light groups: which lights are in which, and that their light adds up to all there is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdLux

import tpdwarp
from tests.small_stage import write_stage
from tpdwarp.errors import InputError
from tpdwarp.io.images import read_image, read_stored
from tpdwarp.rendering.light_groups import LightGroups

FRAME = 2
SMALL = {"photons": 1024, "samples": 1, "image_width": 24, "threads": 1}
LIGHTS = {"/World/Key": "", "/World/Rig/KeyRim": "rims", "/World/Rig/Fill": "", "/World/Top": "sun light"}


class Lights:
    file = "lights.usda"

    def light_groups(self) -> dict[str, str]:
        return LIGHTS


def groups(*asked: str) -> tuple[dict[str, str], tuple[str, ...]]:
    found = LightGroups.of(asked, Lights())
    return {path.rpartition("/")[2]: name for path, name in found.group_of.items()}, found.names


def test_lights_are_grouped_by_name_path_and_what_they_name_themselves():
    rest = {"Fill": "other", "Top": "other"}
    assert groups("key=Key*") == ({"Key": "key", "KeyRim": "key", **rest}, ("key", "other"))
    rig = {"Key": "other", "KeyRim": "rig", "Fill": "rig", "Top": "other"}
    assert groups("rig=/World/Rig") == (rig, ("rig", "other"))
    own = {"Key": "Key", "KeyRim": "rims", "Fill": "Fill", "Top": "sun_light"}
    assert groups("auto") == (own, ("Key", "rims", "Fill", "sun_light"))
    # The first that fits counts.
    mixed = {"Key": "a", "KeyRim": "b", "Fill": "Fill", "Top": "sun_light"}
    assert groups("a=/World/Key", "b=Key*", "auto") == (mixed, ("a", "b", "Fill", "sun_light"))
    assert groups() == ({}, ())


def test_patterns_that_match_no_light_are_refused():
    with pytest.raises(InputError, match=r"no light matches light_groups sky=Dome.*/World/Key"):
        groups("sky=Dome*")


@pytest.fixture(scope="module")
def lit(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The small stage with a red lamp beside its sun."""
    path = write_stage(tmp_path_factory.mktemp("lit") / "small.usda")
    stage = Usd.Stage.Open(path)
    lamp = UsdLux.SphereLight.Define(stage, "/World/Lamp")
    lamp.CreateTreatAsPointAttr(True)
    lamp.CreateRadiusAttr(0.0)
    lamp.CreateIntensityAttr(20.0)
    lamp.CreateColorAttr(Gf.Vec3f(1, 0.25, 0))
    lamp.AddTranslateOp().Set(Gf.Vec3d(0.5, 0.3, 6))
    lamp.GetPrim().CreateAttribute("inputs:karma:light:lpetag", Sdf.ValueTypeNames.String).Set("practicals")
    stage.Save()
    return path


def rgb(channels: dict[str, np.ndarray], layer: str) -> np.ndarray:
    return np.stack([channels[f"{layer}.{c}"] for c in "RGB"], axis=-1).astype(np.float64)


def test_groups_add_up_to_the_caustic_and_each_is_that_of_its_lights(lit):
    apart = tpdwarp.render_frame(lit, FRAME, **SMALL, aovs=["caustic", "irradiance"], light_groups=["auto"]).channels
    for layer in ("caustic", "irradiance"):
        whole, sun, lamp = (rgb(apart, name) for name in (layer, f"{layer}_Sun", f"{layer}_practicals"))
        assert sun.any() and lamp.any()
        # Single precision of each.
        np.testing.assert_allclose(sun + lamp, whole, rtol=3 * 2**-24, atol=1e-30)
        # The lamp is red, the sun is white.
        np.testing.assert_allclose(lamp[..., 1], 0.25 * lamp[..., 0], rtol=1e-5, atol=1e-12)
        np.testing.assert_allclose(sun[..., 2], sun[..., 0], rtol=1e-5, atol=1e-12)
        assert not lamp[..., 2].any()
    together = tpdwarp.render_frame(lit, FRAME, **SMALL, aovs=["caustic"]).channels
    np.testing.assert_allclose(rgb(apart, "caustic"), rgb(together, "caustic"), rtol=1e-3, atol=1e-5)


def test_a_group_is_what_its_lights_leave_alone(lit):
    apart = tpdwarp.render_frame(lit, FRAME, **SMALL, aovs=["caustic"], light_groups=["sun=Sun"]).channels
    stage = Usd.Stage.Open(lit)
    stage.SetEditTarget(stage.GetSessionLayer())
    stage.GetPrimAtPath("/World/Lamp").SetActive(False)
    alone = tpdwarp.render_frame(stage, FRAME, **SMALL, aovs=["caustic"]).channels
    # Under the middle of a flat pane light is even, however many photons carry it.
    middle = (slice(6, 10), slice(10, 14))
    assert rgb(alone, "caustic")[middle].min() > 0.9 * rgb(alone, "caustic").max() > 0.0
    np.testing.assert_allclose(rgb(apart, "caustic_sun")[middle], rgb(alone, "caustic")[middle], rtol=1e-3)


def test_a_light_that_is_off_has_its_channels_all_the_same(lit):
    stage = Usd.Stage.Open(lit)
    stage.SetEditTarget(stage.GetSessionLayer())
    UsdLux.LightAPI(stage.GetPrimAtPath("/World/Lamp")).CreateIntensityAttr(0.0)
    channels = tpdwarp.render_frame(stage, FRAME, **SMALL, light_groups=["auto"]).channels
    assert not rgb(channels, "caustic_practicals").any() and rgb(channels, "caustic_Sun").any()


def test_lights_that_are_cut_into_parts_are_one_light(lit):
    stage = Usd.Stage.Open(lit)
    stage.SetEditTarget(stage.GetSessionLayer())
    lamp = UsdLux.SphereLight(stage.GetPrimAtPath("/World/Lamp"))
    lamp.CreateTreatAsPointAttr(False)
    lamp.CreateRadiusAttr(0.2)
    options = {**SMALL, "light_splits": 4, "aovs": ["caustic"], "light_groups": ["auto"]}
    frame = tpdwarp.render_frame(stage, FRAME, **options)
    assert set(frame.photons.light_paths) == {"/World/Sun", "/World/Lamp"}
    parts = rgb(frame.channels, "caustic_Sun") + rgb(frame.channels, "caustic_practicals")
    assert rgb(frame.channels, "caustic_practicals").any()
    np.testing.assert_allclose(parts, rgb(frame.channels, "caustic"), rtol=3 * 2**-24, atol=1e-30)


@pytest.mark.parametrize("estimator", ["pd", "distribution", "tdpm"])
def test_other_estimators_keep_lights_apart_too(lit, estimator):
    options = {**SMALL, "estimator": estimator, "accumulation_times": 2, "tdpm_neighbours": 20, "exposure": 0.5}
    channels = tpdwarp.render_frame(lit, FRAME, **options, aovs=["caustic"], light_groups=["auto"]).channels
    parts = rgb(channels, "caustic_Sun") + rgb(channels, "caustic_practicals")
    np.testing.assert_allclose(parts, rgb(channels, "caustic"), rtol=3 * 2**-24, atol=1e-30)


def test_files_hold_groups_and_pictures_do_not(lit, tmp_path):
    tpdwarp.render(lit, tmp_path / "f.exr", frames=FRAME, **SMALL, aovs=["irradiance"], light_groups=["auto"])
    stored = read_stored(tmp_path / "f.exr")
    depths = dict(zip(stored.names, stored.depths, strict=True))
    assert depths["caustic_Sun.R"] == "half" and depths["irradiance_practicals.G"] == "float"
    with pytest.raises(InputError, match="light groups"):
        tpdwarp.render(lit, tmp_path / "f.png", frames=FRAME, **SMALL, light_groups=["auto"])
    with pytest.raises(InputError, match="auto and NAME=PATTERN"):
        tpdwarp.render(lit, tmp_path / "f.exr", frames=FRAME, **SMALL, light_groups=["/World/Sun"])


def test_textures_hold_groups(lit, tmp_path):
    out: Path = tmp_path / "c.exr"
    bake = {"frames": FRAME, "photons": 1024, "resolution": 32, "threads": 1, "receiver": "/World/Floor"}
    tpdwarp.bake(lit, out, **bake, light_groups=["auto"])
    channels, _ = read_image(out)
    whole = np.stack([channels[c] for c in "RGB"], axis=-1)
    parts = rgb(channels, "irradiance_Sun") + rgb(channels, "irradiance_practicals")
    assert whole.any()
    # The whole is stored in half precision, groups in single.
    np.testing.assert_allclose(parts, whole, rtol=2**-11, atol=2**-25)
