"""Laws of tracing at shutter open, as the paper does, instead of at mid shutter."""

from __future__ import annotations

import numpy as np
import pytest

from tests.estimators.frames import irradiance, rendered, traced
from tests.view.scenes import wave_source
from tpdwarp.scene.description import Shutter
from usd_scenes.oracle import Wave, irradiance_average


@pytest.mark.parametrize("shutter", [Shutter(0, 0, 1), Shutter(1, 0, 1), Shutter(0, -0.5, 0.5)])
def test_photons_traced_at_the_opening_start_where_its_light_lands(shutter):
    source = wave_source(Wave())
    photons = traced(source, shutter, trace_at="open").photons
    opening = traced(source, Shutter(0, shutter.open, shutter.open), estimator="pd").photons
    np.testing.assert_array_equal(photons.ids, opening.ids)
    # Rounding of a float32 sum, in a scene four units across.
    np.testing.assert_allclose(photons.positions - 0.5 * photons.dxdt, opening.positions, atol=4e-6)
    assert np.abs(photons.dxdt).max() > 0.01


def test_over_several_frames_the_forward_difference_of_one_goes_on():
    source = wave_source(Wave())
    one, three = (traced(source, Shutter(0, 0, e), trace_at="open").photons.dxdt for e in (1, 3))
    np.testing.assert_allclose(three, 3 * one, atol=1e-5)


def test_the_opening_is_worse_than_the_middle():
    source, shutter, settings = wave_source(Wave()), Shutter(0, 0, 2), {"columns": 256, "photons": 16384}
    truth = irradiance_average(np.linspace(-1, 1, 257), Wave(), 0, 2, 64, "smooth")
    middle, opening = (
        np.sqrt(np.mean((irradiance(rendered(source, shutter, trace_at=when, **settings)) - truth) ** 2))
        for when in ("middle", "open")
    )
    # What bends light is taken as it is at the opening: off by the whole exposure at its end, not by half of it.
    assert opening > 1.5 * middle


def test_where_nothing_moves_it_does_not_matter_when_light_is_traced():
    still = Shutter(0, 0.5, 0.5)
    middle, opening = (traced(shutter=still, trace_at=when).photons for when in ("middle", "open"))
    np.testing.assert_array_equal(middle.positions, opening.positions)
