"""Check 22: every column of traced photons is the derivative of an independent tracer, whatever moves.

The oracle takes finite differences of where light lands, in float64; it shares no code and no formula with the tracer.
"""

from __future__ import annotations

import numpy as np
import pytest

from .moving_scenes import SCENES, flying_ball, turning_prism
from .oracle_comparison import COLUMNS, compare
from .shapes import glass
from .traced import Traced, traced

PHOTONS = 2000


def assert_agreement(result: Traced, anchor: str, mask: int = 0, among: np.ndarray | bool = True) -> None:
    agreement = compare(result, anchor, mask, among)
    assert agreement.compared >= 24
    assert all(agreement.ratios[name] <= 1 for name in COLUMNS), agreement


@pytest.mark.parametrize("anchor", ["surface", "light"])
@pytest.mark.parametrize("name", SCENES)
def test_columns_are_the_derivatives_of_where_light_lands(name, anchor):
    result = traced(SCENES[name](), PHOTONS, anchor=anchor)
    assert np.linalg.norm(result.photons.dxdt, axis=1).max() > 1e-2
    assert_agreement(result, anchor)


@pytest.mark.parametrize("anchor", ["surface", "light"])
@pytest.mark.parametrize("mask, interactions", [(0b1, 1), (0b110, 4)])
def test_columns_follow_reflected_branches_outside_and_inside_a_glass_ball(mask, interactions, anchor):
    result = traced(flying_ball(glass(), cells=24), 3 * PHOTONS, anchor=anchor, smallest_branch=0.0)
    assert (result.photons.bounces[result.masks == mask] == interactions).all()
    assert_agreement(result, anchor, mask)


@pytest.mark.parametrize("anchor", ["surface", "light"])
def test_columns_follow_total_internal_reflection(anchor):
    result = traced(turning_prism(), PHOTONS, anchor=anchor)
    totally_reflected = (result.masks == 0) & (result.photons.bounces >= 3)
    assert_agreement(result, anchor, among=totally_reflected)


def test_the_two_anchors_differ_in_time_only():
    results = [traced(SCENES["a turning cylinder"](), PHOTONS, anchor=anchor) for anchor in ("surface", "light")]
    riding, fixed = (result.photons for result in results)
    for name in ("ids", "positions", "dxdu", "dxdv", "flux"):
        np.testing.assert_array_equal(getattr(riding, name), getattr(fixed, name))
    assert np.linalg.norm(riding.dxdt - fixed.dxdt, axis=1).max() > 0.1
