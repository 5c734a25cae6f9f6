"""Paths of a region, and what branches from them: the same however they share regions and threads."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tpdwarp.device import Launcher
from tpdwarp.photons import path_regions
from tpdwarp.photons.path_regions import PathRegions, WaitingPaths
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.scene.description import Extent, ExtentShape, SceneAtShutter

from .shapes import ball, box, floor, glass
from .traced import scene_of, sun, traced

BOTH = [ball("/ball", (0, 0, 1), 0.5, 12, glass()), box("/slab", (-1, -1, 1.8), (1, 1, 1.9), glass())]
IN_PART = replace(glass(), presence=0.7, diffuse_share=0.2, transmittance=(0.9, 0.8, 1.0), absorption=(0.3, 0.1, 0.0))
SUN = sun((0.3, 0.15, -1))
SCENES = {
    "glass": ((*BOTH, floor()), SUN),
    "glass in part": ((ball("/ball", (0, 0, 1), 0.5, 12, IN_PART), floor()), SUN),
    "a sun with a disc on rough glass": (
        (ball("/ball", (0, 0, 1), 0.5, 12, replace(glass(), roughness=0.1)), floor()),
        replace(SUN, extent=Extent(ExtentShape.ROUND, 0.02)),
    ),
}  # fmt: skip


def rows_by_id(photons: PhotonMap) -> PhotonMap:
    return photons.rows(np.argsort(photons.ids))


def assert_same(photons: PhotonMap, others: PhotonMap) -> None:
    for name in ("ids", "position", "flux", "dxdu", "dxdv", "dxdt", "bounces", "path", "share", "dxda", "vertices"):
        np.testing.assert_array_equal(getattr(photons, name), getattr(others, name), err_msg=name)


@pytest.fixture(params=SCENES)
def scene(request) -> SceneAtShutter:
    meshes, light = SCENES[request.param]
    return scene_of(meshes, light)


def test_a_branch_is_the_same_from_where_it_begins_as_from_the_light(scene, monkeypatch):
    found = traced(scene, 256, recording=True)
    masks = np.unique(found.masks)
    assert len(masks) > 2
    at_light = WaitingPaths.at_light

    def branched_at_light(cells: np.ndarray, launcher: Launcher) -> WaitingPaths:
        paths = at_light(np.tile(cells, len(masks)), launcher)
        paths.queue.mask.numpy()[:] = np.repeat(masks, len(cells))
        return paths

    monkeypatch.setattr(WaitingPaths, "at_light", branched_at_light)
    # Paths that others branch to are among them twice, and some that no branch is worth.
    again = traced(scene, 256, recording=True).map
    _, first = np.unique(again.ids, return_index=True)
    again = again.rows(first)
    again, resumed = again.rows(np.isin(again.ids, found.map.ids)), rows_by_id(found.map)
    assert_same(resumed, again)


def test_what_a_region_has_no_room_for_goes_on_in_another(scene, monkeypatch):
    whole = traced(scene, 256, recording=True)
    launches, room_for = [], PathRegions.room_for
    monkeypatch.setattr(PathRegions, "room_for", lambda *given: launches.append(1) or room_for(*given))
    monkeypatch.setattr(path_regions, "GIVEN", 24)
    monkeypatch.setattr(path_regions, "ROWS", 1)
    parted = traced(scene, 256, recording=True)
    assert len(launches) > 2
    assert_same(rows_by_id(whole.map), rows_by_id(parted.map))
    for name in ("sent", "deposited", "escaped", "absorbed", "lost"):
        assert getattr(parted.energy, name) == pytest.approx(getattr(whole.energy, name), rel=1e-6)


def test_rows_stand_in_the_same_order_whatever_the_number_of_threads(scene):
    one, two = traced(scene, 1024), traced(scene, 1024, threads=2)
    np.testing.assert_array_equal(one.map.ids, two.map.ids)
    assert one.energy == two.energy


def test_each_row_of_a_region_is_traced_or_left():
    launcher = Launcher("cpu", 1)
    regions = PathRegions.room_for(path_regions.GIVEN + 1, True, False, launcher)
    assert regions.count == 2
    regions.queue.done.numpy()[:] = 2, 1
    regions.queue.used.numpy()[:] = 4, 1
    np.testing.assert_array_equal(regions.traced(), [0, 1, path_regions.GIVEN])
    np.testing.assert_array_equal(regions.left(), [2, 3])


def test_rows_that_are_given_come_first_and_the_room_of_all_regions_behind():
    launcher = Launcher("cpu", 1)
    paths = 2 * path_regions.GIVEN + 3
    regions = PathRegions.room_for(paths, True, False, launcher)
    assert regions.rows == paths + 3 * regions.queue.room
    regions.queue.done.numpy()[:] = path_regions.GIVEN, path_regions.GIVEN, 3
    assert path_regions.as_they_lie(regions.traced()) == slice(0, paths)
    # Each row of every region once.
    for number in range(3):
        own = 3 if number == 2 else path_regions.GIVEN
        regions.queue.done.numpy()[number] = own + regions.queue.room
    np.testing.assert_array_equal(np.sort(regions.traced()), np.arange(regions.rows))


@pytest.mark.parametrize("rows", [[], [3], [2, 3, 4], [0, 2], [0, 2, 1, 3], [2, 1, 0]])
def test_rows_as_they_lie_are_the_same_rows(rows):
    rows = np.array(rows, np.int64)
    taken = path_regions.as_they_lie(rows)
    assert isinstance(taken, slice) == (len(rows) > 0 and rows.tolist() == list(range(rows[0], rows[0] + len(rows))))
    np.testing.assert_array_equal(np.arange(5)[taken], rows)


def test_light_that_leaves_the_scene_where_it_branches_takes_no_row_and_is_counted(monkeypatch):
    rows, traced_rows = [], PathRegions.traced
    monkeypatch.setattr(PathRegions, "traced", lambda regions: rows.append(traced_rows(regions)) or rows[-1])
    found = traced(scene_of((floor(1.0, 1.0, glass(), "/water"), floor()), SUN), 256)
    assert sum(map(len, rows)) == found.energy.counts["emitted"] < 1.1 * len(found.map)
    ior, cosine = 1.5, 1.0 / math.sqrt(1.0 + 0.3**2 + 0.15**2)
    refracted = math.sqrt(1.0 - (1.0 - cosine**2) / ior**2)
    across = (cosine - ior * refracted) / (cosine + ior * refracted)
    within = (refracted - ior * cosine) / (refracted + ior * cosine)
    assert found.energy.escaped / found.energy.sent == pytest.approx(0.5 * (across**2 + within**2), rel=1e-5)
