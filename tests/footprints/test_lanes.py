"""Lanes: vector instructions against NumPy, and what the compiler is told of them."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from tests.footprints.photons import irradiance, photon_map, queries, shaped
from tpdwarp.compiler_flags import lanes_in_vectors
from tpdwarp.footprints import gather, lanes
from tpdwarp.footprints.lanes import CPU_LANES as LANE_COUNT
from tpdwarp.footprints.lanes import GPU_LANES

Lanes, lesser, greater, not_negative, roots, least, greatest = (
    one.of(LANE_COUNT)
    for one in (
        lanes.Lanes,
        lanes.lesser,
        lanes.greater,
        lanes.not_negative,
        lanes.roots,
        lanes.least,
        lanes.greatest,
    )
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
    each = np.arange(LANE_COUNT)
    a[each, each], a[each + LANE_COUNT, each] = -9.0, 9.0
    a[50, ::2], a[51, ::2], b[52] = 0.0, -0.0, a[52]
    out = wp.zeros((6, len(a)), dtype=Lanes, device="cpu")
    wp.launch(evaluate, len(a), [*(wp.array(one, dtype=Lanes, device="cpu") for one in (a, b)), out], device="cpu")
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


@pytest.mark.parametrize("moves", [False, True])
def test_as_much_light_falls_on_a_query_alone_as_on_one_of_many(monkeypatch, moves):
    """Threads of a GPU work on one query each, those of a CPU on sixteen."""
    rng = np.random.default_rng(3)
    at = np.append(rng.uniform(-0.5, 0.5, (500, 2)), np.zeros((500, 1)), axis=1)
    velocity = np.append(rng.normal(scale=0.1, size=(500, 2)), np.zeros((500, 1)), axis=1) if moves else (0, 0, 0)
    footprints = shaped(photon_map(at, (0.05, 0.02, 0), (0, 0.04, 0), velocity, flux=0.01), moves=moves)
    points = np.append(rng.uniform(-0.6, 0.6, (1000, 2)), np.zeros((1000, 1)), axis=1)
    many = irradiance(footprints, queries(points), with_motion=True)
    monkeypatch.setattr(gather, "lanes_of", lambda launcher: GPU_LANES)
    alone = irradiance(footprints, queries(points), with_motion=True)
    assert many.irradiance.any()
    # At rest sums of a hundred terms, in another order. What moves is culled where none of its queries is in its reach,
    # and the end of a line is a box that goes a little beyond it.
    apart = (3e-4 if moves else 1e-5) * many.irradiance.max()
    np.testing.assert_allclose(alone.irradiance, many.irradiance, rtol=1e-5, atol=apart)
    assert np.mean(alone.photons == many.photons) >= (0.98 if moves else 1.0)


def test_what_is_made_for_a_number_of_lanes_is_made_once_and_says_so_in_its_name():
    assert lanes.between.of(4) is lanes.between.of(4)
    assert lanes.between.of(4) is not lanes.between.of(LANE_COUNT)
    assert lanes.between.of(4).key == "between_4"
    assert lanes.LaneVectors.of(4).vars["x"].type is lanes.Lanes.of(4)
