"""Laws of how far bodies turn within a shutter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.photons.shapes import box, glass
from tests.photons.traced import sun
from tests.view.scenes import Source, floor, looking_down
from tpdwarp.clock import Clock
from tpdwarp.rendering.context import RenderContext
from tpdwarp.scene.description import SceneAtShutter, Shutter
from tpdwarp.settings import Settings
from tpdwarp.trajectories.turns import turn_between
from usd_scenes.shapes import rotation

BODY = box("/box", (-0.4, -0.3, 0.6), (0.4, 0.5, 1.4), glass())


@pytest.mark.parametrize("degrees", [0.0, 0.1, 30.0, 179.0])
@pytest.mark.parametrize("offset", [0.0, 1.0e4])
def test_the_turn_of_a_rigid_body_is_found_wherever_it_goes(degrees, offset):
    after = replace(BODY, points=BODY.points @ rotation((1.0, 2.0, -0.5), degrees).T + offset)
    assert np.degrees(turn_between(BODY, after)) == pytest.approx(degrees, abs=1e-3)


def test_what_bends_does_not_turn():
    twisted = np.array(
        [rotation((0, 0, 1.0), 60.0 * z) @ point for z, point in zip(BODY.points[:, 2], BODY.points, strict=True)]
    )
    assert turn_between(BODY, replace(BODY, points=twisted)) == 0.0


@pytest.mark.parametrize(("degrees", "least"), [(10.0, 1), (20.0, 2), (45.0, 3), (200.0, 14)])
def test_bodies_have_a_segment_for_each_fifteen_degrees(degrees, least):
    def at(shutter: Shutter) -> SceneAtShutter:
        first, middle, last = (
            (BODY.points - [0, 0, 1]) @ rotation((0, 0, 1.0), degrees * time).T + [0, 0, 1]
            for time in (shutter.open, shutter.middle, shutter.close)
        )
        body = replace(BODY, points=middle, motions=last - first if shutter.exposure else None)
        return SceneAtShutter(shutter, (floor(), body), (sun(),), looking_down(height=0.05))

    settings = Settings(photons=16384, segments="auto")
    count = RenderContext(Source(at), settings).segmentation.count(Shutter(0, 0, 1), Clock())
    assert count >= least and (least > 1 or count == 1)
