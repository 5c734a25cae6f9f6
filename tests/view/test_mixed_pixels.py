"""What pixels see of several surfaces is as much of each as lies in them, and light is looked up no oftener for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.view.scenes import SUN, WATER, floor, looking_down, quad, steady
from tests.view.test_merging import SIDE, looked_up
from tpdwarp.clock import Clock
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import Material, MeshAtShutter, Shutter
from tpdwarp.settings import Settings
from tpdwarp.view import queries
from tpdwarp.view.merging import LARGEST_DISTANCE
from tpdwarp.view.mixed_pixels import RAYS_OF_PIXEL, rays_of_sample
from tpdwarp.view.queries import CameraView
from tpdwarp.view.query_batches import QueryBatch, SeenPoints

ACROSS, FINER = 32, 64
STILL = Shutter(0.0, 0.0, 0.0)
OPEN = Shutter(0.0, 0.0, 1.0)
CORNERS = np.array([[-0.81, -0.73, 0.2], [0.77, -0.41, 0.2], [-0.13, 0.83, 0.2]])
PLATE = MeshAtShutter("/plate", CORNERS, np.array([[0, 1, 2]], np.int32), materials=(Material(),))


def covered(corners: np.ndarray = CORNERS) -> np.ndarray:
    """How much of each pixel the plate covers, by many points, [height, width]."""
    at = (np.arange(ACROSS * FINER) + 0.5) / (0.5 * ACROSS * FINER) - 1.0
    x, y = at[None, :], -at[:, None]
    inside = np.ones((ACROSS * FINER,) * 2, bool)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        inside &= (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) > 0.0
    return inside.reshape(ACROSS, FINER, ACROSS, FINER).mean(axis=(1, 3))


def context(meshes: list[MeshAtShutter], **options) -> RenderContext:
    source = steady(meshes, (SUN,), looking_down())
    return RenderContext(source, Settings(**{"photons": 1024, "threads": 1, "samples": 4} | options))


def seen_by(meshes: list[MeshAtShutter], shutter: Shutter = STILL, **options) -> list[SeenPoints | QueryBatch]:
    given = context(meshes, **options)
    scenes = given.scenes(shutter, Clock())
    return list(CameraView(scenes, given.settings, given.normalization, given.launcher, ACROSS, ACROSS, Clock()).look())


@pytest.mark.parametrize("material", [Material(), WATER], ids=["diffuse", "water"])
@pytest.mark.parametrize("samples", [2, 4, 9])
def test_edges_cover_as_much_of_a_pixel_as_they_do(samples, material):
    wanted = covered()
    plate = replace(PLATE, materials=(material,))
    frame = render_frame(context([plate], samples=samples, aovs=("cryptomatte",)), STILL, ACROSS, ACROSS)
    off = frame.channels["A"] - wanted
    # What no sample of a pixel meets nobody knows of.
    known = (frame.channels["A"] > 0.0) & (frame.channels["A"] < 1.0)
    assert known.sum() >= 40
    # Of as many positions as samples a twentieth to a fifth.
    assert np.sqrt(np.mean(off[known] ** 2)) < 0.02
    np.testing.assert_allclose(frame.channels["CryptoObject00.g"], frame.channels["A"], atol=1e-6)


def test_edges_that_move_cover_as_much_of_a_pixel_as_they_do_over_the_shutter():
    way = np.array([0.31, -0.17, 0.0])
    moving = replace(PLATE, motions=np.tile(way, (3, 1)))
    at = (np.arange(200) + 0.5) / 200 - 0.5
    wanted = np.mean([covered(CORNERS + time * way) for time in at], axis=0)
    frame = render_frame(context([moving]), OPEN, ACROSS, ACROSS)
    known = (frame.channels["A"] > 0.0) & (frame.channels["A"] < 1.0)
    assert known.sum() >= 200
    # Of four positions, each at another time, .1.
    assert np.sqrt(np.mean((frame.channels["A"] - wanted)[known] ** 2)) < 0.035


@pytest.mark.parametrize("moves", [False, True])
def test_a_surface_seen_directly_and_through_glass_is_looked_up_for_either(moves):
    """Of each pixel at the edge of flat water, as much of the floor is seen through it as it covers."""
    pane = replace(PLATE, materials=(WATER,), motions=np.full((3, 3), 1e-6) if moves else None)
    seen = [batch for batch in seen_by([pane, floor()], OPEN if moves else STILL) if isinstance(batch, QueryBatch)]
    part = covered().ravel()
    through = np.zeros_like(part)
    for batch in seen:
        # Less light comes through the surface, and more radiance within.
        weights = batch.weights[:, 0] / np.maximum(batch.first, 1e-30)
        dimmed = (batch.first > 0) & (np.abs(weights / weights.max() - 1.0) > 0.01)
        np.add.at(through, batch.pixels[dimmed], batch.first[dimmed] / 4)
    known = (through > 0.0) & (through < 1.0)
    assert known.sum() > 40
    off = np.minimum(np.abs(through - part), np.abs(1.0 - through - part))[known]
    assert np.sqrt(np.mean(off**2)) < 0.03


def test_what_moves_is_met_where_it_is_in_the_middle_of_its_part_of_the_shutter():
    """Rays of a sample look at other times than that; a plate that rises is as high as it is then."""
    rise = 0.04
    rising = replace(PLATE, motions=np.tile((0.0, 0.0, rise), (3, 1)))
    given = context([rising, floor()])
    moving = [seen for seen in seen_by([rising, floor()], OPEN) if isinstance(seen, QueryBatch) and seen.moves]
    off = []
    for batch in moving:
        if batch.times is not None:
            height = given.normalization.world_points(batch.queries.position.numpy())[:, 2]
            off.append(height - (CORNERS[0, 2] + rise * batch.times[:, 0]))
            np.testing.assert_allclose(batch.times[:, 0], batch.times[:, 1], atol=1e-7)
    assert sum(map(len, off)) > 100
    np.testing.assert_allclose(np.concatenate(off), 0.0, atol=1e-5)


def test_light_from_photons_fills_as_much_of_a_pixel_as_what_it_falls_on():
    """Even light through flat water on a plate, which has all of it up to its edges."""
    water = quad("/water", (-3, -3), (3, 3), 0.9, WATER)
    frame = render_frame(context([PLATE, water], photons=1 << 14, aovs=("caustic",)), STILL, ACROSS, ACROSS)
    caustic = frame.channels["caustic.R"]
    even = np.median(caustic[covered() == 1.0])
    assert even > 0.0
    part = caustic / even
    off = part - covered()
    known = (part > 1.0 / RAYS_OF_PIXEL) & (part < 1.0 - 1.0 / RAYS_OF_PIXEL)
    assert known.sum() > 40 and np.sqrt(np.mean(off[known] ** 2)) < 0.02


def test_all_of_each_pixel_is_looked_up_and_each_surface_once():
    seen = seen_by([PLATE, floor()])
    batches = [batch for batch in seen if isinstance(batch, QueryBatch)]
    pixels = np.concatenate([batch.pixels for batch in batches])
    first = np.concatenate([np.float64(batch.first) for batch in batches])
    np.testing.assert_allclose(np.bincount(pixels, first), 4.0)
    part = covered()
    surfaces = 1 + ((part > 0.0) & (part < 1.0)).ravel()
    rows = np.bincount(pixels)
    assert (rows <= surfaces).all() and (rows == 2).sum() > 20


def test_single_samples_take_no_more_rays():
    assert rays_of_sample(1) == 1 == rays_of_sample(2 * RAYS_OF_PIXEL)
    assert rays_of_sample(4) == RAYS_OF_PIXEL // 4
    once = [seen for seen in seen_by([PLATE, floor()], samples=1) if isinstance(seen, SeenPoints)]
    assert once and all(np.all(seen.shares == 1.0) for seen in once)


def test_points_on_two_steps_of_one_object_are_not_put_together():
    height = 1.1 * float(LARGEST_DISTANCE) * SIDE
    found = looked_up([0] * 4, [(0, 0, 0), (0, 0.01, height), (0.01, 0, 0), (0, 0, height)])
    assert sorted(row["position"][2] for row in found) == pytest.approx([0.0, height])


def test_of_rays_that_meet_a_surface_far_apart_some_stand_for_the_others():
    places = [(9.0 * k, 0, 0) for k in range(8)]
    found = looked_up([0] * 8, places, rays=4)
    assert [row["count"] for row in found] == [4, 4]
    assert [row["weight"] for row in found] == [1 + 2 + 3 + 4, 5 + 6 + 7 + 8]
    np.testing.assert_allclose([row["position"] for row in found], [places[0], places[4]])


def test_pictures_of_several_batches_are_those_of_one(monkeypatch):
    """Of pixels that see several surfaces in one batch, the next ones have all of theirs."""
    whole = render_frame(context([PLATE, floor()]), STILL, ACROSS, ACROSS).channels
    monkeypatch.setattr(queries, "BATCH_SAMPLES", 4 * ACROSS * ACROSS // 3)
    parted = render_frame(context([PLATE, floor()]), STILL, ACROSS, ACROSS).channels
    for name, values in whole.items():
        np.testing.assert_array_equal(parted[name], values, err_msg=name)
