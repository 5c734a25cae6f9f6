"""Laws of whole frames: independence of threads and order, additivity, and where the energy goes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.view.scenes import SUN, WATER, bumpy, floor, looking_down, quad, rod, steady, turned, wave_source
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import Frame, render_frame, trace_frame
from tpdwarp.scene.description import Interaction, LightAtShutter, LightKind, Material, MeshAtShutter, Shutter
from tpdwarp.settings import Settings
from usd_scenes.oracle import Wave
from usd_scenes.oracle.shapes import grid_points, grid_triangles

AOVS = ("caustic", "direct", "irradiance", "Z", "N", "P", "motion", "photons")
SETTINGS = Settings(photons=2048, samples=4, threads=1, aovs=AOVS)
STILL, OPEN = Shutter(0, 0, 0), Shutter(0, 0, 1)
BELOW = looking_down(height=0.6)
GREY = Material(color=(0.6, 0.5, 0.4))


def still_scene(lights=(SUN,)):
    """Bumpy water over part of a floor, with a card beside it."""
    card = quad("/card", (-3, 1), (3, 3), 0.4)
    return steady([floor(material=GREY), bumpy("/water", WATER, 1.0, False), card], lights, BELOW)


def moving_scene():
    """Bumpy water that heaves over a moving floor."""
    return steady([floor(material=GREY, motion=(0.1, 0.0, 0.05)), bumpy("/water", WATER, 1.0, True)], (SUN,), BELOW)


def render(source, shutter=STILL, width=48, height=40, **changes) -> Frame:
    return render_frame(RenderContext(source, replace(SETTINGS, **changes)), shutter, width, height)


def assert_same_bits(a: Frame, b: Frame) -> None:
    assert a.channels.keys() == b.channels.keys()
    for name in a.channels:
        np.testing.assert_array_equal(a.channels[name], b.channels[name], err_msg=name)


@pytest.mark.parametrize("make", [still_scene, moving_scene])
def test_pixels_do_not_depend_on_the_number_of_threads(make):
    one, two, three = (render(make(), OPEN, threads=threads) for threads in (1, 2, 3))
    assert one.channels["caustic.R"].any()
    assert_same_bits(one, two)
    assert_same_bits(one, three)


def test_check_24_an_exposure_changes_nothing_where_nothing_moves():
    assert_same_bits(render(still_scene(), OPEN), render(still_scene(), STILL))


def test_all_frames_of_a_still_scene_are_the_same():
    source = still_scene()
    first = render(source, Shutter(1, 1, 1.5))
    for frame in (2, 7):
        assert_same_bits(render(source, Shutter(frame, frame, frame + 0.5)), first)


def test_segments_change_nothing_where_nothing_moves():
    assert_same_bits(render(still_scene(), OPEN, segments=3), render(still_scene(), OPEN))


@pytest.mark.parametrize("settings", [{}, {"segments": 2}, {"emission": "jittered"}])
def test_a_frame_is_the_same_alone_and_within_a_sequence_in_any_order(settings):
    shutters = {f: Shutter(f, f, f + 1) for f in (0, 1, 2)}
    alone = render(moving_scene(), shutters[1], **settings)
    source = moving_scene()
    forward = {f: render(source, shutters[f], **settings) for f in (0, 1, 2)}
    backward = {f: render(source, shutters[f], **settings) for f in (2, 1, 0)}
    assert_same_bits(forward[1], alone)
    for f in shutters:
        assert_same_bits(forward[f], backward[f])
    assert np.abs(forward[0].channels["R"] - forward[1].channels["R"]).max() > 0


def test_frames_of_trees_that_were_kept_are_those_of_their_own(monkeypatch):
    shutters = [Shutter(f, f, f + 1) for f in (0, 1, 2)]
    still = quad("/card", (-3, 1), (3, 3), 0.4)

    def scene():
        return steady([floor(material=GREY), bumpy("/water", WATER, 1.0, True), still], (SUN,), BELOW)

    expected = [render(scene(), shutter) for shutter in shutters]
    monkeypatch.setattr("tpdwarp.scene.device.geometry.SHARED_FROM", 1)
    monkeypatch.setattr("tpdwarp.scene.device.wide_tree.FOLLOWED_IN_PARTS", 1)
    for order in (1, -1):
        context = RenderContext(scene(), SETTINGS)
        for shutter, of in list(zip(shutters, expected, strict=True))[::order]:
            assert_same_bits(render_frame(context, shutter, 48, 40), of)


def test_photons_are_the_same_traced_alone_and_rendered():
    traced, rendered = trace_frame(RenderContext(moving_scene(), SETTINGS), OPEN), render(moving_scene(), OPEN)
    for name in ("ids", "positions", "dxdu", "dxdt", "flux"):
        np.testing.assert_array_equal(getattr(traced.photons, name), getattr(rendered.photons, name), err_msg=name)
    assert traced.energy.as_dict().items() >= {"sent": rendered.energy.sent}.items()


def test_light_is_linear_in_power():
    plain, bright = render(still_scene()), render(still_scene([replace(SUN, power=(4.0, 8.0, 2.0))]))
    for group in ("caustic", "direct", "irradiance"):
        for channel, factor in zip("RGB", (4, 8, 2), strict=True):
            name = f"{group}.{channel}"
            # A power of two scales every float exactly.
            np.testing.assert_array_equal(bright.channels[name], factor * plain.channels[name])


def tilted(angle: float, path: str, power) -> LightAtShutter:
    return LightAtShutter(path, LightKind.DISTANT, power, axes=turned((0, angle, 1e-12)))


def test_light_of_several_lights_adds_up(monkeypatch):
    # Cells alike wherever the camera looks, or lights alone would have others.
    monkeypatch.setattr(RenderContext, "_seen_light", lambda *_: None)
    left, right = tilted(0.2, "/left", (1.0, 0.5, 0.25)), tilted(-0.2, "/right", (0.25, 0.5, 1.0))
    water = quad("/water", (-2, -2), (2, 2), 1.0, WATER)
    card = quad("/card", (-0.2, -0.2), (0.2, 0.2), 0.3)

    def lit(*lights, photons):
        return render(steady([floor(), water, card], lights, BELOW), photons=photons)

    # Mirror images of each other, and of equal power: each takes half of the photons.
    a, b, both = lit(left, photons=1024), lit(right, photons=1024), lit(left, right, photons=2048)
    assert both.energy.counts["emitted"] == a.energy.counts["emitted"] + b.energy.counts["emitted"]
    for name in ("R", "G", "B", "irradiance.R", "irradiance.B"):
        total = a.channels[name].astype(float) + b.channels[name]
        np.testing.assert_allclose(both.channels[name], total, rtol=1e-5, atol=1e-6, err_msg=name)


def sphere(radius: float, centre, rings: int = 48, sides: int = 96) -> MeshAtShutter:
    """A closed glass sphere with smooth normals."""
    latitude, longitude = np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, sides + 1)
    around, down, _ = grid_points(longitude, latitude, lambda x, y: 0 * x).T
    outward = np.stack([np.sin(down) * np.cos(around), np.sin(down) * np.sin(around), np.cos(down)], axis=1)
    triangles = grid_triangles(sides + 1, rings + 1)[:, ::-1]
    corners = outward[triangles]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    triangles = np.ascontiguousarray(triangles[area > 1e-9]).astype(np.int32)
    glass = Material(Interaction.DIELECTRIC, ior=1.5)
    return MeshAtShutter(
        "/glass", radius * outward + centre, triangles, normals=outward, normal_indices=triangles, materials=(glass,)
    )


def cylinder(centre) -> MeshAtShutter:
    """A closed glass cylinder that lies on its side, askew."""
    points, triangles, normals, indices = rod(0.25, 1.2, 128)
    turn = turned((0, 0, 0.4))
    return MeshAtShutter(
        "/glass", points @ turn + centre, triangles, normals=normals @ turn, normal_indices=indices,
        materials=(Material(Interaction.DIELECTRIC, ior=1.5),),
    )  # fmt: skip


def gathered_flux(frame: Frame, area: float) -> float:
    """Flux on everything that the camera saw, W, summed over channels."""
    pixels = area / frame.channels["A"].size
    return sum(frame.channels[f"irradiance.{c}"].sum(dtype=float) for c in "RGB") * pixels


@pytest.mark.parametrize("segments", [1, 2])
def test_the_light_sent_through_a_wave_arrives_is_lost_or_escapes(segments):
    half = 3.0
    source = wave_source(Wave(), camera=looking_down((-half, half, -half, half), height=0.9))
    frame = render(source, OPEN, 160, 160, photons=4096, segments=segments, samples=1)
    account = frame.energy
    assert account.sent == pytest.approx(account.deposited + account.escaped + account.absorbed + account.lost_total)
    found = gathered_flux(frame, 4 * half**2) + account.escaped + account.absorbed + account.lost_total
    assert account.sent == pytest.approx(3 * 16.0, rel=1e-6)
    assert found == pytest.approx(account.sent, rel=0.005)


@pytest.mark.parametrize("shape", ["sphere", "rod"])
def test_the_light_sent_through_a_glass_solid_arrives_is_lost_or_escapes(shape):
    solid, half = {"sphere": lambda: sphere(0.4, (0, 0, 1.0)), "rod": lambda: cylinder((0, 0, 1.0))}[shape], 4.0
    camera = looking_down((-half, half, -half, half), height=0.5)
    frame = render(steady([floor(half), solid()], (SUN,), camera), STILL, 200, 200, photons=4096, samples=1)
    account = frame.energy
    assert account.sent == pytest.approx(account.deposited + account.escaped + account.absorbed + account.lost_total)
    assert account.deposited > 0.85 * account.sent
    found = gathered_flux(frame, 4 * half**2) + account.escaped + account.absorbed + account.lost_total
    assert found == pytest.approx(account.sent, rel=0.005)


def test_tinted_mirrors_absorb_what_they_do_not_reflect():
    mirror = quad("/mirror", (-1, -1), (1, 1), 0.5, Material(Interaction.MIRROR, color=(0.75, 0.5, 0.25)))
    roof = quad("/roof", (-3, -3), (3, 3), 2.0, up=False)
    lamp = LightAtShutter("/bulb", LightKind.POINT, (1.0, 1.0, 1.0), position=np.array([0.0, 0.0, 1.5]))
    camera = replace(looking_down((-3, 3, -3, 3)), position=np.array([0, 0, 1.0]), axes=np.diag([1.0, -1.0, -1.0]))
    frame = render(steady([mirror, roof, floor()], (lamp,), camera), STILL, 160, 160, samples=1)
    account = frame.energy
    # Tints keep half of the light, summed over channels.
    assert account.absorbed == pytest.approx(0.5 * account.sent, rel=1e-4)
    red, green, blue = (frame.channels[f"irradiance.{c}"].sum(dtype=float) for c in "RGB")
    assert (green / red, blue / red) == (pytest.approx(2 / 3, rel=1e-4), pytest.approx(1 / 3, rel=1e-4))
    found = gathered_flux(frame, 36) + account.escaped + account.absorbed + account.lost_total
    assert found == pytest.approx(account.sent, rel=0.005)


def counts(source, shutter=STILL, **changes) -> dict[str, int]:
    return render(source, shutter, width=8, height=8, **changes).energy.counts


def test_branches_of_the_view_and_of_photons_are_followed_down_to_their_cutoffs_and_counted():
    """Water reflects a fiftieth of what falls on it vertically."""
    roof = quad("/roof", (-3, -3), (3, 3), 2.5, up=False)
    source = steady([floor(), quad("/water", (-3, -3), (3, 3), 1.0, WATER), roof], (), looking_down(height=2.0))
    name = "view branches below cutoff"
    assert name not in counts(source, samples=1, view_cutoff=0.01)
    assert counts(source, samples=1, view_cutoff=0.03)[name] == 64
    lit = steady([floor(), quad("/water", (-3, -3), (3, 3), 1.0, WATER)], (SUN,), BELOW)
    followed, given_up = (
        trace_frame(RenderContext(lit, replace(SETTINGS, branch_cutoff=cutoff)), STILL) for cutoff in (0.01, 0.03)
    )
    assert not followed.energy.lost
    assert given_up.energy.lost_total == pytest.approx(followed.energy.escaped, rel=1e-5)


def test_views_that_race_over_what_they_see_are_slowed_down_and_counted():
    name = "views slowed down"
    for way, found in ((1.0, 0), (4.0, 64)):
        camera = looking_down(height=0.6, position_motion=np.array([way, 0.0, 0.0]))
        source = steady([floor(), quad("/water", (-3, -3), (3, 3), 1.0, WATER)], (SUN,), camera)
        assert counts(source, OPEN, samples=1).get(name, 0) == found
