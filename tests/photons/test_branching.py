"""Laws of paths that are totally reflected, and of how far paths are followed."""

from __future__ import annotations

import numpy as np
import pytest

from tpdwarp.scene.requirements import requirements_of

from .shapes import ball, box, floor, glass, prism
from .traced import scene_of, sun, traced

SCENES = {
    "a prism": [prism("/prism", (0.0, 0, 1), 0.4, 0.6, glass())],
    "a tilted block": [prism("/prism", (0.0, 0, 1), 0.4, 0.6, glass(2.2))],
    "a slab and a ball": [
        box("/slab", (-1, -1, 1.8), (1, 1, 1.9), glass()), ball("/ball", (0, 0, 1.1), 0.4, 16, glass())
    ],
}  # fmt: skip


@pytest.mark.parametrize("name", SCENES)
def test_hardly_any_light_is_lost_to_too_many_interactions(name):
    energy = traced(scene_of([*SCENES[name], floor()], sun((0.3, 0.15, -1))), 4096).energy
    assert energy.lost.get("too many bounces", 0.0) < 1e-3 * energy.sent
    spent = energy.deposited + energy.escaped + energy.absorbed + energy.lost_total
    assert spent == pytest.approx(energy.sent, rel=1e-5)


def test_total_reflection_takes_no_bit_of_a_path_s_name():
    """Of each interaction that is no decision, the mask of a path is shorter than its interactions are many."""
    result = traced(scene_of([*SCENES["a prism"], floor()], sun((0.3, 0.15, -1))), 4096)
    through = result.masks == 0
    # A prism's base lets no light out that its sides let in, but back to them.
    assert (result.photons.bounces[through] > 2).any()
    bits = np.array([int(mask).bit_length() for mask in result.masks])
    assert (bits <= result.photons.bounces).all() and (bits < 31).all()


def test_fewer_interactions_lose_what_goes_on_and_keep_the_rest():
    scene = scene_of([*SCENES["a prism"], floor()], sun((0.3, 0.15, -1)))
    assert requirements_of(scene, bounces=2).bounces == 2
    many, few = traced(scene, 4096), traced(scene, 4096, bounces=2)
    short = many.photons.bounces <= 2
    np.testing.assert_array_equal(few.photons.ids, many.photons.ids[short])
    assert few.energy.lost["too many bounces"] > 0.01 * few.energy.sent
