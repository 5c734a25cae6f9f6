"""Light at edges of receivers is whole: what footprints would spread beyond them comes back."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

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
VELOCITY = (0.2, 0.1, 0.0)
PASSED = 1.0 - fresnel_reflectance(0.0, 1.0, 1.33)


def on_floor(shutter: Shutter, velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> MeshAtShutter:
    """A box that stands on the floor, turned by 25°, in the middle of the picture at the time 0."""
    points, triangles = shapes.box((0.8, 0.5, 0.3))
    middle = 0.5 * (shutter.open + shutter.close) * np.float64(velocity)
    points = points @ shapes.rotation((0.0, 0.0, 1.0), 25.0).T + [0.0, 0.0, 0.15] + middle
    moves = any(velocity) and shutter.exposure > 0.0
    motions = np.broadcast_to(shutter.exposure * np.float64(velocity), points.shape) if moves else None
    return MeshAtShutter("/box", points, triangles.astype(np.int32), motions, None, None, None, (Material(),))


def from_above(receiver: Callable[[Shutter], MeshAtShutter], photons: int, shutter: Shutter) -> dict[str, np.ndarray]:
    """Channels of what a camera sees that looks down through flat water as the sun does: all of it is lit, and no
    shadow is seen."""
    water = quad("/water", (-3, -3), (3, 3), 1.8, Material(Interaction.DIELECTRIC, ior=1.33))
    settings = Settings(photons=photons, samples=4, threads=1, aovs=("irradiance", "motion", "photons", "id"))

    def scene(shutter: Shutter) -> SceneAtShutter:
        return SceneAtShutter(shutter, (floor(), water, receiver(shutter)), (SUN,), looking_down(height=1.4))

    return render_frame(RenderContext(Source(scene), settings), shutter, ACROSS, ACROSS).channels


def light_from_above(receiver: Callable[[Shutter], MeshAtShutter], photons: int, shutter: Shutter) -> np.ndarray:
    """What falls there, by what should fall."""
    return from_above(receiver, photons, shutter)["irradiance.R"].astype(float) / PASSED


@pytest.mark.parametrize(("photons", "wanted", "mean"), [(1 << 10, 0.05, 0.01), (1 << 14, 0.012, 0.002)])
def test_a_box_on_a_floor_and_the_floor_around_it_have_all_of_their_light(photons, wanted, mean):
    found = light_from_above(on_floor, photons, Shutter.still(0.0))
    assert found.mean() == pytest.approx(1.0, abs=mean)
    assert np.sqrt(np.mean((found - 1.0) ** 2)) < wanted


def test_a_box_that_slides_has_all_of_its_light():
    found = light_from_above(partial(on_floor, velocity=VELOCITY), 1 << 14, Shutter(0.0, -0.5, 0.5))
    assert found.mean() == pytest.approx(1.0, abs=0.01)


def test_light_is_not_mirrored_through_a_thin_wall():
    """Behind it is a floor with light of its own; before a box there is none."""
    points, triangles = shapes.rectangle(1.0, 4.0)
    upright = points @ shapes.rotation((0.0, 1.0, 0.0), 90.0).T + [0.0, 0.0, 0.5]
    wall = MeshAtShutter("/wall", upright, triangles.astype(np.int32), None, materials=(Material(),))
    found = light_from_above(lambda _: wall, 1 << 10, Shutter.still(0.0))
    assert np.abs(found - 1.0).max() < 0.01


def test_light_that_comes_back_over_an_edge_moves_as_its_photons_do():
    """Light stands, and goes over what slides against its way: beside edges as in the middle."""
    shutter = Shutter(0.0, -0.5, 0.5)
    channels = from_above(partial(on_floor, velocity=VELOCITY), 1 << 10, shutter)
    box = channels["id"] == channels["id"][ACROSS // 2, ACROSS // 2]
    # Pixels that see it for the whole shutter.
    seen = np.all([np.roll(box, (y, x), (0, 1)) for x in range(-4, 5) for y in range(-2, 3)], axis=0)
    found = np.stack([channels[f"motion.{axis}"][seen] for axis in "XYZ"], axis=-1)
    assert seen.sum() > 50
    np.testing.assert_allclose(found, np.broadcast_to(-np.array(VELOCITY), found.shape), atol=1e-5)
