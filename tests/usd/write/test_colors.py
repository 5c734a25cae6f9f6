"""Colours that show a quantity grow lighter with it, and the table of them is the ramp."""

from __future__ import annotations

import numpy as np

from tpdwarp.usd.write.colors import STEPS, palette, palette_places, speed_colors


def test_colours_grow_lighter_and_end_where_they_are_told():
    luminances = speed_colors(np.linspace(0, 1, 65), 1.0) @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(luminances) > 0).all()
    np.testing.assert_array_equal(speed_colors(np.array([5.0]), 2.0), speed_colors(np.array([2.0]), 2.0))


def test_the_table_is_the_ramp_to_half_a_step():
    values = np.linspace(-0.1, 3.0, 1001)
    # The ramp rises by less than 4 over its length, in linear light.
    found = palette()[palette_places(values, 2.0)]
    np.testing.assert_allclose(found, speed_colors(values, 2.0), rtol=0, atol=4 * 0.5 / (STEPS - 1))


def test_what_has_no_scale_has_the_first_colour():
    assert not palette_places(np.array([-1.0, 0.0, 7.0]), 0.0).any()
