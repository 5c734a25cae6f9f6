"""How far footprints reach: as far as their light does, and not much farther."""

from __future__ import annotations

import numpy as np
import pytest

from tests.footprints.photons import ONE_THREAD, photon_map, queries, shaped
from tpdwarp.footprints.plain_gather import plain_gather
from tpdwarp.footprints.weights import GatherForm

CELL = 0.05
# What passes as a line ends less sharply than the footprint, by parts of a thousand of its light.
LEAST = 0.002
CURVE = ((0.1, -0.06, 0), (-0.1, 0.05, 0), (0.01, 0.005, 0), (-0.01, 0.012, 0))


def covered(reach: np.void, points: np.ndarray) -> np.ndarray:
    """Which points [n, 3] lie within both of its axes and its strip."""
    away = points - reach["center"]
    pairs = (("row_u", "u"), ("row_v", "v"), ("skew", "across"))
    return np.all([np.abs(away @ reach[along]) <= reach[most] for along, most in pairs], axis=0)


@pytest.mark.parametrize("form", [GatherForm(), GatherForm("epanechnikov")])
@pytest.mark.parametrize("curved", [False, True])
@pytest.mark.parametrize("half_pixel", [0.0, 0.03])
def test_footprints_reach_as_far_as_their_light_over_the_shutter_and_fill_their_boxes_in_part(form, curved, half_pixel):
    if curved and not form.smooth:
        pytest.skip("radial kernels go straight")
    random = np.random.default_rng(7)
    points = np.append(random.uniform(-0.5, 0.5, (20_000, 2)), np.zeros((20_000, 1)), axis=1)
    lit = within = boxed = 0
    for _ in range(12):
        angle, skew = random.uniform(0.0, 2.0 * np.pi), random.uniform(-0.9, 0.9)
        across = CELL * np.array([np.cos(angle), np.sin(angle), 0.0])
        along = skew * across + CELL * random.uniform(0.1, 1.0) * np.array([-np.sin(angle), np.cos(angle), 0.0])
        way = np.append(random.uniform(-0.4, 0.4, 2), 0.0)
        photons = photon_map([(0, 0, 0)], across, along, way, trajectory=CURVE if curved else None)
        footprints = shaped(photons, kernel=form.kernel, half_pixel=half_pixel, moves=True)
        found = plain_gather(footprints, queries(points), form, ONE_THREAD).irradiance[:, 0]
        light = found > LEAST * found.max()
        reached = covered(footprints.footprints.reaches(form).numpy()[0], points)
        assert not (light & ~reached).any()
        edge = points[reached].min(axis=0), points[reached].max(axis=0)
        boxed += np.count_nonzero(((points >= edge[0]) & (points <= edge[1])).all(axis=1))
        lit, within = lit + np.count_nonzero(light), within + np.count_nonzero(reached)
    assert within < 2.5 * lit
    assert within < 0.7 * boxed
