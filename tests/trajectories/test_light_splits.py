"""Into how many parts lights with extent are cut."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.footprints.photons import photon_map
from tests.view.scenes import SUN, WATER, bumpy, floor, looking_down, steady
from tpdwarp.photons.energy import COARSE_PARTS
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import (
    EmissionProfile,
    Extent,
    ExtentShape,
    Interaction,
    LightAtShutter,
    LightKind,
    Material,
    MeshAtShutter,
    Shaping,
    Shutter,
)
from tpdwarp.scene.light_places import pieces_of_disc
from tpdwarp.settings import Settings
from tpdwarp.trajectories.light_splits import (
    FEWEST_PHOTONS,
    LEFT_OUT,
    LEFT_OUT_POWER,
    MOST_RINGS,
    Foreseen,
    _squares,
    candidates,
)
from usd_scenes import shapes

SPANS = np.array([[0.4, 0.0, 0.0], [0.0, 0.25, 0.0]])


def glass_ball(height: float, roughness: float = 0.0) -> MeshAtShutter:
    """A smooth ball of radius .4 above the origin."""
    points, triangles, normals = shapes.sphere()
    triangles = np.ascontiguousarray(triangles, np.int32)
    glass = Material(Interaction.DIELECTRIC, ior=1.5, roughness=roughness)
    return MeshAtShutter(
        "/ball", 0.4 * points + (0.0, 0.0, height), triangles,
        normals=normals, normal_indices=triangles, materials=(glass,),
    )  # fmt: skip


@pytest.mark.parametrize("count", [7, 19, 61, 217])
def test_rectangles_leave_out_as_much_of_a_disc_as_is_counted(count):
    """By the middles of a grid of 500 squares across, within a tenth: the law is fitted to all of these."""
    middles = (np.arange(600) + 0.5) / 250 - 1.2
    points = np.stack(np.meshgrid(middles, middles), axis=-1)
    inside = np.linalg.norm(points, axis=-1) < 1
    covered = np.zeros(inside.shape)
    for number, (place, sides) in enumerate(pieces_of_disc(count)):
        along = np.abs((points - place) @ np.linalg.inv(sides))
        covered += along.max(axis=-1) < 1 if number else np.linalg.norm(along, axis=-1) < 1
    left_out = 0.5 * np.abs(covered - inside).sum() / inside.sum()
    assert left_out == pytest.approx(LEFT_OUT * count**LEFT_OUT_POWER, rel=0.1)


@pytest.mark.parametrize("photons", [100, 1 << 14, 1 << 18, 1 << 22])
def test_numbers_of_parts_are_those_that_discs_are_cut_into_and_leave_each_enough_photons(photons):
    numbers = candidates(photons)
    assert numbers[0] == 1 and all(len(pieces_of_disc(int(number))) == number for number in numbers)
    assert (numbers[1:] * FEWEST_PHOTONS <= photons).all()
    # The next ring would leave too few, or there are as many as there may be.
    rings = len(numbers)
    assert rings > MOST_RINGS or (1 + 3 * rings * (rings + 1)) * FEWEST_PHOTONS > photons


def test_photons_count_by_the_irradiance_where_they_lie():
    """Three photons in one cube and one in another: each of the three stands for three times as much."""
    places = [(0.1, 0.1, 0.0), (0.2, 0.3, 0.0), (0.4, 0.4, 0.0), (5.2, 0.1, 0.0)]
    photons = photon_map(places, (0.1, 0, 0), (0, 0.1, 0))
    np.testing.assert_allclose(_squares(photons, 1.0), np.array([3, 3, 3, 1]) / 10, rtol=1e-6)


@pytest.mark.parametrize(("height", "least"), [(60.0, 1), (1.4, 7)])
def test_a_light_near_the_water_is_split_and_one_far_off_is_not(height, least):
    panel = LightAtShutter("/lamp", LightKind.POINT, (4.0,) * 3, np.array([0.3, 0.2, height]))
    extent = Extent(ExtentShape.RECT, 0.0, SPANS)
    light = replace(panel, profile=EmissionProfile.COSINE, extent=extent)
    source = steady([floor(), bumpy("/water", WATER, 1.0, False)], (light,), looking_down(height=0.6))
    context = RenderContext(source, Settings(photons=1 << 14, samples=1, threads=1))
    parts = render_frame(context, Shutter(0, 0, 0), 8, 8).energy.counts.get("parts of each light with extent", 1)
    assert parts == 1 if least == 1 else parts >= least


@pytest.mark.parametrize(("height", "splits", "told"), [(60.0, 1, False), (1.4, 1, True), (1.4, "auto", False)])
def test_a_number_of_parts_whose_light_errs_far_more_than_another_is_told_of(height, splits, told):
    """In one part a panel just above the water errs by a quarter, and no flux is lost on the way."""
    panel = LightAtShutter("/lamp", LightKind.POINT, (4.0,) * 3, np.array([0.3, 0.2, height]))
    light = replace(panel, profile=EmissionProfile.COSINE, extent=Extent(ExtentShape.RECT, 0.0, SPANS))
    source = steady([floor(), bumpy("/water", WATER, 1.0, False)], (light,), looking_down(height=0.6))
    context = RenderContext(source, Settings(photons=1 << 14, samples=1, threads=1, light_splits=splits))
    energy = render_frame(context, Shutter(0, 0, 0), 8, 8).energy
    assert energy.lost_total < 0.01 * energy.sent
    assert (energy.counts.get(COARSE_PARTS, 0) > 25) == told


def test_a_sphere_far_above_a_ball_is_as_well_lit_by_many_parts_as_by_one():
    """Ten times as far off as it is wide, 19 and 61 parts differ from one by .006 and .008; clouds of 19 by .015."""
    ball = glass_ball(0.6)
    lamp = LightAtShutter("/lamp", LightKind.POINT, (4.0,) * 3, np.array([0.6, 0.4, 4.0]))
    lamp = replace(lamp, extent=Extent(ExtentShape.ROUND, 0.16))
    source = steady([floor(), ball], (lamp,), looking_down((-0.6, 0.4, -0.6, 0.4), height=0.1))
    found = []
    for count in (1, 19, 61):
        settings = Settings(photons=1 << 16, samples=1, threads=1, light_splits=count, aovs=("irradiance",))
        frame = render_frame(RenderContext(source, settings), Shutter(0, 0, 0), 48, 48)
        found.append(frame.channels["irradiance.R"].astype(np.float64))
    one, *many = found
    for split in many:
        assert np.sqrt(np.mean((split - one) ** 2) / np.mean(one**2)) < 0.01


@pytest.mark.parametrize("shape", [ExtentShape.DISK, ExtentShape.RECT, ExtentShape.CYLINDER])
def test_few_parts_of_a_lamp_beside_glass_send_as_much_light_through_it_as_many(shape):
    """In one part 22 to 34 % less without: its middle does not see what the rim does."""
    ball = glass_ball(0.8)
    lamp = LightAtShutter("/lamp", LightKind.POINT, (4.0,) * 3, np.array([0.1, 0.05, 1.5]))
    spans, radius, profile = 0.3 * np.eye(3)[:2], 0.0, EmissionProfile.COSINE
    if shape == ExtentShape.CYLINDER:
        spans, radius, profile = spans * [[1.2], [0.0]], 0.08, EmissionProfile.SINE
    light = replace(lamp, profile=profile, extent=Extent(shape, radius, spans))
    source = steady([floor(), ball], (light,), looking_down((-0.8, 0.8, -0.8, 0.8), height=0.3))
    means = {}
    for splits in ("auto", 1, 4):
        settings = Settings(photons=1 << 14, samples=4, threads=1, light_splits=splits, aovs=("irradiance",))
        frame = render_frame(RenderContext(source, settings), Shutter(0, 0, 0), 24, 24)
        means[splits] = frame.channels["irradiance.R"].mean(), frame.energy.deposited
    for splits in (1, 4):
        np.testing.assert_allclose(means[splits], means["auto"], rtol=0.03)


@pytest.mark.parametrize("roughness", [0.0, 0.06])
def test_a_lamp_beside_rough_glass_is_split_as_beside_smooth_glass(roughness):
    """Photons of rough glass have lobes in the place of images of lights: in one part a rectangle erred by .8."""
    ball = glass_ball(0.6, roughness)
    lamp = LightAtShutter("/lamp", LightKind.POINT, (4.0,) * 3, np.array([0.1, 0.1, 1.3]))
    light = replace(lamp, profile=EmissionProfile.COSINE, extent=Extent(ExtentShape.RECT, 0.0, SPANS))
    source = steady([floor(), ball], (light,), looking_down((-0.8, 0.8, -0.8, 0.8), height=0.1))
    context = RenderContext(source, Settings(photons=1 << 14, samples=1, threads=1))
    parts = render_frame(context, Shutter(0, 0, 0), 8, 8).energy.counts.get("parts of each light with extent", 1)
    assert parts >= 37


def test_what_roughness_blurs_takes_fewer_parts():
    """A rectangle over a ball: 217 parts of smooth glass, 19 of a roughness of .4, which err as little as 91 there."""
    lamp = LightAtShutter("/lamp", LightKind.POINT, (4.0,) * 3, np.array([0.1, 0.1, 2.0]))
    light = replace(lamp, profile=EmissionProfile.COSINE, extent=Extent(ExtentShape.RECT, 0.0, SPANS))

    def light_of(roughness, **changes):
        camera = looking_down((-0.8, 0.8, -0.8, 0.8), height=0.1)
        source = steady([floor(), glass_ball(0.6, roughness)], (light,), camera)
        context = RenderContext(source, Settings(samples=1, threads=1, aovs=("irradiance",), **changes))
        frame = render_frame(context, Shutter(0, 0, 0), 16, 16)
        found = frame.channels["irradiance.R"].astype(np.float64)
        return found, frame.energy.counts.get("parts of each light with extent", 1)

    smooth, rough = (light_of(roughness, photons=1 << 16) for roughness in (0.0, 0.4))
    assert rough[1] < 0.5 * smooth[1]
    truth, _ = light_of(0.4, estimator="accumulation", accumulation_times=64, photons=1 << 13)
    assert np.sqrt(np.mean((rough[0] - truth) ** 2) / np.mean(truth**2)) < 0.02


def test_a_tube_above_wide_water_is_split_though_its_image_is_narrow():
    """Light of the water changes slowly beside that: seven parts blur it by little, and err far less than one."""
    lamp = LightAtShutter("/lamp", LightKind.POINT, (4.0,) * 3, np.array([0.2, 0.1, 1.2]))
    extent = Extent(ExtentShape.CYLINDER, 0.1, SPANS * [[1.0], [0.0]])
    light = replace(lamp, profile=EmissionProfile.SINE, extent=extent)
    water = bumpy("/water", WATER, 1.0, False)
    water = replace(water, points=water.points * (3.0, 3.0, 0.5))
    source = steady([floor(), water], (light,), looking_down(height=0.05))

    def light_of(**changes):
        context = RenderContext(source, Settings(samples=2, threads=1, aovs=("irradiance",), **changes))
        return render_frame(context, Shutter(0, 0, 0), 16, 16).channels["irradiance.R"].astype(np.float64)

    truth = light_of(estimator="accumulation", accumulation_times=64, photons=1 << 12)
    found, unsplit = (light_of(photons=1 << 14, light_splits=n) for n in ("auto", 1))
    errors = [np.sqrt(np.mean((one - truth) ** 2) / np.mean(truth**2)) for one in (found, unsplit)]
    assert errors[0] < 0.02 and errors[0] < 0.6 * errors[1]


def test_errors_between_the_numbers_looked_at_lie_between_theirs():
    foreseen = Foreseen(np.array([1, 7, 19]), np.array([0.3, 0.1, 0.03]), 19)
    assert foreseen.error_of(7) == pytest.approx(0.1)
    assert 0.03 < foreseen.error_of(12) < 0.1 < foreseen.error_of(3) < 0.3
    assert foreseen.error_of(1000) == pytest.approx(0.03)
    assert foreseen.is_worse(7) and not foreseen.is_worse(19)
    # Twice nothing is nothing to speak of.
    assert not Foreseen(np.array([1, 7]), np.array([0.02, 0.001]), 7).is_worse(1)


@pytest.mark.parametrize("shape", [ExtentShape.DISK, ExtentShape.RECT, ExtentShape.CYLINDER])
def test_a_cone_is_seen_from_each_place_on_its_light(shape):
    """In one part each photon stands for all of the light, of which the cone leaves some at its edge on the water."""
    shaping = Shaping(np.radians(25.0), 0.2)
    lamp = LightAtShutter("/lamp", LightKind.POINT, (4.0,) * 3, np.array([0.3, 0.2, 2.0]), shaping=shaping)
    light = replace(lamp, profile=EmissionProfile.COSINE, extent=Extent(shape, 0.0, 0.3 * np.eye(3)[:2]))
    if shape == ExtentShape.CYLINDER:
        light = replace(light, profile=EmissionProfile.SINE, extent=Extent(shape, 0.2, 0.3 * np.diag([1.0, 0, 0])[:2]))
    source = steady([floor(), bumpy("/water", WATER, 1.0, False)], (light,), looking_down(height=0.3))

    def light_of(**changes):
        context = RenderContext(source, Settings(samples=2, threads=1, aovs=("irradiance",), **changes))
        return render_frame(context, Shutter(0, 0, 0), 16, 16).channels["irradiance.R"].astype(np.float64)

    truth = light_of(estimator="accumulation", accumulation_times=64, photons=1 << 12)
    errors = [
        np.sqrt(np.mean((light_of(photons=1 << 14, light_splits=n) - truth) ** 2) / np.mean(truth**2))
        for n in (1, "auto")
    ]
    assert errors[0] > 0.1 and errors[1] < 0.04


@pytest.mark.parametrize(("height", "is_cut"), [(1.0, True), (3.0, False)])
def test_a_lamp_that_the_water_cuts_has_as_many_parts_as_have_enough_photons(height, is_cut):
    """No photon from its middle, which is under water, lands where its upper half shines."""
    lamp = LightAtShutter("/lamp", LightKind.POINT, (4.0,) * 3, np.array([0.3, 0.2, height]))
    light = replace(lamp, extent=Extent(ExtentShape.ROUND, 0.3))
    source = steady([floor(), bumpy("/water", WATER, 1.0, False)], (light,), looking_down(height=0.3))
    context = RenderContext(source, Settings(photons=1 << 14, samples=1, threads=1))
    parts = render_frame(context, Shutter(0, 0, 0), 8, 8).energy.counts.get("parts of each light with extent", 1)
    assert (parts == candidates(1 << 14)[-1]) == is_cut


def test_lights_that_share_photons_have_as_few_parts_as_leave_each_of_theirs_enough():
    """Eight panels just above the water, each of which has an eighth of the photons."""
    extent = Extent(ExtentShape.RECT, 0.0, SPANS)
    panels = [
        LightAtShutter(f"/lamp{k}", LightKind.POINT, (4.0,) * 3, np.array([0.2 * k - 0.7, 0.2, 1.4])) for k in range(8)
    ]
    lights = tuple(replace(panel, profile=EmissionProfile.COSINE, extent=extent) for panel in panels)

    def parts(*lights):
        source = steady([floor(), bumpy("/water", WATER, 1.0, False)], lights, looking_down(height=0.6))
        context = RenderContext(source, Settings(photons=1 << 14, samples=1, threads=1))
        return render_frame(context, Shutter(0, 0, 0), 8, 8).energy.counts.get("parts of each light with extent", 1)

    most = (1 << 14) // 8 // FEWEST_PHOTONS
    assert 1 < parts(*lights) <= most < parts(lights[0])


def test_glass_that_turns_the_middle_of_a_sun_back_is_lit_by_its_rim():
    """A prism reflects all that falls straight on it, and lets some of a sun 20 degrees wide through.

    Within the glass, that is light more than 45° − 41.81° off the middle, by 1.5 sin 3.19° = .083 of the sine σ = .174.
    """
    points, triangles = shapes.prism(0.8, 0.8)
    glass = Material(Interaction.DIELECTRIC, ior=1.5)
    prism = MeshAtShutter("/prism", points + np.array([0.0, 0.0, 0.6]), triangles.astype(np.int32), materials=(glass,))
    sun = replace(SUN, extent=Extent(ExtentShape.ROUND, np.radians(10.0)))
    source = steady([floor(4.0), prism], (sun,), looking_down((-2.0, 2.0, -2.0, 2.0), height=0.15))
    options = {"photons": 1 << 14, "samples": 1, "threads": 1, "aovs": ("irradiance",)}

    def light(**changes) -> np.ndarray:
        context = RenderContext(source, Settings(**{**options, **changes}))
        return render_frame(context, Shutter(0, 0, 0), 16, 16).channels["irradiance.R"].astype(np.float64)

    by_places = light(estimator="accumulation", accumulation_times=64, photons=1 << 10)
    found, unsplit = light(), light(light_splits=1)
    assert unsplit.mean() < 0.1 * by_places.mean()
    # Some 40 of the 64 places are dark, and some 20 of the parts: what lies at the edge of them is a tenth.
    assert found.mean() == pytest.approx(by_places.mean(), rel=0.15)
