"""Laws of curved trajectories: how D_t x and the axes of footprints change while the shutter is open."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.estimators.frames import OPEN, SETTINGS, irradiance, rendered
from tests.footprints.photons import queries
from tests.view.scenes import (
    SUN,
    WATER,
    Source,
    bumpy,
    floor,
    looking_down,
    quad,
    steady,
    turning_rod_source,
    wave_source,
)
from tpdwarp.clock import Clock
from tpdwarp.estimators import ESTIMATORS
from tpdwarp.footprints.irradiance import Lookup
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import LightAtShutter, LightKind, SceneAtShutter, Shutter
from tpdwarp.settings import Settings
from tpdwarp.trajectories.brightening import follow_lights
from tpdwarp.trajectories.fit import fit_trajectories
from tpdwarp.trajectories.keyframes import ShutterKeyframes
from tpdwarp.usd.read.stage import StageScene
from tpdwarp.view.camera import pixel_size
from usd_scenes.oracle import Wave, irradiance_average
from usd_scenes.oracle.caustic_1d import landing
from usd_scenes.oracle.closed_forms import fresnel_reflectance
from usd_scenes.solids import write
from usd_scenes.stage import CAMERA, FRAME

FOLDED = Wave(wavelength=0.65, speed=0.65 / 8)


def fitted_photons(
    source, shutter: Shutter = OPEN, weight: float = 1.0, **changes
) -> tuple[PhotonMap, RenderContext]:
    settings = Settings.of(SETTINGS, **changes)
    context, clock = RenderContext(source, settings), Clock()
    tracer = context.tracer
    plan, loaded = tracer.plan(settings.photons), tracer.load(shutter)
    keyframes = ShutterKeyframes.over(tracer, plan, loaded, clock, weight)
    photons, _ = tracer.trace(loaded, plan, clock, tags=keyframes.tags.of(loaded.scene), weight=weight)
    found, account = fit_trajectories(photons, plan, keyframes, clock)
    assert account.counts["keyframes"] == keyframes.emitted > 0
    return found, context


def on_water(photons: PhotonMap) -> np.ndarray:
    """Where vertical light met water from −2 to 2, which the lattice fills."""
    return photons.emission[:, 0].astype(np.float64) * 4 / np.ceil(photons.emission[:, 0].max()) - 2


def root_mean_square(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def test_light_under_a_wave_accelerations_as_its_exact_derivatives_say():
    wave = Wave()
    photons, context = fitted_photons(wave_source(wave), photons=16384)
    scale, fitted = context.normalization.scale, photons.trajectory
    x0 = on_water(photons)
    # Means of derivatives over the shutter with other weights, between keyframes λ/10 apart; beyond the last ones are
    # none.
    inside = np.abs(x0) < 1.9
    at = {k: landing(x0, 0.5 + 0.4375 * k, wave) for k in (-2, -1, 0, 1, 2)}
    second = (at[1] - 2 * at[0] + at[-1]) / 0.4375**2
    third = (0.5 * at[2] - at[1] + at[-1] - 0.5 * at[-2]) / 0.4375**3
    for found, exact, limit in ((fitted.dxdtt, second, 0.1), (fitted.dxdttt, third, 0.2)):
        error = (found[:, 0] / scale - exact)[inside]
        assert root_mean_square(error) < limit * root_mean_square(exact)
        np.testing.assert_allclose(found[:, 1:], 0, atol=2e-2 * root_mean_square(exact) * scale)


def test_axes_change_under_a_wave_as_exact_mixed_derivatives_say():
    wave, step = Wave(), 1e-3
    photons, context = fitted_photons(wave_source(wave), photons=16384)
    x0, cell = on_water(photons), 4 / np.ceil(photons.emission[:, 0].max())
    exact = cell * sum(
        side_x * side_t * landing(x0 + side_x * step, 0.5 + side_t * step, wave)
        for side_x in (-1, 1)
        for side_t in (-1, 1)
    ) / (4 * step**2)  # fmt: skip
    inside = np.abs(x0) < 1.9
    fitted, scale = photons.trajectory, context.normalization.scale
    along, across = fitted.dxdut / scale, fitted.dxdvt / scale
    assert root_mean_square(along[inside, 0] - exact[inside]) < 0.03 * root_mean_square(exact)
    assert root_mean_square(across[inside]) < 1e-3 * root_mean_square(exact)


@pytest.mark.parametrize("degrees", [5.0, 20.0])
def test_light_that_rides_on_a_turning_rod_goes_in_circles(degrees):
    source = turning_rod_source(degrees, looking_down(height=0.1))
    photons, context = fitted_photons(source, photons=16384)
    position = context.normalization.world_points(photons.position)[:, :2]
    acceleration = photons.trajectory.dxdtt[:, :2] / context.normalization.scale
    told = np.any(acceleration != 0, axis=1)
    assert told.mean() > 0.6
    expected = -(math.radians(degrees) ** 2) * position
    # The chord of an arc of D_t x, and facets that are not quite a cylinder.
    error = np.linalg.norm(acceleration - expected, axis=1)[told]
    assert np.median(error) < 0.05 * np.median(np.linalg.norm(expected, axis=1))


def test_footprints_that_ride_on_a_turning_rod_turn_with_it():
    degrees = 5.0
    photons, _ = fitted_photons(turning_rod_source(degrees, looking_down(height=0.1)), photons=16384)
    for found, axis in ((photons.trajectory.dxdut, photons.dxdu), (photons.trajectory.dxdvt, photons.dxdv)):
        expected = math.radians(degrees) * np.cross((0, 0, 1), axis)
        error = np.linalg.norm(found - expected, axis=1)
        assert np.median(error) < 0.05 * np.median(np.linalg.norm(expected, axis=1))


def test_a_lamp_that_brightens_ninefold_has_its_light_brighten_as_it_goes():
    def at(shutter: Shutter) -> SceneAtShutter:
        way = np.array([0.2, 0.0, 0.0])
        water = bumpy("/water", WATER, 1.0, False)
        motions = np.tile(shutter.exposure * way, (len(water.points), 1)) if shutter.exposure else None
        water = replace(water, points=water.points + (shutter.middle - 0.5) * way, motions=motions)
        sun = replace(SUN, power=(1.0 + 1.6 * (shutter.middle - 0.5),) * 3)
        return SceneAtShutter(shutter, (floor(), water), (sun,), looking_down(height=0.6))

    (photons,) = follow_lights(fitted_photons(Source(at))[0])
    # From 0.2 to 1.8 of its mean, whether keyframes see the photon or not.
    assert np.median(photons.trajectory.gain) == pytest.approx(1.6, rel=1e-4)
    assert (np.abs(photons.trajectory.gain - 1.6) < 0.1).mean() > 0.95


def test_light_that_rides_on_what_moves_straight_on_goes_straight():
    def at(shutter: Shutter) -> SceneAtShutter:
        way = np.array([0.2, 0.0, 0.0])
        water = bumpy("/water", WATER, 1.0, False)
        motions = np.tile(shutter.exposure * way, (len(water.points), 1)) if shutter.exposure else None
        water = replace(water, points=water.points + (shutter.middle - 0.5) * way, motions=motions)
        return SceneAtShutter(shutter, (floor(), water), (SUN,), looking_down(height=0.6))

    photons, context = fitted_photons(Source(at), photons=16384)
    way = 0.2 * context.normalization.scale
    assert np.median(np.abs(photons.trajectory.dxdtt)) < 1e-3 * way
    assert np.median(np.abs(photons.trajectory.dxdttt)) < 1e-2 * way


@pytest.mark.parametrize(("wave", "photons", "gain"), [(Wave(), 16384, 7), (FOLDED, 65536, 8)], ids=["soft", "folds"])
def test_curved_trajectories_take_most_of_what_straight_ones_err_by(wave, photons, gain):
    truth = irradiance_average(np.linspace(-1, 1, 257), wave, 0, 1, 256, "smooth")
    source = wave_source(wave)
    frames = [rendered(source, columns=256, photons=photons, path=path) for path in ("curved", "straight")]
    curved, straight = (np.sqrt(np.mean((irradiance(frame) - truth) ** 2)) for frame in frames)
    assert gain * curved < straight


def test_curved_trajectories_keep_the_flux():
    curved, straight = (
        rendered(wave_source(FOLDED), columns=128, photons=16384, path=path) for path in ("curved", "straight")
    )
    # But for what the surface reflects more of as the wave passes (below).
    assert curved.energy.sent == pytest.approx(straight.energy.sent, rel=1e-5)
    assert curved.energy.deposited == pytest.approx(straight.energy.deposited, rel=1e-5)
    # Light that crosses the rims of the picture aside, of which at most 2 % move by more or less.
    assert irradiance(curved).mean() == pytest.approx(irradiance(straight).mean(), rel=5e-3)
    assert curved.energy.counts["keyframes"] > 0 and "keyframes" not in straight.energy.counts


def test_where_nothing_moves_nothing_is_traced_twice():
    still = rendered(shutter=Shutter(0, 0.5, 0.5), photons=1024)
    assert "keyframes" not in still.energy.counts


def rising_water(speed: float) -> Source:
    """Flat water, 1 deep at mid shutter, that rises towards a lamp 3 above the floor."""
    water = quad("/water", (-1, -1), (1, 1), 1.0, WATER, motion=(0, 0, speed))
    lamp = LightAtShutter("/lamp", LightKind.POINT, (1.0, 1.0, 1.0), position=np.array([0.0, 0.0, 3.0]))
    return steady([floor(), water], (lamp,), looking_down(height=0.5))


def test_flux_follows_the_cells_that_ride_towards_a_lamp():
    """Material points of the water spread over the light as they near it, and their cells take more of it."""
    speed = 0.8
    photons, _ = fitted_photons(rising_water(speed), photons=4096)
    off_axis = np.linalg.norm(photons.position[:, :2], axis=1)
    near = off_axis < 0.1 * off_axis.max()
    assert near.sum() > 10
    # A point r off the axis lies at the angle r/(2 − s w), so that solid angles of cells go with (2 − s w)⁻².
    np.testing.assert_allclose(photons.trajectory.gain[near], 2 * speed / 2, rtol=0.05)


@pytest.mark.parametrize("time", [-0.375, 0.375])
def test_light_under_water_that_rises_towards_a_lamp_is_that_of_the_time(time):
    speed = 0.4
    context, clock = RenderContext(rising_water(speed), Settings.of(SETTINGS, photons=4096)), Clock()
    pixel, tracer, norm = pixel_size(None, 1), context.tracer, context.normalization
    (part,) = ESTIMATORS["tpd"]().parts(tracer, OPEN, [tracer.load(OPEN)], pixel, clock)
    below = queries(norm.points(np.zeros((1, 3))))
    seen = part.light.irradiance(below, Lookup(time, (time, 0.25)))
    found = seen.irradiance[0, 0] * norm.scale**2 * norm.power
    # Flat water of depth z makes its lamp, d above it, seem d + z/n off.
    depth = 1 + speed * time
    exact = (1 - fresnel_reflectance(0.0, 1.0, 1.33)) / (3 - depth + depth / 1.33) ** 2
    # Flux and area grow linearly, which leaves the squares of s w/d, 0.006, three times in all. Were flux that of mid
    # shutter, it would be off by 0.15.
    assert found == pytest.approx(exact, rel=0.018)


def test_flux_is_the_mean_over_the_shutter_where_it_does_not_grow_along_a_line():
    """A pane of water turns away from the light: what it catches falls evenly, what enters it ever faster."""
    tilt, turn = math.radians(80.0), math.radians(8.0)
    flat = quad("/water", (-1, -1), (1, 1), 0.0, WATER)
    along = np.array([math.cos(tilt), 0.0, -math.sin(tilt)])
    across = np.array([-math.sin(tilt), 0.0, -math.cos(tilt)])
    x, y = flat.points[:, :1], flat.points[:, 1:2] * (0.0, 1.0, 0.0)
    pane = replace(flat, points=x * along + y + (0.0, 0.0, 3.0), motions=turn * x * across)
    source = steady([floor(20.0), pane], (SUN,), looking_down(height=1.0))
    photons, context = fitted_photons(source, photons=4096)
    tracer = context.tracer
    middle, _ = tracer.trace(tracer.load(OPEN), tracer.plan(4096), Clock())
    np.testing.assert_array_equal(photons.ids, middle.ids)
    # The other half is reflected, which carries less.
    paths = np.unique(photons.path)
    entered = photons.path == max(paths, key=lambda path: photons.flux[photons.path == path].sum())
    times = (np.arange(1000) + 0.5) / 1000 - 0.5
    sides = along + turn * times[:, None] * across
    angles = np.arctan2(-sides[:, 2], sides[:, 0])
    light = sides[:, 0] * [1 - fresnel_reflectance(angle, 1.0, 1.33) for angle in angles]
    found = photons.flux[entered].sum() / middle.flux[entered].sum()
    # The light that enters is no parabola: the one through its ends lacks .0022.
    assert found == pytest.approx(light.mean() / light[500], rel=3e-3)
    assert found > 1.01


def test_a_segment_has_its_part_of_the_light_at_borders_too():
    """What keyframes do not know is traced at the ends of the shutter, with the flux of the whole exposure."""
    source = turning_rod_source(5.0, looking_down(height=0.1))
    whole, part = (fitted_photons(source, weight=weight, photons=4096)[0].flux for weight in (1.0, 0.25))
    np.testing.assert_allclose(part, 0.25 * whole, rtol=1e-4)


def below_flat_water(lamp: np.ndarray, surface: float, floor_points: np.ndarray) -> np.ndarray:
    """Irradiance on the floor z = 0 at points [n, 2] from a point of unit intensity above flat water, shape [n]."""
    angle = np.linspace(1e-6, 1.5, 4001)
    below = np.arcsin(np.sin(angle) / 1.33)
    radius = (lamp[2] - surface) * np.tan(angle) + surface * np.tan(below)
    passed = np.array([1.0 - fresnel_reflectance(a, 1.0, 1.33) for a in angle])
    # The light of a ring of directions on the ring of the floor that it meets.
    lit = passed * np.sin(angle) / (radius * np.gradient(radius, angle))
    return np.interp(np.linalg.norm(floor_points - lamp[:2], axis=1), radius, lit)


@pytest.mark.parametrize(
    ("lamp_way", "water_way"), [((0, 0, -0.8), 0.0), ((1.2, 0, 0), 0.0), ((0.8, 0.3, -0.6), 0.0), ((0, 0, 0), 0.8)]
)
@pytest.mark.parametrize("segments", [1, 2])
def test_light_of_a_lamp_that_nears_flat_water_is_its_mean_over_the_shutter(lamp_way, water_way, segments):
    """Flux at mid shutter in its place is off by 5 % in the mean."""
    at, way = np.array([0.3, 0.2, 2.4]), np.array(lamp_way)
    camera = looking_down((-1.0, 1.0, -1.0, 1.0), height=0.5)

    def scene(shutter: Shutter) -> SceneAtShutter:
        late = shutter.middle - 0.5
        motion = (0.0, 0.0, water_way * shutter.exposure)
        water = quad("/water", (-3, -3), (3, 3), 1.0 + late * water_way, WATER, motion=motion)
        lamp = LightAtShutter(
            "/lamp", LightKind.POINT, (1.0, 1.0, 1.0), at + late * way, position_motion=shutter.exposure * way
        )
        return SceneAtShutter(shutter, (floor(6.0), water), (lamp,), camera)

    settings = Settings.of(SETTINGS, photons=1 << 14, samples=4, segments=segments)
    frame = render_frame(RenderContext(Source(scene), settings), OPEN, 32, 32)
    middles = (2.0 * np.arange(32) + 1.0) / 32 - 1.0
    places = np.stack(np.meshgrid(middles, -middles), axis=2).reshape(-1, 2)
    times = (np.arange(64) + 0.5) / 64 - 0.5
    exact = np.mean([below_flat_water(at + s * way, 1.0 + s * water_way, places) for s in times], axis=0)
    found = frame.channels["irradiance.R"].astype(float).ravel()
    assert found.mean() == pytest.approx(exact.mean(), rel=0.015 / segments**2)
    assert root_mean_square(found - exact) < 0.025 / segments * root_mean_square(exact)
    energy = frame.energy
    assert energy.sent == pytest.approx(energy.deposited + energy.escaped + energy.absorbed + energy.lost_total)


@pytest.mark.parametrize("photons", [16384, 49152])
def test_light_at_rest_beside_an_edge_that_passes_stays_at_rest(tmp_path, photons):
    """Keyframes tell where light is by the cells around, of which a board covers some as the shutter closes."""
    settings = Settings.of(SETTINGS, photons=photons, camera=CAMERA)
    stage = StageScene.open(str(write("board-over-water", tmp_path)), settings)
    found, _ = fitted_photons(stage, stage.shutter(FRAME, settings), photons=photons, camera=CAMERA)
    # What water reflects lands on the board from below, which moves.
    found = found.rows(np.abs(found.normal[:, 2] - 1.0) < 1e-6)
    assert len(found) > photons // 3
    np.testing.assert_array_equal(found.dxdt, 0.0)
    for column in (found.trajectory.dxdtt, found.trajectory.dxdttt):
        assert (np.linalg.norm(column, axis=1) <= 1e-3 * found.size).all()
