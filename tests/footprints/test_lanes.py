"""Lanes: vector instructions against NumPy, and what the compiler is told of them."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from tpdwarp.compiler_flags import lanes_in_vectors
from tpdwarp.footprints.lanes import (
    LANE_COUNT,
    Lanes,
    greater,
    greatest,
    least,
    lesser,
    not_negative,
    roots,
)


@wp.kernel(module="unique", module_options=lanes_in_vectors(), enable_backward=False)
def evaluate(a: wp.array(dtype=Lanes), b: wp.array(dtype=Lanes), rows: wp.array2d(dtype=Lanes)):
    i = wp.tid()
    rows[0, i] = lesser(a[i], b[i])
    rows[1, i] = greater(a[i], b[i])
    rows[2, i] = not_negative(a[i])
    rows[3, i] = roots(wp.abs(a[i]))
    rows[4, i] = Lanes(least(a[i]))
    rows[5, i] = Lanes(greatest(a[i]))


def test_lanes_are_what_numpy_says():
    rng = np.random.default_rng(5)
    a, b = rng.normal(size=(2, 64, LANE_COUNT)).astype(np.float32)
    # The least and the greatest value stand in each lane once; zeros count as not negative, whatever their sign.
    lanes = np.arange(LANE_COUNT)
    a[lanes, lanes], a[lanes + LANE_COUNT, lanes] = -9.0, 9.0
    a[50, ::2], a[51, ::2], b[52] = 0.0, -0.0, a[52]
    out = wp.zeros((6, len(a)), dtype=Lanes, device="cpu")
    wp.launch(evaluate, len(a), [wp.array(a, dtype=Lanes), wp.array(b, dtype=Lanes), out], device="cpu")
    whole = np.ones_like(a)
    expected = [
        np.minimum(a, b),
        np.maximum(a, b),
        (a >= 0).astype(np.float32),
        np.sqrt(np.abs(a)),
        a.min(axis=1, keepdims=True) * whole,
        a.max(axis=1, keepdims=True) * whole,
    ]
    np.testing.assert_array_equal(out.numpy(), np.stack(expected))


@pytest.mark.parametrize(("flags", "begin"), [(None, "-march=native "), ("", " "), ("-O1 -g", "-O1 -g ")])
def test_flags_that_are_set_for_all_kernels_hold_for_those_of_lanes(monkeypatch, flags, begin):
    monkeypatch.setattr(wp.config, "cpu_compiler_flags", flags)
    assert lanes_in_vectors()["cpu_compiler_flags"].startswith(f"{begin}-mllvm=-unroll-full-max-count=")
