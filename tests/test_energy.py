"""Where the flux goes: nothing appears, nothing disappears, and every photon keeps its name."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.photons.moving_scenes import GRID, SCENES, walls, wave
from tests.photons.shapes import DIFFUSE, MIRROR, ball, box, floor, glass, moving, quad, ripples
from tests.photons.traced import EPS, Traced, Written, lamp, scene_of, sun, traced
from tpdwarp.scene.description import Interaction, Material, MeshAtShutter, SceneAtShutter, Shutter

BALANCE = 1e-4
"""Sums of 10⁴ float32 fluxes, each rounded once at each of up to 16 interactions."""
GOLD = Material(Interaction.MIRROR, (0.9, 0.7, 0.3), path="/gold")


def room_of_mirrors(material: Material = MIRROR, sides: int = 4) -> list[MeshAtShutter]:
    """The first ``sides`` of a cube's four walls, floor and ceiling; six close it. Fronts inside."""
    middle = np.array([0.0, 0.0, 1.0])
    directions = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, -1), (0, 0, 1)]
    made = []
    for number, direction in enumerate(directions[:sides]):
        d = np.array(direction, dtype=float)
        u, v = np.roll(d, 1), np.roll(d, 2)
        made.append(quad(f"/side{number}", tuple(middle + d), tuple(-abs(u) * d.sum()), tuple(abs(v)), material))
    return made


def mixed() -> SceneAtShutter:
    plate = quad("/plate", (1.6, 0, 1.6), (0, 0.8, 0), (-0.3, 0, 1.2), GOLD)
    parts = [ripples(GRID, GRID, 2.5, 0.03, glass(1.33), True), ball("/ball", (0, 0, 1.1), 0.45, 16, glass()), plate]
    return scene_of([*parts, *walls()], sun(), lamp((0.2, 0.3, 4), intensity=2.0))


BALANCED: dict[str, Callable[[], SceneAtShutter]] = {
    "open water": lambda: wave(True),
    "closed glass": lambda: scene_of([ball("/ball", (0, 0, 1.2), 0.5, 16, glass()), *walls()], sun()),
    "a closed box of glass": lambda: scene_of(
        [box("/box", (-0.5, -0.4, 0.5), (0.5, 0.6, 1), glass()), *walls()], sun()
    ),
    "tinted mirrors": lambda: scene_of([*room_of_mirrors(GOLD), floor(half=1.0)], lamp((0.2, 0.1, 1.3))),
    "mixed, with two lights": mixed,
}


@pytest.mark.parametrize("name", BALANCED)
def test_what_is_sent_is_deposited_escapes_is_absorbed_or_is_known_to_be_lost(name):
    result = traced(BALANCED[name](), 3000)
    energy = result.energy
    assert energy.sent > 0.1
    found = energy.deposited + energy.escaped + energy.absorbed + energy.lost_total
    assert found == pytest.approx(energy.sent, rel=BALANCE)
    assert result.photons.flux.sum() == pytest.approx(energy.deposited, rel=BALANCE)
    assert energy.lost_total < 0.01 * energy.sent
    assert (energy.absorbed > 0.01 * energy.sent) == ("mirrors" in name or "mixed" in name)


def test_channels_are_tinted_by_a_mirror_each_by_itself():
    scene = scene_of([floor(0.0, 0.5, GOLD, "/mirror"), quad("/up", (0, 0, 2), (0, 1, 0), (1, 0, 0), DIFFUSE)],
                     lamp((0.0, 0.0, 1.0)))
    flux = traced(scene, 200).photons.flux
    np.testing.assert_allclose(flux, flux[:, :1] * (np.array(GOLD.color) / GOLD.color[0]), rtol=8 * EPS)


def test_what_a_cutoff_drops_is_accounted_as_lost():
    scene = BALANCED["closed glass"]()
    everything = traced(scene, 2000, smallest_branch=0.0).energy
    some = traced(scene, 2000, smallest_branch=0.05).energy
    # But for what branches off at the 32nd decision of a path.
    assert everything.lost.get("branch below cutoff", 0.0) < 1e-6 * everything.sent
    assert some.lost["branch below cutoff"] > 0.001 * some.sent
    found = some.deposited + some.escaped + some.lost_total
    assert found == pytest.approx(everything.sent, rel=BALANCE)


