"""Laws of lights that shine in none of the stills from which lattices are laid out: those that flash within a frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.estimators.frames import OPEN
from tests.photons.shapes import ball, floor, glass, moving
from tests.photons.traced import lamp
from tests.view.scenes import Source, looking_down, steady
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import trace_frame
from tpdwarp.scene.description import SceneAtShutter, Shutter
from tpdwarp.settings import Settings

BODY = ball("/ball", (0, 0, 0.9), 0.4, 24, glass())


def gliding() -> Source:
    body = replace(moving(BODY, (0.15, 0.05, 0.0)), normal_motions=np.zeros_like(BODY.normals))
    return steady([floor(), body], (lamp((0.3, 0.2, 2.5)),), looking_down(height=0.05))


def test_a_light_that_flashes_between_stills_has_trajectories_as_one_that_shines_all_the_time():
    always = gliding()

    def at(shutter: Shutter) -> SceneAtShutter:
        scene = always.at(shutter)
        return scene if shutter.exposure else replace(scene, lights=())

    settings = Settings(photons=4096, segments=1)
    one, other = (trace_frame(RenderContext(source, settings), OPEN) for source in (always, Source(at)))
    straight = "straight for want of keyframes"
    # Lattices of the frame itself do not lie just where those of the stills do.
    assert other.energy.counts[straight] < 1.5 * one.energy.counts[straight] < 0.5 * one.energy.counts["landed"]
    assert abs(other.energy.deposited / one.energy.deposited - 1) < 0.02
