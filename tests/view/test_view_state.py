"""Branches of camera paths that go on from where they begin are those that are followed from the camera again."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from tests.photons.shapes import ball, glass
from tests.view.scenes import SHUTTER, bumpy, floor, looking_down, see
from tpdwarp.scene.description import SceneAtShutter
from tpdwarp.view import visibility

SIZE = 16
FILMS = np.random.default_rng(3).uniform(2, SIZE - 2, (256, 2)).astype(np.float32).astype(float)
GLASS = glass()
IN_PART = replace(GLASS, presence=0.7, diffuse_share=0.2, transmittance=(0.9, 0.8, 1.0), absorption=(0.3, 0.1, 0.0))
SCENES = {
    "a ball in moving water": lambda: (
        [floor(), ball("/ball", (0, 0, 0.5), 0.4, 12, glass(2.0)), bumpy("/water", GLASS, 1.0, True)],
        looking_down(),
    ),
    "a ball of glass in part": lambda: ([floor(), ball("/ball", (0, 0, 0.6), 0.5, 12, IN_PART)], looking_down()),
}


@pytest.mark.parametrize("name", SCENES)
def test_a_branch_is_the_same_from_where_it_begins_as_from_the_camera(name, monkeypatch):
    meshes, camera = SCENES[name]()
    scene = SceneAtShutter(SHUTTER, tuple(meshes), (), camera)
    # Four samples a pixel share faint branches, whose light both ways are to carry.
    resumed = see(scene, SIZE, SIZE, FILMS, moves=True, samples=4)
    monkeypatch.setattr(visibility, "kept_rows", lambda reported: np.full(_ones(reported), -1, np.int32))
    again = see(scene, SIZE, SIZE, FILMS, moves=True, samples=4)
    assert len(resumed) == len(again) > 2
    for passed, followed in zip(resumed, again, strict=True):
        for field in fields(passed):
            if field.name != "depths":
                found, expected = getattr(passed, field.name), getattr(followed, field.name)
                np.testing.assert_array_equal(found, expected, err_msg=field.name)


def _ones(reported: np.ndarray) -> int:
    """How many bits are set."""
    return sum(int(np.count_nonzero(reported & (1 << bit))) for bit in range(31))