@pytest.mark.parametrize("tilt", [0.0, 0.6])
def test_a_distant_light_sends_its_irradiance_times_the_area_it_sees(tilt):
    light = sun((math.sin(tilt), 0, -math.cos(tilt)), irradiance=2.5)
    energy = traced(scene_of([floor(1.0, 1.5, glass(), "/water"), floor()], light), 1000).energy
    assert energy.sent == pytest.approx(3 * 2.5 * 9 * math.cos(tilt), rel=BALANCE)


def rectangle_solid_angle(a: float, b: float, distance: float) -> float:
    """Solid angle of a rectangle 2a × 2b seen from ``distance`` above its middle."""
    return 4 * math.asin(a * b / math.sqrt((a**2 + distance**2) * (b**2 + distance**2)))


def test_a_point_light_sends_its_intensity_times_the_solid_angle_it_sees():
    water = quad("/water", (0, 0, 1), (1.5, 0, 0), (0, 0.5, 0), glass())
    result = traced(scene_of([water, floor()], lamp((0, 0, 2.0), intensity=0.7)), 4000)
    step = max(result.plan.lattices[0].step)
    expected = 3 * 0.7 * rectangle_solid_angle(1.5, 0.5, 1.0)
    # The midpoint rule over cells of one step; the density's second derivative is below 4 of its own size.
    assert result.energy.sent == pytest.approx(expected, rel=4 * step**2 / 24 + BALANCE)


@pytest.mark.parametrize("sides, position", [(4, (0, 0, 1)), (6, (0, 0, 1)), (6, (0.3, -0.2, 1.4))])
def test_a_light_inside_a_room_of_mirrors_sends_all_that_goes_there(sides, position):
    result = traced(scene_of(room_of_mirrors(sides=sides), lamp(position, intensity=0.7)), 6000)
    assert len(result.plan.lattices) >= sides
    step = max(max(lattice.step) for lattice in result.plan.lattices)
    expected = 3 * 0.7 * 4 * math.pi * (sides / 6)
    assert result.energy.sent == pytest.approx(expected, rel=4 * step**2 / 24 + BALANCE)


def test_lights_add_up():
    scene = BALANCED["mixed, with two lights"]()
    both = traced(scene, 4000).energy.sent
    alone = [traced(replace(scene, lights=(light,)), 4000).energy.sent for light in scene.lights]
    # What is specular has silhouettes: a lattice counts the cells on them to a perimeter's worth of cells.
    assert both == pytest.approx(sum(alone), rel=2 / math.sqrt(4000))
    assert min(alone) > 0.1 * both


def test_a_hidden_light_sends_nothing_to_what_it_cannot_reach_first():
    lid = floor(1.5, 1.5, DIFFUSE, "/lid")
    energy = traced(scene_of([ripples(GRID, GRID, 1.0, 0.03, glass(1.33), True), lid, floor()], sun()), 500).energy
    assert energy.sent == 0 and energy.counts["landed"] == 0


# Identity.


def travelling_ball(shutter: Shutter, speed: float = 0.1) -> SceneAtShutter:
    w = np.array([speed, 0.0, 0.0])
    body = ball("/ball", tuple(w * (shutter.middle - 4) + [0, 0, 1.2]), 0.5, 8, glass())
    return scene_of([moving(body, w * shutter.exposure), floor()], sun(), shutter=shutter)


def travelling_lamp(shutter: Shutter) -> SceneAtShutter:
    w = np.array([0.04, 0.02, 0.0])
    light = lamp(w * (shutter.middle - 4) + [0, 0, 3], w * shutter.exposure)
    return replace(wave(True, light), shutter=shutter)


def travelling_water(shutter: Shutter) -> SceneAtShutter:
    scene = wave(True)
    water = scene.meshes[0]
    past = shutter.middle - 4
    water = replace(
        water,
        points=water.points + past * water.motions,
        normals=water.normals + past * water.normal_motions,
    )
    return replace(scene, meshes=(water, *scene.meshes[1:]), shutter=shutter)


