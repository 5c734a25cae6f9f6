"""Lanes: vector instructions against NumPy, and what the compiler is told of them."""

from __future__ import annotations

import os
import re
import subprocess
import sys

import numpy as np
import pytest
import warp as wp

from tests.footprints.photons import irradiance, photon_map, queries, shaped
from tpdwarp.compiler_flags import lanes_in_vectors
from tpdwarp.footprints import gather, lanes
from tpdwarp.footprints.lanes import CPU_LANES as LANE_COUNT
from tpdwarp.footprints.lanes import GPU_LANES

Lanes, least, greatest = (one.of(LANE_COUNT) for one in (lanes.Lanes, lanes.least, lanes.greatest))


@wp.kernel(module="unique", module_options=lanes_in_vectors(), enable_backward=False)
def evaluate(a: wp.array(dtype=Lanes), b: wp.array(dtype=Lanes), rows: wp.array2d(dtype=Lanes)):
    i = wp.tid()
    rows[0, i] = Lanes(least(a[i]))
    rows[1, i] = Lanes(greatest(a[i]))
    for lane in range(LANE_COUNT):
        rows[2, i][lane] = lanes.lesser(a[i][lane], b[i][lane])
        rows[3, i][lane] = lanes.greater(a[i][lane], b[i][lane])
        rows[4, i][lane] = lanes.between(a[i][lane], -0.5, 0.75)


def test_lanes_are_what_numpy_says():
    rng = np.random.default_rng(5)
    a, b = rng.normal(size=(2, 64, LANE_COUNT)).astype(np.float32)
    # The least and the greatest value stand in each lane once.
    each = np.arange(LANE_COUNT)
    a[each, each], a[each + LANE_COUNT, each] = -9.0, 9.0
    b[52] = a[52]
    out = wp.zeros((5, len(a)), dtype=Lanes, device="cpu")
    wp.launch(evaluate, len(a), [*(wp.array(one, dtype=Lanes, device="cpu") for one in (a, b)), out], device="cpu")
    least_and_greatest = [found(a, axis=1, keepdims=True) * np.ones_like(a) for found in (np.min, np.max)]
    by_lanes = [np.minimum(a, b), np.maximum(a, b), np.clip(a, -0.5, 0.75)]
    np.testing.assert_array_equal(out.numpy(), np.stack([*least_and_greatest, *by_lanes]))


@pytest.mark.parametrize(("flags", "begin"), [(None, "-march=native "), ("", " "), ("-O1 -g", "-O1 -g ")])
def test_flags_that_are_set_for_all_kernels_hold_for_those_of_lanes(monkeypatch, flags, begin):
    monkeypatch.setattr(wp.config, "cpu_compiler_flags", flags)
    assert lanes_in_vectors()["cpu_compiler_flags"].startswith(f"{begin}-mprefer-vector-width=")


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
    assert lanes.least.of(4) is lanes.least.of(4)
    assert lanes.least.of(4) is not lanes.least.of(LANE_COUNT)
    assert lanes.greatest.of(4).key == "greatest_4"
    assert lanes.LaneVectors.of(4).vars["x"].type is lanes.Lanes.of(4)


# Compiles what footprints weigh, and has the compiler say which loops it makes vector instructions of.
COMPILE = """
import sys
import warp as wp
wp.config.kernel_cache_dir = sys.argv[1]
wp.init()
from tpdwarp.compiler_flags import lanes_in_vectors
from tpdwarp.footprints import bspline, lanes, lines, weights
Lanes = lanes.Lanes.of(lanes.CPU_LANES)
weight = weights.footprint_weight(weights.GatherForm(extended=True), lanes.CPU_LANES, True, True)
flags = lanes_in_vectors()["cpu_compiler_flags"] + " -Rpass=loop-vectorize"

@wp.kernel(module="unique", enable_backward=False, module_options={"cpu_compiler_flags": flags})
def weigh(u: wp.array(dtype=Lanes), trajectories: wp.array(dtype=bspline.Trajectory), out: wp.array(dtype=Lanes)):
    i = wp.tid()
    out[i] = weight(u[i], u[i + 1], trajectories[i])

weigh.module.load("cpu")
"""


def test_loops_over_lanes_become_vector_instructions(tmp_path):
    """One that does not takes ten times as long, for which a vector of two numbers that is passed in it is enough."""
    script = tmp_path / "weigh.py"
    script.write_text(COMPILE)
    run = [sys.executable, str(script), str(tmp_path / "cache")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    said = subprocess.run(run, capture_output=True, text=True, check=True, env=environment).stderr
    [source] = (tmp_path / "cache").rglob("*.cpp")
    vectors = {int(line) for line in re.findall(r"\.cpp:(\d+):\d+: remark: vectorized loop", said)}
    code = source.read_text().splitlines()
    loops = {number for number, line in enumerate(code, 1) if re.search(r"goto end_while_\d+;$", line)}
    assert len(loops) > 10
    # The one that is left is that over panels of the shutter.
    assert len(loops - vectors) == 1
