"""Single precision against the float64 oracle: the table of docs/rounding.md, kept below its bounds."""

from __future__ import annotations

import numpy as np
import pytest

from scripts.benchmarks.rounding import QUANTITIES, SCENES, errors


@pytest.mark.parametrize("name", SCENES)
def test_rounding_stays_below_its_bounds(name):
    make, (median, worst) = SCENES[name]
    found = errors(make())
    assert set(found) == set(QUANTITIES) and len(found["position"]) >= 40
    for quantity, relative in found.items():
        assert np.median(relative) <= median, quantity
        assert relative.max() <= worst, quantity
