"""The same scene in other units is the same frame."""

from __future__ import annotations

import pytest

from tests.photons.traced import lamp, sun

from .cases import MOTIONS, assert_same_frame, in_other_units, render

LIGHTS = {"sun": lambda: sun((0.2, 0.1, -1)), "lamp": lambda: lamp((0.3, 0.1, 3), (0.15, -0.1, 0.2), intensity=2.0)}


@pytest.mark.parametrize("unit", [1e-6, 1e-3, 0.9, 1e3, 1e6])
@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("motion", MOTIONS)
def test_units_do_not_change_the_frame(motion, light, unit):
    here = MOTIONS[motion](LIGHTS[light]())
    frame, other = render(here), render(in_other_units(here, unit))
    assert frame.channels["caustic.R"].max() > 0.01
    assert_same_frame(other, frame, unit=unit)
    assert other.energy.sent == pytest.approx(frame.energy.sent * unit**2, rel=1e-6)
    # Clamps act on the same footprints.
    assert other.energy.counts == frame.energy.counts
