"""Single precision against the float64 oracle: no quantity is less precise than docs/rounding.md states it."""

from __future__ import annotations

import numpy as np
import pytest

from tests.rounding import QUANTITIES, ROOT, SCENES, documented, errors

STATED = documented(ROOT / "docs" / "rounding.md")
# Medians move with the rounding of every operation, the worst of a hundred photons with those of a few of them.
MEDIAN, WORST = 4, 10


def test_the_document_states_every_quantity_of_every_scene():
    assert list(STATED) == list(SCENES)
    assert all(tuple(row) == QUANTITIES for row in STATED.values())


@pytest.mark.parametrize("name", SCENES)
def test_no_quantity_loses_a_digit_of_what_is_stated(name):
    found = errors(SCENES[name]())
    assert set(found) == set(QUANTITIES) and len(found["position"]) >= 40
    for quantity, relative in found.items():
        median, worst = STATED[name][quantity]
        assert np.median(relative) <= MEDIAN * median, quantity
        assert relative.max() <= WORST * worst, quantity