TRAVELLING = {"water": travelling_water, "a ball": travelling_ball, "a lamp": travelling_lamp}


@pytest.mark.parametrize("name", TRAVELLING)
def test_a_photon_keeps_its_id_from_frame_to_frame(name):
    source = Written(TRAVELLING[name], references=range(1, 9))
    frames = [traced(source, 2000, shutter=Shutter(f, f - 0.25, f + 0.25)).photons for f in (3, 4)]
    _, here, there = np.intersect1d(frames[0].ids, frames[1].ids, return_indices=True)
    # The ball moves by a tenth of its width, and branches come and go at its rim.
    assert len(here) > 0.6 * len(frames[0])
    np.testing.assert_array_equal(frames[0].emission[here], frames[1].emission[there])
    assert np.linalg.norm(frames[0].positions[here] - frames[1].positions[there], axis=1).max() > 1e-3


@pytest.mark.parametrize("anchor, missed", [("light", 0.02), ("surface", None)])
def test_an_id_lets_motion_be_followed_into_the_next_frame(anchor, missed):
    source = Written(travelling_water, references=range(1, 9))
    now, then = (
        traced(source, 2000, anchor=anchor, shutter=Shutter(f, f - 0.5, f + 0.5)).photons for f in (4.0, 4.01)
    )
    _, here, there = np.intersect1d(now.ids, then.ids, return_indices=True)
    moved = (then.positions[there] - now.positions[here]) / 0.01
    if missed is None:
        # Under slanted light a photon that rides on the water is another one of the light's later on.
        assert np.linalg.norm(moved - now.dxdt[here], axis=1).max() > 0.01
        return
    error = np.linalg.norm(moved - now.dxdt[here], axis=1)
    # First order over 0.01 frames; a photon whose triangle changes takes the next facet's slope.
    assert np.quantile(error, 0.9) < missed * np.linalg.norm(now.dxdt[here], axis=1).max()


@pytest.mark.parametrize("name", [*SCENES, "mixed"])
def test_ids_are_unique_within_a_frame(name):
    scene = mixed() if name == "mixed" else SCENES[name]()
    ids = traced(scene, 2000).photons.ids
    assert len(np.unique(ids)) == len(ids) > 500
    assert ids.min() >= 0


@pytest.mark.parametrize("speed", [0.3, 5.0])
def test_ids_are_unique_where_something_small_moves_far_within_a_shutter(speed):
    source = Written(lambda shutter: travelling_ball(shutter, speed), references=range(1, 9))
    ids = traced(source, 500, shutter=Shutter(4, 4, 5)).photons.ids
    assert len(np.unique(ids)) == len(ids) > 100


# Threads and seeds.


def assert_identical(one: Traced, other: Traced) -> None:
    for name, values in vars(one.photons).items():
        np.testing.assert_array_equal(getattr(other.photons, name), values, err_msg=name)
    assert one.energy == other.energy


@pytest.mark.parametrize("threads", [2, 3])
def test_photons_do_not_depend_on_the_number_of_threads(threads):
    scene = mixed()
    assert_identical(traced(scene, 6000), traced(scene, 6000, threads=threads))


def test_jittered_photons_depend_on_the_seed_and_on_nothing_else():
    scene = BALANCED["closed glass"]()
    one, again, other = (
        traced(scene, 3000, jittered=True, seed=seed, threads=threads) for seed, threads in ((1, 1), (1, 3), (2, 1))
    )
    assert_identical(one, again)
    _, here, there = np.intersect1d(one.photons.ids, other.photons.ids, return_indices=True)
    assert np.abs(one.photons.emission[here] - other.photons.emission[there]).max() > 0.5
    inside = one.photons.emission % 1
    # Uniform within the cell: mean ½ within five standard errors of 1/√(12 n).
    np.testing.assert_allclose(inside.mean(axis=0), 0.5, atol=5 / math.sqrt(12 * len(np.unique(one.photons.ids)) / 4))


def test_lattice_photons_lie_in_the_middle_of_their_cells_whatever_the_seed():
    scene = BALANCED["open water"]()
    np.testing.assert_array_equal(traced(scene, 1000, seed=3).photons.emission % 1, 0.5)
