"""Branches that go on from where they begin are those that are followed from the light again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tpdwarp.photons import tracing
from tpdwarp.photons.branching import reported_paths
from tpdwarp.photons.path_state import KEPT_STATES, kept_rows
from tpdwarp.scene.description import Extent, ExtentShape

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


@pytest.mark.parametrize("name", SCENES)
def test_a_branch_is_the_same_from_where_it_begins_as_from_the_light(name, monkeypatch):
    meshes, light = SCENES[name]
    resumed = traced(scene_of(meshes, light), 256)
    monkeypatch.setattr(tracing, "kept_rows", lambda reported: np.full(len(kept_rows(reported)), -1, np.int32))
    again = traced(scene_of(meshes, light), 256)
    assert (resumed.masks > 1).any()
    for field in ("ids", "positions", "flux", "dxdu", "dxdv", "dxdt", "bounces", "dxda", "dxdb"):
        np.testing.assert_array_equal(getattr(resumed.photons, field), getattr(again.photons, field), err_msg=field)
    assert resumed.energy == again.energy


def test_the_states_of_a_path_that_reports_more_than_there_is_room_for_are_those_of_its_first_branches():
    reported = np.array([0b101, (1 << (KEPT_STATES + 2)) - 1, 0], np.int32)
    cells, masks = reported_paths(np.arange(3, dtype=np.int32), np.zeros(3, np.int32), reported)
    rows = kept_rows(reported)
    assert len(rows) == len(cells)
    # The second branch of the first path is at decision 2, and in the second of its rows.
    assert rows[(cells == 0) & (masks == 0b100)] == [3]
    late = (cells == 1) & (masks >= 1 << KEPT_STATES)
    assert late.sum() == 2
    np.testing.assert_array_equal(rows < 0, late)
    assert len(np.unique(rows[~late])) == len(rows) - 2
