"""Footprints that vanish, stretch, race, overhang: finite, and as much light as there is."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.photons.shapes import DIFFUSE, MIRROR, ball, field, floor, glass, mesh, moving, quad
from tests.photons.traced import EPS, sun
from tests.view.scenes import looking_down, wave_source
from tpdwarp.errors import InputError
from tpdwarp.scene.description import MeshAtShutter, SceneAtShutter, Shutter
from usd_scenes.oracle import Wave, irradiance_average
from usd_scenes.oracle.closed_forms import fresnel_reflectance

from .cases import MOTIONS, render, scene, slab

PASSING = 1 - fresnel_reflectance(0.0, 1.0, 1.33)


# Exposures and segments.


@pytest.mark.parametrize("motion", MOTIONS)
def test_a_vanishing_exposure_is_a_still(motion):
    here = MOTIONS[motion]()
    # Along straight trajectories: otherwise cells at the border are traced through several places as soon as time goes.
    still, brief = (render(here, Shutter(0, 0.5 - e / 2, 0.5 + e / 2), path="straight") for e in (0.0, 1e-6))
    for name in ("R", "caustic.R", "irradiance.R"):
        # A millionth of a frame moves footprints by less than 1e-6 of their size; queries too, if they move.
        brightest = still.channels[name].max()
        np.testing.assert_allclose(brief.channels[name], still.channels[name], atol=1e-4 * brightest, err_msg=name)


@pytest.mark.parametrize("exposure", [1.0, 10.0, 100.0, 1e6])
@pytest.mark.parametrize("motion", MOTIONS)
def test_long_exposures_are_finite_and_accounted_for(motion, exposure):
    render(MOTIONS[motion](), Shutter(0, 0.5 - exposure / 2, 0.5 + exposure / 2), most_lost=0.02)


@pytest.mark.parametrize("segments", [1, 2, 16, 64])
@pytest.mark.parametrize("motion", MOTIONS)
def test_segments_share_out_the_flux(motion, segments):
    frame, whole = (render(MOTIONS[motion](), segments=k) for k in (segments, 1))
    # A segment has cells for a K-th of the photons; they cover up to one more row on each side of what they aim at.
    assert frame.energy.sent == pytest.approx(whole.energy.sent, rel=2 * math.sqrt(segments / 1024))
    assert frame.energy.deposited == pytest.approx(whole.energy.deposited, rel=2 * math.sqrt(segments / 1024) + 0.02)


# Focus.


def bowl(line: bool) -> MeshAtShutter:
    """A parabolic mirror of focal length 1 below z = 0 that turns vertical light up to a line or a point."""
    x = np.linspace(-1, 1, 33)

    def height(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return (x * x + (0 if line else y * y)) / 4 - 1

    def slopes(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return x / 2, 0 * y if line else y / 2

    return field("/bowl", x, x, height, slopes, MIRROR)


@pytest.mark.parametrize("motion", ["deforming", "rigid"])
@pytest.mark.parametrize("line", [True, False])
def test_all_light_is_gathered_at_an_exact_focus(line, motion):
    motions = np.array([0.01, 0.005, 0.0])
    mirror = bowl(line)
    if motion == "deforming":
        mirror = moving(mirror, mirror.points[:, :1] * (0, 0.01, 0))
    else:
        mirror = moving(mirror, motions)
    screen = quad("/screen", (0, 0, 0), (0, 1.5, 0), (0.1, 0, 0), DIFFUSE)
    half = 1.5 if line else 0.1
    pixels = {"width": 16, "height": round(160 * half)}
    frames = []
    for aside in (-3, -2, -1, 0, 1, 2, 3, 4):
        # Where the focus lies in its pixel decides which samples see it.
        eye = looking_down((-0.1, 0.1, -half, half))
        place = np.array([0.2 / 16 * (aside / 8), 0.2 / 16 * (aside * 3 % 8 / 8), -0.5])
        eye = replace(eye, position=place, axes=np.diag([1.0, -1.0, -1.0]))
        frames.append(render(scene([mirror, screen], sun(), eye=eye), **pixels, photons=1024, samples=16))
    frame = frames[0]
    photons = frame.photons
    # Facets interpolate normals: h²/8 of their curvature over the way, as an angle.
    miss = 4 * (2 / 32) ** 2 / 8 + np.abs(motions).max()
    assert np.abs(photons.positions[:, 0]).max() < miss
    if not line:
        assert np.abs(photons.positions[:, 1]).max() < miss
    # The screen lies over its own shadow; all else arrives, and stays, however small its footprints are.
    assert frame.energy.deposited == pytest.approx(3 * (4 - 0.4), rel=0.05)
    gathered = np.array([frame.channels["irradiance.R"].astype(float).mean() for frame in frames]) * 0.6 * 2 * half
    # Samples see a point as bright as it is on average, and at each place to within 12 % (standard deviation).
    np.testing.assert_allclose(gathered, frame.energy.deposited, rtol=0.4)
    assert gathered.mean() == pytest.approx(frame.energy.deposited, rel=0.1)


@pytest.mark.parametrize("off", [-0.02, -1e-3, 0.0, 1e-3, 0.02])
def test_a_ball_lens_focuses_where_optics_has_it(off):
    n, radius = 1.5, 0.3
    focus = n * radius / (2 * (n - 1))
    lens = moving(ball("/lens", (0, 0, focus + off), radius, 48, glass(n)), (0.01, 0, 0))
    here = scene([lens, floor(half=0.3)], sun())
    photons = render(here, photons=16384).photons
    straight = photons.bounces == 2
    step = 2 * radius / math.sqrt(16384)
    middle = photons.emission[straight].mean(axis=0)
    near = straight & (np.hypot(*(photons.emission - middle).T) * step < 0.1 * radius)
    assert near.sum() > 30
    # Near the axis the image of the light's plane is that plane scaled by −off/focus.
    scale = np.median(photons.dxdu[near, 0]) / step
    # Spherical aberration at r = R/10, and normals interpolated over 48 cells a quarter turn.
    assert abs(scale + off / focus) < 1.5 * 0.1**2 + 3 * (0.5 * math.pi / 48) ** 2


@pytest.mark.parametrize("motion", ["smooth", "linear"])
def test_the_cusp_of_a_sinusoid_is_as_bright_as_it_is(motion):
    calm = Wave()
    # Crests focus paraxial light where 1 = height · amplitude k² (1 − 1/n), just below the water's mean level.
    height = 1 / (calm.amplitude * calm.wave_number**2 * (1 - 1 / calm.ior))
    wave = Wave(height=height + calm.amplitude)
    edges = np.linspace(-1, 1, 65)
    truth = irradiance_average(edges, wave, 0, 1, 64, motion)
    frame = render(wave_source(wave, motion), Shutter(0, 0, 1), 64, 8, photons=65536, segments=4, samples=4)
    found = frame.channels["irradiance.R"].astype(float)
    assert truth.max() > 2 * truth.mean()
    assert np.sqrt(np.mean((found - truth) ** 2)) < 0.05 * truth.mean()
    assert found.mean() == pytest.approx(truth.mean(), rel=0.01)


# Motion.

PLATE, CELL = 1.0, 2.0 / 32


def passing_by(way: float, motion: str, direction=(1.0, 0.0)) -> SceneAtShutter:
    """A flat plate of water that passes over the floor by ``way``; or its corners do, a tenth of them differently."""
    motions = np.tile([*(way * np.asarray(direction)), 0.0], (4, 1))
    if motion == "deforming":
        motions[:2] *= 1.1
    here = slab((0, 0, -1), 1.33, motions, PLATE)
    return replace(here, camera=looking_down((-0.5, 0.5, -0.5, 0.5), height=0.6))


@pytest.mark.parametrize("footprints", [1e-6, 1e-3, 1.0, 10.0])
@pytest.mark.parametrize("motion", ["deforming", "rigid"])
def test_the_middle_under_a_plate_stays_as_bright_as_it_is(motion, footprints):
    frame = render(passing_by(footprints * CELL, motion))
    inner = frame.channels["irradiance.R"]
    # Where it deforms, a tenth of the way shears footprints over each other.
    assert inner == pytest.approx(PASSING, rel=1e-4 if motion == "rigid" else 1e-4 + 0.11 * min(1.0, footprints / 10))


@pytest.mark.parametrize("footprints", [1e2, 1e3, 1e4, 1e5, 1e6])
@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, 1.0), (0.8, 0.6)])
def test_footprints_much_longer_than_the_receiver_leave_their_share(direction, footprints):
    way = footprints * CELL
    # In one trace: segments would have footprints of their own length.
    frame = render(passing_by(way, "rigid", direction), segments=1, path="straight")
    # Every point is lit while the plate passes over it: as long as a chord of the plate through it, over the way.
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, 33)[:-1] + 1 / 64, np.linspace(0.5, -0.5, 33)[:-1] - 1 / 64)
    chord = np.full_like(x, np.inf)
    for sign in (1, -1):
        reach = np.full_like(x, np.inf)
        for place, part in ((x, direction[0]), (y, direction[1])):
            if part:
                reach = np.minimum(reach, (PLATE - sign * np.sign(part) * place) / abs(part))
        chord = reach if sign == 1 else chord + reach
    # Footprints are found in single precision along their way: 2⁻²⁴ of it, beside their width.
    slack = 1e-3 + 4 * EPS * footprints
    found = frame.channels["irradiance.R"].astype(float)
    assert np.quantile(np.abs(found / (PASSING * chord / way) - 1), 0.95) < slack + 0.02


@pytest.mark.parametrize("motion", ["deforming", "rigid"])
def test_motion_beyond_all_measure_leaves_nothing_behind(motion):
    frame = render(passing_by(1e9, motion), most_lost=1.0)
    assert frame.channels["irradiance.R"].max() < 1e-6


@pytest.mark.parametrize("way", [1e20, 1e30])
@pytest.mark.parametrize("motion", ["deforming", "rigid"])
def test_motion_beyond_single_precision_is_refused(motion, way):
    with pytest.raises(InputError, match="times its size"):
        render(passing_by(way, motion), most_lost=1.0)


@pytest.mark.parametrize("speed", [1e-6, 1.0, 1e3, 1e6])
def test_a_receiver_that_races_below_still_water_is_rendered(speed):
    here = scene([floor(1.0, 1.0, glass(1.33), "/water"), moving(floor(half=4.0), (speed, 0, 0))], sun())
    render(here)


# Edges.


def lit_square(half: float, photons: int, motion: str, **changes):
    """Water of half width 1 over a square that is smaller; the square lies in the middle of the picture."""
    water = floor(1.0, 1.0, glass(1.33), "/water")
    ways = np.tile([0.1 * CELL, 0, 0], (4, 1))
    if motion == "deforming":
        ways[::2] = 0
    square = quad("/square", (0, 0, 0), (half, 0, 0), (0, half, 0), DIFFUSE)
    return render(scene([moving(water, ways), square], sun(), eye=looking_down((-1, 1, -1, 1), height=0.6)),
                  width=64, height=64, photons=photons, samples=4, **changes)


@pytest.mark.parametrize("photons", [256, 1024, 4096])
def test_what_hangs_over_the_edge_of_a_receiver_falls_on_it_all_the_same(photons):
    # Of B-splines a sixth of a cell hangs over on each side, with 256 photons 8 % of all; cells end where the last do.
    frame = lit_square(0.5, photons, "deforming", smoothing=1.001)
    seen = frame.channels["irradiance.R"].astype(float).mean() * 4 * 3
    assert frame.energy.deposited == pytest.approx(3 * PASSING, rel=1e-4)
    assert seen / frame.energy.deposited == pytest.approx(1.0, rel=2e-3)


@pytest.mark.parametrize("motion", ["deforming", "rigid"])
@pytest.mark.parametrize("photons", [1, 4, 64])
def test_footprints_larger_than_their_receiver_are_rendered(photons, motion):
    frame = lit_square(1e-3, photons, motion)
    assert frame.channels["irradiance.R"].max() <= PASSING * 1.05


@pytest.mark.parametrize("motion", ["deforming", "rigid"])
def test_footprints_across_a_corner_stay_on_their_own_side(motion):
    corner = mesh("/corner", [[0, -1, 0], [0, 1, 0], [-1, 1, 0], [-1, -1, 0], [0, -1, 0.8], [0, 1, 0.8]],
                  [[0, 1, 2], [0, 2, 3], [0, 4, 5], [0, 5, 1]], DIFFUSE)
    ways = np.tile([0.1, 0, 0], (4, 1))
    if motion == "deforming":
        ways[:2] = 0
    water = moving(floor(1.0, 1.0, glass(1.33), "/water"), ways)
    frame = render(scene([water, corner], sun(), eye=looking_down((-1, 1, -1, 1), height=0.9)), photons=256)
    # Nothing falls on the wall, which light passes along, and the floor gets what it gets.
    assert (frame.photons.positions[:, 2] == pytest.approx(0, abs=1e-5))
    assert frame.energy.deposited == pytest.approx(3 * 2 * PASSING, rel=0.1)
