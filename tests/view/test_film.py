"""What ends up in the channels of a frame."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from tests.view.scenes import ONE_THREAD, SUN, WATER, floor, looking_down, quad, steady
from tpdwarp.footprints.irradiance import Irradiance, QueryArrays
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import Material, Shutter
from tpdwarp.scene.normalization import Normalization
from tpdwarp.settings import Settings
from tpdwarp.trajectories.retraced import PARTS
from tpdwarp.view.film import BACKGROUND_DEPTH, Film
from tpdwarp.view.visibility import VisibleArrays, VisiblePoints
from usd_scenes.oracle.closed_forms import fresnel_reflectance

STILL, OPEN = Shutter(0, 0, 0), Shutter(0, 0, 1)
AOVS = ("caustic", "direct", "irradiance", "Z", "N", "P", "motion", "photons")
GREY = Material(color=(0.5, 0.5, 0.5))
R0 = fresnel_reflectance(0.0, 1.0, 1.33)


def render(meshes, camera=None, width=16, height=16, shutter=STILL, light=SUN, **settings):
    source = steady(meshes, (light,), camera or looking_down())
    chosen = Settings(photons=64, threads=1, aovs=AOVS, **settings)
    return render_frame(RenderContext(source, chosen), shutter, width, height).channels


def water(low=(-3, -3), high=(3, 3), height: float = 1.0):
    return quad("/water", low, high, height, WATER)


def xyz(channels, aov):
    return np.stack([channels[f"{aov}.{c}"] for c in "XYZ"], axis=-1).astype(float)


def rgb(channels, aov):
    return np.stack([channels[f"{aov}.{c}"] for c in "RGB"], axis=-1).astype(float)


def test_alpha_is_the_part_of_a_pixel_that_geometry_covers():
    edge = 0.0625 * 0.4
    channels = render([quad("/card", (-3, -3), (edge, 3), 0.0)], samples=16)
    covered = channels["A"].astype(float)
    np.testing.assert_array_equal(covered[:, :8], 1)
    np.testing.assert_array_equal(covered[:, 9:], 0)
    # 0.2 of the ninth column of pixels; sixteen evenly spread samples are off by at most two.
    np.testing.assert_allclose(covered[:, 8], edge / 0.125, atol=2 / 16)


def test_depth_is_measured_along_the_view_axis_and_background_is_far():
    channels = render([quad("/card", (-3, -3), (0, 3), 0.5)], looking_down(height=3.0))
    np.testing.assert_allclose(channels["Z"][:, :8], 2.5, rtol=1e-6)
    np.testing.assert_allclose(channels["Z"][:, 8:], BACKGROUND_DEPTH)


def test_depth_of_a_perspective_camera_is_planar_not_radial():
    camera = replace(looking_down((-0.8, 0.8, -0.8, 0.8)), orthographic=False)
    np.testing.assert_allclose(render([floor()], camera)["Z"], 3.0, rtol=1e-5)


def test_normals_face_the_camera_and_positions_are_where_its_rays_go():
    for up in (True, False):
        channels = render([floor(up=up)], samples=1)
        np.testing.assert_allclose(xyz(channels, "N"), np.broadcast_to([0, 0, 1.0], (16, 16, 3)), atol=1e-6)
        at = -1 + (np.arange(16) + 0.5) / 8
        expected = np.stack([*np.meshgrid(at, -at), np.zeros((16, 16))], axis=-1)
        np.testing.assert_allclose(xyz(channels, "P"), expected, atol=1e-5)


def test_depth_normal_and_position_are_those_of_the_glass_not_of_what_it_shows():
    channels = render([floor(), water()], samples=1)
    np.testing.assert_allclose(channels["Z"], 2.0, rtol=1e-6)
    np.testing.assert_allclose(xyz(channels, "P")[..., 2], 1.0, atol=1e-5)
    np.testing.assert_array_equal(channels["A"], 1)


def test_background_has_no_normal_position_or_light():
    channels = render([quad("/card", (-3, -3), (-2, 3), 0.0)])
    for name, values in channels.items():
        if name != "Z":
            assert not values.any(), name


def test_irradiance_is_what_falls_on_the_floor_whatever_it_is_seen_through():
    below = looking_down(height=0.9)
    dry, wet = render([floor(material=GREY), water()], below), render([floor(material=GREY), water()])
    # Light falls straight through flat water; the lattice of footprints is uniform to rounding in the middle.
    for channels in (dry, wet):
        np.testing.assert_allclose(rgb(channels, "irradiance"), 1 - R0, rtol=1e-4)
    np.testing.assert_allclose(rgb(dry, "caustic"), 0.5 / math.pi * (1 - R0), rtol=1e-4)
    # From above, radiance is less by the square of the index as well: its beam is wider there.
    np.testing.assert_allclose(rgb(wet, "caustic"), 0.5 / math.pi * (1 - R0) ** 2 / 1.33**2, rtol=1e-4)
    assert not rgb(dry, "direct").any() and not rgb(wet, "direct").any()


def test_radiance_keeps_its_scale_through_closed_glass_and_where_hosts_leave_it_out():
    slab = [water(), quad("/below", (-3, -3), (3, 3), 0.8, WATER, up=False)]
    through = rgb(render([floor(material=GREY), *slab], samples=1), "caustic")
    # Light and view each pass the slab, inner reflections of all orders with them.
    assert through.mean() == pytest.approx(0.5 / math.pi * ((1 - R0) / (1 + R0)) ** 2, rel=0.005)
    unscaled = rgb(render([floor(material=GREY), water()], refracted_radiance="unscaled"), "caustic")
    np.testing.assert_allclose(unscaled, 0.5 / math.pi * (1 - R0) ** 2, rtol=1e-4)


def test_irradiance_of_a_pixel_is_the_mean_over_the_surfaces_seen_not_over_background():
    """One pixel, of whose four samples two see a floor and one sees glass with nothing behind it."""
    norm = Normalization((0.0, 0.0, 0.0), 0.5, 1.0)
    queries, arrays = ONE_THREAD.rows(QueryArrays, 4), ONE_THREAD.rows(VisibleArrays, 4)
    queries.receiver = ONE_THREAD.array(np.array([0, 0, -1, -1]), wp.int32)
    arrays.first_depth = ONE_THREAD.array(np.array([1.5, 1.0, 2.0, -1.0]), wp.float32)
    arrays.weight = ONE_THREAD.array(np.array([[0.25] * 3, [0.5] * 3, [0] * 3, [0] * 3]), wp.vec3)
    found = np.array([[4.0] * 3, [8.0] * 3, [0] * 3, [0] * 3], np.float32)
    film = Film(1, 1, 4, norm, 1.0, AOVS)
    points = VisiblePoints(np.arange(4), queries, arrays, True)
    film.add_view(points, np.zeros(4, int), 1.0)
    film.add_caustic(np.zeros(4, int), points.arrays.weight.numpy(), np.ones(4, int), Irradiance(found))
    channels = {name: float(values[0, 0]) for name, values in film.channels().items()}
    # Lengths are doubled in scene units, so that areas count four times.
    assert channels["irradiance.R"] == pytest.approx(6.0 / 4)
    assert channels["caustic.R"] == pytest.approx((0.25 * 4 + 0.5 * 8) / 4 / 4)
    assert channels["A"] == pytest.approx(3 / 4)
    assert channels["Z"] == pytest.approx(2.0)


def test_beauty_is_direct_light_plus_caustics():
    channels = render([floor(material=GREY), quad("/water", (-0.4, -0.4), (0.4, 0.4), 1.0, WATER)])
    total = rgb(channels, "direct") + rgb(channels, "caustic")
    beauty = np.stack([channels[c] for c in "RGB"], axis=-1)
    np.testing.assert_allclose(beauty, total, rtol=1e-6)
    assert rgb(channels, "direct").any() and rgb(channels, "caustic").any()


def test_the_cameras_exposure_scales_radiance_only():
    plain, bright = (render([floor(), water()], looking_down(exposure_scale=scale)) for scale in (1.0, 4.0))
    for name in plain:
        factor = 4 if name in "RGB" or name.startswith(("direct", "caustic")) else 1
        np.testing.assert_allclose(bright[name], factor * plain[name], rtol=1e-6, err_msg=name)


def test_more_samples_do_not_change_a_uniform_picture():
    few, many = (render([floor(), water()], samples=samples) for samples in (1, 8))
    for name in ("R", "A", "Z", "irradiance.R"):
        np.testing.assert_allclose(few[name], many[name], rtol=1e-4)


@pytest.mark.parametrize("way", [0.5, -0.75])
def test_a_moving_edge_is_a_linear_coverage_ramp_as_wide_as_its_way(way):
    samples, width = 16, 32
    card = quad("/card", (-3, -3), (0, 3), 0.0, motion=(way, 0, 0))
    channels = render([card], width=width, height=8, shutter=OPEN, samples=samples)
    x = -1 + (np.arange(width) + 0.5) * 2 / width
    ramp = np.clip(0.5 - x / abs(way), 0, 1)
    # Each of the sample times sees the edge right to within one sample, and a pixel's own width smears it.
    per_pixel = 1 / samples + (2 / width) / abs(way)
    np.testing.assert_allclose(channels["A"], np.broadcast_to(ramp, (8, width)), atol=per_pixel)
    # Rows are independent, so that their mean is closer; what is left is the ramp's own bend over a pixel.
    np.testing.assert_allclose(channels["A"].mean(axis=0), ramp, atol=0.4 * per_pixel)
    # Direct light goes with coverage.
    np.testing.assert_allclose(channels["direct.R"], channels["A"] / math.pi, rtol=1e-5)


def test_a_moving_card_drags_its_shadow_along():
    way, width = 0.5, 32
    card = quad("/card", (-3, -3), (0, 3), 4.0, motion=(way, 0, 0))
    lit = render([floor(), card], width=width, height=8, shutter=OPEN, samples=16)["direct.R"] * math.pi
    x = -1 + (np.arange(width) + 0.5) * 2 / width
    expected = np.clip(0.5 + x / way, 0, 1)
    np.testing.assert_allclose(lit, np.broadcast_to(expected, (8, width)), atol=1 / 16 + (2 / width) / way)


def test_a_floor_that_a_board_hides_in_part_is_lit_as_while_it_is_seen():
    way, width = 0.5, 32
    black = Material(color=(0.0, 0.0, 0.0))
    board = quad("/board", (-3, -3), (0, 3), 0.2, black, motion=(way, 0, 0))
    source = steady([floor(), water(), board], (SUN,), looking_down(height=0.5))
    settings = Settings(photons=4096, threads=1, aovs=("caustic",), samples=16, segments=1)
    caustic = render_frame(RenderContext(source, settings), OPEN, width, 8).channels["caustic.R"].mean(axis=0)
    x = -1 + (np.arange(width) + 0.5) * 2 / width
    # Straight below the water, light falls where the board is not, and there the camera sees the floor. Lit by the mean
    # of the shutter it would be the square of this.
    seen = np.clip(0.5 + x / way, 0, 1)
    # When the board covers a cell is known to half of a part of the shutter, when it hides the floor to half a sample.
    np.testing.assert_allclose(caustic * math.pi / (1 - R0), seen, atol=0.5 / PARTS + 0.5 / 16)


def test_motion_and_photon_counts_are_reported_where_photons_fell():
    sheet = replace(water(), motions=np.tile([0.0, 0, 0.1], (4, 1)))
    channels = render([floor(), sheet], looking_down(height=0.5), shutter=OPEN)
    # Vertical light through water that rises: nothing moves sideways.
    np.testing.assert_allclose(xyz(channels, "motion"), 0, atol=1e-6)
    # Support of three by three cells, and a query lies in nine of them.
    assert np.all(channels["photons"] >= 9) and channels["photons"].mean() < 11


def test_light_with_colour_stays_in_its_channel():
    red = replace(SUN, power=(2.0, 0.0, 0.5))
    channels = render([floor(), water()], looking_down(height=0.9), light=red)
    np.testing.assert_allclose(rgb(channels, "irradiance")[..., 0], 2 * (1 - R0), rtol=1e-4)
    assert not channels["G"].any()
    np.testing.assert_allclose(4 * channels["B"], channels["R"], rtol=1e-6)
