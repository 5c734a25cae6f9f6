"""Light at edges of receivers is whole: what footprints would spread beyond them comes back."""

from __future__ import annotations

import numpy as np
import pytest

from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import Interaction, Material, MeshAtShutter, SceneAtShutter, Shutter
from tpdwarp.settings import Settings
from usd_scenes import shapes
from usd_scenes.in_memory import SUN, Source, floor, looking_down, quad
from usd_scenes.oracle.closed_forms import fresnel_reflectance

ACROSS = 48
PASSED = 1.0 - fresnel_reflectance(0.0, 1.0, 1.33)


def on_floor(name: str, size: tuple[float, float, float], turn: float, motion: tuple[float, float, float] = (0, 0, 0)):
    """A box that stands on the floor, turned about z by degrees, and goes by ``motion`` within the shutter."""
    points, triangles = shapes.box(size)
    points = points @ shapes.rotation((0.0, 0.0, 1.0), turn).T + [0.0, 0.0, 0.5 * size[2]]
    motions = np.broadcast_to(np.float64(motion), points.shape) if any(motion) else None
    return MeshAtShutter(name, points, triangles.astype(np.int32), motions, None, None, None, (Material(),))


def light_from_above(receivers: list[MeshAtShutter], photons: int, shutter: Shutter) -> np.ndarray:
    """What falls through flat water on what a camera sees that looks down as the sun does, by what should fall there:
    all of it is lit, and no shadow is seen."""
    water = quad("/water", (-3, -3), (3, 3), 1.8, Material(Interaction.DIELECTRIC, ior=1.33))
    settings = Settings(photons=photons, samples=4, threads=1, aovs=("irradiance",))

    def scene(shutter: Shutter) -> SceneAtShutter:
        return SceneAtShutter(shutter, (floor(), water, *receivers), (SUN,), looking_down(height=1.4))

    frame = render_frame(RenderContext(Source(scene), settings), shutter, ACROSS, ACROSS)
    return frame.channels["irradiance.R"].astype(float) / PASSED


@pytest.mark.parametrize(("photons", "wanted", "mean"), [(1 << 10, 0.05, 0.01), (1 << 14, 0.012, 0.002)])
def test_a_box_on_a_floor_and_the_floor_around_it_have_all_of_their_light(photons, wanted, mean):
    found = light_from_above([on_floor("/box", (0.8, 0.5, 0.3), 25.0)], photons, Shutter.still(0.0))
    assert found.mean() == pytest.approx(1.0, abs=mean)
    assert np.sqrt(np.mean((found - 1.0) ** 2)) < wanted


def test_a_box_that_slides_has_all_of_its_light():
    sliding = on_floor("/box", (0.8, 0.5, 0.3), 25.0, motion=(0.2, 0.1, 0.0))
    found = light_from_above([sliding], 1 << 14, Shutter(0.0, 0.0, 1.0))
    assert found.mean() == pytest.approx(1.0, abs=0.01)


def test_light_is_not_mirrored_through_a_thin_wall():
    """Behind it is a floor with light of its own; before a box there is none."""
    points, triangles = shapes.rectangle(1.0, 4.0)
    upright = points @ shapes.rotation((0.0, 1.0, 0.0), 90.0).T + [0.0, 0.0, 0.5]
    wall = MeshAtShutter("/wall", upright, triangles.astype(np.int32), None, materials=(Material(),))
    found = light_from_above([wall], 1 << 10, Shutter.still(0.0))
    assert np.abs(found - 1.0).max() < 0.01
