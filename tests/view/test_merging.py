"""Samples of a pixel that see the same are looked up once, and stand for as many as they are."""

from __future__ import annotations

import numpy as np
import pytest

from tests.view.scenes import SUN, WATER, bumpy, floor, looking_down, quad, steady
from tpdwarp.clock import Clock
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import Material, Shutter
from tpdwarp.settings import Settings
from tpdwarp.view.merging import LARGEST_DISTANCE, SMALLEST_COSINE, merged
from tpdwarp.view.queries import CameraView, QueryBatch

STILL = Shutter(0, 0, 0)
SIDE = 0.1


def points(spots, positions, receivers=0, normals=(0, 0, 1), first=1) -> dict[str, np.ndarray]:
    """Visible points; weights count from one, so that what is put together shows."""
    count = len(spots)
    return {
        "spot": np.array(spots),
        "receiver": np.broadcast_to(np.asarray(receivers, np.int32), count).copy(),
        "position": np.array(positions, np.float32),
        "normal": np.broadcast_to(np.asarray(normals, np.float32), (count, 3)).copy(),
        "weight": np.repeat(np.arange(1.0, count + 1)[:, None], 3, axis=1),
        "first": np.broadcast_to(np.asarray(first), count).copy(),
        "pixel": np.array(spots) * 10,
    }


def looked_up(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    found = merged(columns, lambda positions, normals, apart: apart[:, :2] / SIDE)
    assert found.keys() == columns.keys()
    np.testing.assert_allclose(found["weight"].sum(), columns["weight"].sum())
    assert found["first"].sum() == columns["first"].sum()
    np.testing.assert_array_equal(found["pixel"], found["spot"] * 10)
    return found


def test_points_of_a_spot_are_their_mean_and_others_stay_apart():
    found = looked_up(points([1, 0, 1, 0, 2], [(2, 0, 0), (1, 0, 0), (2.1, 0, 0), (1, 0.1, 0), (2, 0, 0)]))
    np.testing.assert_array_equal(found["spot"], [0, 1, 2])
    np.testing.assert_allclose(found["position"], [(1, 0.05, 0), (2.05, 0, 0), (2, 0, 0)], rtol=1e-6)
    np.testing.assert_array_equal(found["weight"][:, 0], [6, 4, 5])
    np.testing.assert_array_equal(found["first"], [2, 2, 1])


def test_neither_other_objects_nor_later_paths_are_put_together_with_what_lies_beside_them():
    found = looked_up(points([0] * 5, np.zeros((5, 3)), [3, 4, 3, 4, 3], first=[1, 1, 1, 1, 0]))
    rows = sorted(zip(found["receiver"], found["first"], found["weight"][:, 0], strict=True))
    assert rows == [(3, 0, 5), (3, 2, 4), (4, 2, 6)]


@pytest.mark.parametrize("part", [0.9, 1.1])
def test_points_farther_apart_than_what_they_stand_for_are_looked_up_each(part):
    reach = part * LARGEST_DISTANCE * SIDE
    found = looked_up(points([0, 0, 0, 1], [(reach, 0, 0), (-reach, 0, 0), (0, 0, 0), (9, 9, 9)]))
    assert len(found["spot"]) == (2 if part < 1 else 4)


@pytest.mark.parametrize("part", [0.9, 1.1])
def test_points_that_face_other_ways_are_looked_up_each(part):
    angle = part * np.arccos(SMALLEST_COSINE)
    normals = [(np.sin(side * angle), 0, np.cos(angle)) for side in (-1, 1)]
    found = looked_up(points([0, 0], np.zeros((2, 3)), normals=normals))
    assert len(found["spot"]) == (1 if part < 1 else 2)
    np.testing.assert_allclose(np.linalg.norm(found["normal"], axis=1), 1, rtol=1e-6)


def irradiance(meshes, size=32, **settings) -> np.ndarray:
    chosen = Settings(photons=4096, threads=1, aovs=("irradiance", "caustic"), **settings)
    frame = render_frame(RenderContext(steady(meshes, (SUN,), looking_down(height=0.6)), chosen), STILL, size, size)
    return np.stack([frame.channels[f"{name}.R"] for name in ("irradiance", "caustic")]).astype(float)


def test_light_on_a_floor_is_that_of_the_middles_of_pixels_however_many_samples_see_it():
    meshes = [floor(material=Material(color=(0.5, 0.5, 0.5))), bumpy("/water", WATER, 1.0, False)]
    one = irradiance(meshes, samples=1)
    assert np.std(one[0]) > 0.05 * np.mean(one[0])
    for samples in (3, 4, 9):
        np.testing.assert_allclose(irradiance(meshes, samples=samples), one, rtol=1e-4)
    # Four parts of a pixel, weighted by the samples in each, tell what is finer than it, no more.
    assert np.abs(irradiance(meshes, samples=16) - one).max() < 0.05 * one[0].max()


def test_where_a_card_covers_part_of_a_pixel_both_are_lit_as_far_as_they_are_seen():
    """Beside a finer picture: sixteen evenly spread samples, less one, are off by two at most along an edge."""
    card = quad("/card", (-0.513, -3), (0.487, 3), 0.1, Material(color=(0.2, 0.2, 0.2)))
    meshes = [floor(material=Material(color=(0.8, 0.8, 0.8))), card, bumpy("/water", WATER, 1.0, False)]
    found, fine = irradiance(meshes, samples=15)[1], irradiance(meshes, size=256, samples=1)[1]
    truth = fine.reshape(32, 8, 32, 8).mean(axis=(1, 3))
    edge = np.zeros(32, bool)
    edge[[np.searchsorted(np.linspace(-1, 1, 33), at) - 1 for at in (-0.513, 0.487)]] = True
    np.testing.assert_allclose(found[:, ~edge], truth[:, ~edge], atol=0.01 * truth.max())
    np.testing.assert_allclose(found[:, edge], truth[:, edge], atol=(2 / 15 + 1 / 16) * truth.max())
    between = truth[:, edge] / truth.max()
    assert np.all(np.ptp(truth, axis=1) > 0.3 * truth.max()) and np.all((between > 0.2) & (between < 0.95))


@pytest.mark.parametrize("samples", [1, 4])
def test_samples_count_where_their_first_paths_end_not_where_reflections_do(samples):
    """From between water and a roof each sample sees the floor through it and, fainter, the roof in it."""
    meshes = [floor(), quad("/water", (-3, -3), (3, 3), 1.0, WATER), quad("/roof", (-3, -3), (3, 3), 2.0)]
    chosen = Settings(photons=64, threads=1, samples=samples)
    context = RenderContext(steady(meshes, (SUN,), looking_down(height=1.5)), chosen)
    scenes = [context.loader.load(STILL)]
    view = CameraView(scenes, chosen, context.normalization, context.launcher, 8, 8, Clock())
    first = np.concatenate([seen.first for seen in view.look() if isinstance(seen, QueryBatch)])
    assert first.sum() == 64 * samples
    # As many spots show the roof, which no first path ends on.
    assert np.count_nonzero(first == 0) == np.count_nonzero(first) == 64
