"""Lights of all powers, dark or by the hundred; what means nothing is refused."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from pxr import Usd

import tpdwarp
from tests.photons.traced import lamp, sun
from tests.small_stage import write_stage
from tpdwarp.io.images import read_image
from tpdwarp.usd.read.debug_layer import DebugLayerReader

from .cases import MOTIONS, assert_balanced, in_other_units, render

SCALED = ("R", "G", "B", "caustic.R", "direct.R", "irradiance.R")


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("intensity", [1e-30, 1e-10, 1e10, 1e30])
@pytest.mark.parametrize("motion", MOTIONS)
def test_frames_are_linear_in_intensity_in_any_units(motion, intensity, unit):
    def lit(power: float):
        return in_other_units(MOTIONS[motion](sun((0.2, 0.1, -1), power), lamp((0.4, 0.1, 3), intensity=power)), unit)

    one, other = render(lit(1.0)), render(lit(intensity))
    for name in SCALED:
        expected = one.channels[name].astype(float)
        found = other.channels[name].astype(float) / intensity
        # The unit of power is a power of two: the rest rounds differently. Numbers below 1e-38 lose digits.
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-38 / intensity, err_msg=name)
    assert other.energy.sent == pytest.approx(intensity * one.energy.sent, rel=1e-6)
    assert other.photons.flux.sum() == pytest.approx(intensity * one.photons.flux.sum(), rel=1e-6)


@pytest.mark.parametrize("motion", MOTIONS)
def test_a_light_beside_one_that_outshines_it_by_far_changes_nothing(motion):
    strong, weak = sun((0.2, 0.1, -1), 1e30), sun((0.1, 0.2, -1), 1e-30, "/weak")
    alone, both = render(MOTIONS[motion](strong)), render(MOTIONS[motion](strong, weak))
    brightest = alone.channels["R"].max()
    np.testing.assert_allclose(both.channels["R"], alone.channels["R"], rtol=0.05, atol=0.01 * brightest)
    assert both.energy.sent == pytest.approx(alone.energy.sent, rel=0.01)


@pytest.mark.parametrize("motion", MOTIONS)
def test_colours_of_zero_are_black(motion):
    dark = replace(sun((0.2, 0.1, -1)), power=(0.0, 0.0, 0.0))
    assert render(MOTIONS[motion](dark)).energy.sent == 0
    red = render(MOTIONS[motion](replace(dark, power=(1.0, 0.0, 0.0))))
    assert red.channels["R"].max() > 0.01
    assert not red.channels["G"].any() and not red.channels["B"].any()


@pytest.mark.parametrize("photons, limit", [(16, 4 / math.pi - 1), (8192, 0.1)])
def test_hundreds_of_lights_add_up(photons, limit):
    here = MOTIONS["rigid"]()
    place = [(0.3 * math.cos(k), 0.3 * math.sin(k), 3 + 1e-3 * k) for k in range(200)]
    lamps = [lamp(p, (0.01, 0, 0), 1 / 200, f"/lamp{k}") for k, p in enumerate(place)]
    many = render(replace(here, lights=tuple(lamps)), width=8, height=8, photons=photons)
    one = render(replace(here, lights=(lamp((0, 0, 3.1)),)), width=8, height=8, photons=4096)
    # A lamp has at least one photon, which stands for the square about the ball.
    assert many.energy.counts["emitted"] >= 200
    assert many.energy.sent == pytest.approx(one.energy.sent, rel=limit + 0.02)
    assert many.channels["direct.R"].sum() == pytest.approx(one.channels["direct.R"].sum(), rel=0.1)


# What a stage says.


def lit_stage(path, *inputs: str) -> None:
    write_stage(path)
    authored = "".join(f"        {line}\n" for line in inputs)
    path.write_text(path.read_text().replace("        float inputs:intensity = 1\n", authored))


OPTIONS = {"frames": [2], "photons": 256, "samples": 1, "image_width": 12, "threads": 1, "exposure": 0.5}


@pytest.mark.parametrize(
    "inputs, power",
    [
        (("float inputs:intensity = 1e-30",), 1e-30),
        (("float inputs:intensity = 1e30",), 1e30),
        (("float inputs:intensity = 1", "float inputs:exposure = 60"), 2.0**60),
        (("float inputs:intensity = 1", "float inputs:exposure = -60"), 2.0**-60),
        (("float inputs:intensity = 1e30", "float inputs:exposure = -99.65784"), 1.0),
        (("float inputs:intensity = 1e30", "float inputs:exposure = 60"), 1e30 * 2.0**60),
    ],
)
def test_intensity_and_exposure_of_a_stage_multiply_and_files_hold_what_they_can(tmp_path, inputs, power):
    path, layer = tmp_path / "s.usda", tmp_path / "s.debug.usdc"
    lit_stage(path, *inputs)
    more = {"debug_layer": layer, "stats": tmp_path / "s.json", "aovs": ("caustic", "irradiance", "motion")}
    result = tpdwarp.render(path, tmp_path / "s.exr", **more, **OPTIONS)
    assert result.ok
    (energy,) = result.energy.values()
    assert_balanced(energy)
    assert energy.sent == pytest.approx(12 * power, rel=1e-4)
    channels, metadata = read_image(tmp_path / "s.exr")
    for name, values in channels.items():
        assert np.isfinite(values).all(), name
    largest = float(np.finfo(np.float32).max)
    if power < 1e30:
        # Glass at rest lets 0.96 of it through.
        assert channels["irradiance.R"].max() == pytest.approx(0.96 * power, rel=0.1)
    assert metadata["tpdwarp:fluxSent"] == pytest.approx(min(12 * power, largest), rel=1e-4)
    flux = DebugLayerReader(layer).at(2.0).flux
    assert np.isfinite(flux).all() and Usd.Stage.Open(str(layer))
    if power < 1e30:
        assert flux.sum() == pytest.approx(energy.deposited, rel=1e-4)


MEANINGLESS = {
    "a negative intensity": (("float inputs:intensity = -1",), "/World/Sun.inputs:intensity: holds -1"),
    "no number": (("float inputs:intensity = nan",), "/World/Sun.inputs:intensity: holds nan"),
    "infinity": (("float inputs:intensity = inf",), "/World/Sun.inputs:intensity: holds inf"),
    "a negative colour": (("color3f inputs:color = (0, -1, 0)",), "/World/Sun.inputs:color: holds (0.0, -1.0, 0.0)"),
    "an infinite exposure": (("float inputs:exposure = inf",), "/World/Sun.inputs:exposure: holds inf"),
    "an exposure of 2000": (
        ("float inputs:exposure = 2000",),
        "/World/Sun: its intensity, exposure and colour come to inf",
    ),
    "both beyond measure": (
        ("float inputs:intensity = 1e38", "float inputs:exposure = 300"),
        "/World/Sun: its intensity, exposure and colour come to 2.03704e+128",
    ),
}


@pytest.mark.parametrize("what", MEANINGLESS)
def test_lights_that_mean_nothing_are_said_and_the_rest_is_rendered(tmp_path, what, caplog):
    inputs, message = MEANINGLESS[what]
    lit_stage(tmp_path / "bad.usda", *inputs)
    assert tpdwarp.render(tmp_path / "bad.usda", tmp_path / "bad.exr", **OPTIONS).ok
    assert sum(message in record.getMessage() for record in caplog.records) == 1
    assert np.isfinite(read_image(tmp_path / "bad.exr")[0]["R"]).all()
