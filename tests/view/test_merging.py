"""Samples of a pixel that see the same are looked up once, and stand for as many as they are."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from tests.view.scenes import ONE_THREAD, SUN, WATER, bumpy, floor, looking_down, quad, steady, wave_source
from tpdwarp.clock import Clock
from tpdwarp.footprints.irradiance import QueryArrays
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import Material, Shutter
from tpdwarp.settings import Settings
from tpdwarp.view.merging import LARGEST_DISTANCE, SMALLEST_COSINE, merge
from tpdwarp.view.queries import CameraView
from tpdwarp.view.query_batches import QueryBatch
from usd_scenes.oracle import Wave, irradiance_average

STILL = Shutter(0, 0, 0)
SIDE = 0.1


def looked_up(spots, positions, receivers=0, normals=(0, 0, 1), parts=None, rays=1) -> list[dict]:
    """What is left of visible points, one row each; weights count from one, so that what is put together shows."""
    count = len(spots)
    order = np.argsort(spots, kind="stable")
    rows = ONE_THREAD.rows(QueryArrays, count, but=("shading_normal", "motion"))
    rows.position = ONE_THREAD.array(np.array(positions, np.float32)[order], wp.vec3)
    rows.normal = ONE_THREAD.array(np.broadcast_to(np.float32(normals), (count, 3))[order], wp.vec3)
    rows.receiver = ONE_THREAD.array(np.broadcast_to(np.int32(receivers), count)[order], wp.int32)
    weights = ONE_THREAD.array(np.repeat(np.arange(1.0, count + 1)[order, None], 3, axis=1), wp.vec3)
    begins = np.searchsorted(np.array(spots)[order], np.arange(max(spots) + 2)).astype(np.int32)
    size = PixelSize()
    size.right, size.up, size.back, size.orthographic = (SIDE, 0, 0), (0, SIDE, 0), (0, 0, 1), 1
    lying = None if parts is None else np.array(parts, np.int32)[order]
    counts = merge(rows, weights, begins, lying, size, ONE_THREAD, rays)
    assert counts.sum() == count
    kept = np.flatnonzero(counts)
    np.testing.assert_array_equal(kept, np.flatnonzero(rows.receiver.numpy() >= 0))
    weight = weights.numpy()[kept, 0]
    assert weight.sum() == count * (count + 1) / 2
    found = [np.array(spots)[order], rows.position.numpy(), rows.normal.numpy(), rows.receiver.numpy(), counts]
    names = ("spot", "position", "normal", "receiver", "count")
    columns = {name: values[kept] for name, values in zip(names, found, strict=True)}
    return [{name: values[k] for name, values in columns.items()} | {"weight": weight[k]} for k in range(len(kept))]


def test_points_of_a_pixel_are_their_mean_and_others_stay_apart():
    found = looked_up([1, 0, 1, 0, 2], [(2, 0, 0), (1, 0, 0), (2.05, 0, 0), (1, 0.1, 0), (2, 0, 0)])
    assert [row["spot"] for row in found] == [0, 1, 2]
    means = [row["position"] for row in found]
    np.testing.assert_allclose(means, [(1, 0.05, 0), (2.025, 0, 0), (2, 0, 0)], rtol=1e-6)
    assert [(row["weight"], row["count"]) for row in found] == [(6, 2), (4, 2), (5, 1)]


def test_other_objects_and_other_parts_of_a_pixel_are_not_put_together_with_what_lies_beside_them():
    for names in ({"receivers": [3, 4, 3, 4, 3]}, {"parts": [3, 4, 3, 4, 3]}):
        found = looked_up([0] * 5, np.zeros((5, 3)), **names)
        assert sorted((row["weight"], row["count"]) for row in found) == [(6, 2), (9, 3)]


@pytest.mark.parametrize("part", [0.9, 1.1])
def test_points_farther_apart_than_what_they_stand_for_are_looked_up_each(part):
    reach = part * float(LARGEST_DISTANCE) * SIDE
    found = looked_up([0, 0, 0, 1], [(reach, 0, 0), (-reach, 0, 0), (0, 0, 0), (9, 9, 9)])
    assert len(found) == (2 if part < 1 else 4)


@pytest.mark.parametrize("part", [0.9, 1.1])
def test_points_that_face_other_ways_are_looked_up_each(part):
    angle = part * np.arccos(float(SMALLEST_COSINE))
    normals = [(np.sin(side * angle), 0, np.cos(angle)) for side in (-1, 1)]
    found = looked_up([0, 0], np.zeros((2, 3)), normals=normals)
    assert len(found) == (1 if part < 1 else 2)
    np.testing.assert_allclose([np.linalg.norm(row["normal"]) for row in found], 1, rtol=1e-6)


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
    # By B-splines both: at the card's rim cells are sharper, and in finer pixels there are none.
    found = irradiance(meshes, samples=15, smoothing=1.001)[1]
    fine = irradiance(meshes, size=256, samples=1, smoothing=1.001)[1]
    truth = fine.reshape(32, 8, 32, 8).mean(axis=(1, 3))
    edge = np.zeros(32, bool)
    edge[[np.searchsorted(np.linspace(-1, 1, 33), at) - 1 for at in (-0.513, 0.487)]] = True
    np.testing.assert_allclose(found[:, ~edge], truth[:, ~edge], atol=0.01 * truth.max())
    np.testing.assert_allclose(found[:, edge], truth[:, edge], atol=(2 / 15 + 1 / 16) * truth.max())
    between = truth[:, edge] / truth.max()
    assert np.all(np.ptp(truth, axis=1) > 0.3 * truth.max()) and np.all((between > 0.2) & (between < 0.95))


@pytest.mark.parametrize("photons", [4096, 16384])
@pytest.mark.parametrize("samples", [1, 4, 16])
def test_a_camera_that_passes_over_light_sees_all_of_it_however_few_samples_look(samples, photons):
    """Over ten pixels, against the mean of exact stills: no pixel counts twice, and no part of its way is left out."""
    way, wave = 0.4, Wave()
    camera = looking_down((-0.8, 0.8, -0.1, 0.1), height=0.9 * wave.height, position_motion=np.array([way, 0, 0]))
    chosen = Settings(photons=photons, threads=1, segments=1, samples=samples, aovs=("irradiance",))
    source, width = wave_source(wave, camera=camera), 40
    found = render_frame(RenderContext(source, chosen), Shutter(0, 0, 1), width, 5).channels["irradiance.R"]
    times, edges = (np.arange(64) + 0.5) / 64, np.linspace(-0.8, 0.8, width + 1)
    exact = np.mean([irradiance_average(edges + (t - 0.5) * way, wave, t, t, 1) for t in times], axis=0)
    assert np.std(exact) > 0.02 * exact.mean()
    # What the same wave errs by under a camera at rest, with 1 024 photons (README).
    assert np.sqrt(np.mean((found - exact) ** 2)) / exact.mean() < 0.0025


def test_pixels_past_which_an_edge_goes_are_looked_at_time_by_time():
    """A camera goes over a card's edge by two pixels to either side; the outer two see it for a moment."""
    card = quad("/card", (-9, -3), (0, 3), 0.1, Material(color=(0.2, 0.2, 0.2)))
    camera = looking_down(height=0.6, position_motion=np.array([0.5, 0, 0]))
    source = steady([floor(), card, bumpy("/water", WATER, 1.0, False)], (SUN,), camera)
    chosen = Settings(photons=1024, threads=1, samples=4)
    context = RenderContext(source, chosen)
    scenes = [context.loader.load(Shutter(0, 0, 1))]
    view = CameraView(scenes, chosen, context.normalization, context.launcher, 16, 4, Clock())
    batches = [seen for seen in view.look() if isinstance(seen, QueryBatch)]
    moving = {batch.window[1]: batch for batch in batches if batch.moves}
    whole, parts = moving[1.0], moving[0.25]
    never = {*range(6), *range(10, 16)}
    assert never <= set(whole.pixels % 16) <= never | {6, 9} and (whole.first == 4).all()
    assert {7, 8} <= set(parts.pixels % 16) <= {6, 7, 8, 9}
    assert sum(batch.first.sum() for batch in batches) == 16 * 4 * 4


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
