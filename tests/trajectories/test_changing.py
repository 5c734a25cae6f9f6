"""Laws of light that begins or ends within the shutter."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.estimators.frames import OPEN, STILL_SCENE, irradiance
from tests.photons.shapes import MIRROR, ball, box, floor, glass, mesh, moving
from tests.photons.traced import lamp, sun
from tests.trajectories.test_fit import root_mean_square
from tests.view.scenes import Source, looking_down, quad, steady, wave_source
from tpdwarp.clock import Clock
from tpdwarp.photons.path_tags import PathTags, facets_of
from tpdwarp.photons.record import PART_IDS
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import Frame, render_frame, trace_frame
from tpdwarp.scene.description import MeshAtShutter, SceneAtShutter, Shaping, Shutter
from tpdwarp.settings import Settings
from tpdwarp.trajectories.changing import changing_cells
from tpdwarp.trajectories.edges import FINER, FIRST_PART, edge_cells
from tpdwarp.trajectories.keyframes import ShutterKeyframes
from tpdwarp.trajectories.parts import INSTANTS
from tpdwarp.trajectories.retraced import PARTS, place_in_cell
from tpdwarp.usd.read.stage import StageScene
from usd_scenes.in_memory import turned
from usd_scenes.oracle import Wave
from usd_scenes.oracle.closed_forms import fresnel_reflectance, lit_edge_profile, snell
from usd_scenes.shapes import ring, rotation
from usd_scenes.stage import CAMERA, FRAME
from usd_scenes.strangers import PIXELS, write

CONVERGED = Path(__file__).resolve().parents[2] / "scripts" / "benchmarks" / "converged"
RETRACED = "cells traced again in time"
SETTINGS = Settings(photons=4096, segments=1, samples=1, aovs=("irradiance",))
GLIDE = 0.6
WATER = quad("/water", (-2, -2), (2, 2), 1.0, glass(1.33))


def shaded_water(motion: float = GLIDE) -> Source:
    """Flat water under a sun, and a board above it that covers x > 0 at mid shutter and glides along x."""
    board = quad("/board", (0, -3), (6, 3), 2.0, motion=(motion, 0, 0))
    return steady([floor(), WATER, board], (sun(),), looking_down((-1, 1, -0.125, 0.125), height=0.5))


def rendered(source: Source, columns: int = 128, **changes) -> Frame:
    return render_frame(RenderContext(source, Settings.of(SETTINGS, **changes)), OPEN, columns, 16)


def changing(source: Source, photons: int = 4096):
    context, clock = RenderContext(source, Settings.of(SETTINGS, photons=photons)), Clock()
    tracer = context.tracer
    plan, loaded = tracer.plan(photons), tracer.load(OPEN)
    keyframes = ShutterKeyframes.over(tracer, plan, loaded, clock)
    photons, _ = tracer.trace(loaded, plan, clock, tags=keyframes.tags.of(loaded.scene))
    moving, _ = edge_cells(photons, plan, loaded)
    states = keyframes.states(photons, plan)
    return changing_cells(keyframes, photons, plan, states, clock, moving)


@pytest.mark.parametrize("photons", [4096, 16384])
def test_the_edge_of_a_gliding_board_smears_light_into_a_ramp(photons):
    found = irradiance(rendered(shaded_water(), photons=photons))
    x = (np.arange(128) + 0.5) / 64 - 1
    passed = 1 - fresnel_reflectance(0.0, 1.0, 1.33)
    exact = passed * lit_edge_profile(x, GLIDE)
    # Each cell knows within which eighth of the shutter it is covered: a mean square of 1/8²/12 where the ramp is, 0.3
    # of the image.
    step = passed / PARTS / 12**0.5 * (GLIDE / 2) ** 0.5
    assert np.sqrt(np.mean((found - exact) ** 2)) < step
    # Light in the middle of the ramp is light for half of the shutter.
    assert found[:, 62:66].mean() == pytest.approx(passed / 2, abs=passed / PARTS / 2)


def test_the_board_takes_away_as_much_light_as_it_covers_on_average():
    moving_board, still = (trace_frame(RenderContext(shaded_water(m), SETTINGS), OPEN) for m in (GLIDE, 0.0))
    energy = moving_board.energy
    assert energy.counts[RETRACED] > 0
    # The edge passes the same places to either side of the middle: half of the water is lit, to a row of cells.
    assert energy.sent == pytest.approx(still.energy.sent, rel=2 / 64)
    assert energy.deposited + energy.escaped + energy.lost_total == pytest.approx(energy.sent, rel=1e-6)


@pytest.mark.parametrize(
    ("half", "middle", "width"), [(1.0, 0.0, 0.08), (1.0, 0.0, 0.12), (1.0, 0.0, 0.16), (0.06, 0.14, 0.08)]
)
def test_a_stick_takes_light_wherever_it_passes_between_keyframes(half, middle, width):
    """It is narrower than its way from one keyframe to the next; past the narrow water it comes and goes in between."""
    way = 0.6
    stick = quad("/stick", (middle - width / 2, -3), (middle + width / 2, 3), 2.0, motion=(way, 0, 0))
    water = quad("/water", (-half, -2), (half, 2), 1.0, glass(1.33))
    source = steady([floor(), water, stick], (sun(),), looking_down((-1, 1, -0.125, 0.125), height=0.5))
    frame = rendered(source, photons=16384)
    x = (np.arange(128) + 0.5) / 64 - 1
    ends = [np.clip((x - middle + side * width / 2) / way, -0.5, 0.5) for side in (-1, 1)]
    exact = (1 - fresnel_reflectance(0.0, 1.0, 1.33)) * (1 - (ends[1] - ends[0]))
    found, inside = irradiance(frame).mean(axis=0), np.abs(x) < half - 0.02
    # Where only keyframes show it the most is .13: it shadows nothing between them, and what it shadows then too long.
    # Where one of its edges is taken for the other, the root mean square is .008 to .009.
    assert np.abs(found - exact)[inside].max() < 0.035
    assert root_mean_square((found - exact)[inside]) < 0.0065
    assert found[inside].mean() == pytest.approx(exact[inside].mean(), rel=0.0025)


@pytest.mark.parametrize("place", [0.0, 0.3, 0.45, 0.8])
def test_an_edge_along_the_motion_takes_part_of_a_cell_wherever_it_lies(place):
    """It is at the same place at all times, so that no keyframe sees it change."""
    cell = 4 / 64
    board = quad("/board", (place * cell, -9), (6, 9), 2.0, motion=(0, GLIDE, 0))
    traced = trace_frame(RenderContext(steady([floor(), WATER, board], (sun(),)), SETTINGS), OPEN)
    lit = traced.energy.sent / (3 * 4)  # the width of water in the light
    # Eight places or nine in each cell, of which the edge divides those it goes through alike up to half a place;
    # photons in the middle of their cells would be wrong by up to half a cell.
    assert lit == pytest.approx(2 + place * cell, abs=cell / PARTS / 2)


def test_a_side_that_shows_in_less_than_the_last_of_the_cells_is_lit():
    """The side of a slab that the sun just sees reflects to the floor what Fresnel says, with few photons, too."""
    theta, thick = 0.05, 0.3
    slab = moving(box("/slab", (-1, -1, 1.0), (1, 1, 1.0 + thick), glass()), (0.0, 0.1, 0.0))
    source = steady([floor(), slab], (sun((math.sin(theta), 0, -math.cos(theta))),))
    photons = trace_frame(RenderContext(source, Settings.of(SETTINGS, photons=1024)), OPEN).photons
    seen, step = thick * math.sin(theta), (2.0 * math.cos(theta) + thick * math.sin(theta)) / 32
    assert seen < 0.3 * step
    reflected = fresnel_reflectance(0.5 * math.pi - theta, 1.0, 1.5)
    # Each cell is looked at in eight places across, on both sides of each face.
    found = photons.flux[(photons.bounces == 1) & (photons.normals[:, 2] > 0), 0].sum()
    assert found == pytest.approx(2.0 * seen * reflected, abs=2.0 * step / PARTS)


def test_places_in_a_cell_are_spread_evenly_over_time_and_along_both_of_its_sides():
    cells = np.stack(np.meshgrid(np.arange(-40, 40), np.arange(40)), axis=-1).reshape(-1, 2)
    places = np.stack([place_in_cell(cells, number) for number in range(PARTS)])
    steps = ((places + 0.5) * PARTS).astype(int)
    np.testing.assert_array_equal(np.sort(steps, axis=0), np.tile(np.arange(PARTS)[:, None, None], (len(cells), 2)))
    # In time and along u: one place in each box of two parts by a quarter of the cell, and of four by a half.
    for parts in (2, 4):
        boxes = np.sort(steps[:, :, 0].reshape(PARTS // parts, parts, -1) // (PARTS // parts), axis=1)
        np.testing.assert_array_equal(boxes, np.broadcast_to(np.arange(parts)[None, :, None], boxes.shape))
    # Cells differ.
    assert abs(np.corrcoef(places[0, :-1, 0], places[0, 1:, 0])[0, 1]) < 0.1


def test_each_photon_has_an_id_of_its_own_and_the_others_keep_theirs():
    whole = trace_frame(RenderContext(shaded_water(0.0), SETTINGS), OPEN).photons
    found = trace_frame(RenderContext(shaded_water(), SETTINGS), OPEN).photons
    assert len(np.unique(found.ids)) == len(found)
    parts = found.ids // PART_IDS
    # Those of the shutter, and those of cells where the water ends at rest.
    assert set(parts) == {*range(INSTANTS + 1), *range(FIRST_PART, FIRST_PART + FINER**2)}
    assert np.isin(found.ids[parts == 0], whole.ids).all()
    # Where a board glides on, cells are covered or uncovered for good: in later parts are fewer or more of the same.
    first, last = (set(found.ids[parts == part] % PART_IDS) for part in (1, INSTANTS))
    assert first < last or last < first


def test_parts_of_the_shutter_share_the_flux_and_carry_displacements_of_the_whole():
    source = steady(
        [floor(), moving(WATER, (0, 0, 0.2)), quad("/board", (0, -3), (6, 3), 2.0, motion=(GLIDE, 0, 0))],
        (sun((0.5, 0, -1)),),
    )
    photons = trace_frame(RenderContext(source, SETTINGS), OPEN).photons
    of_part, whole_part = photons.ids >= PART_IDS, (photons.ids >= 2 * PART_IDS) & (photons.ids < INSTANTS * PART_IDS)
    # But for those that the board covers or uncovers between two parts: they are not there in one of those beside.
    part, cell = np.divmod(photons.ids, PART_IDS)
    there = set(zip(part.tolist(), cell.tolist(), strict=True))
    below = photons.receivers == photons.receiver_paths.index("/floor")
    beside = [{(p - 1, c), (p + 1, c)} <= there for p, c in zip(part.tolist(), cell.tolist(), strict=True)]
    lasts = whole_part & below & np.array(beside)
    assert lasts.sum() > 100
    np.testing.assert_allclose(photons.flux[lasts] * PARTS, photons.flux[~of_part].max(), rtol=1e-5)
    # Water that rises by w shifts the light below each of its points by w tan θ_t, of which rounding leaves 1e-4.
    theta = snell(np.arctan(0.5), 1.0, 1.33)
    for rows in (below & of_part, below & ~of_part):
        np.testing.assert_allclose(photons.dxdt[rows], [[0.2 * np.tan(theta), 0, 0]] * rows.sum(), atol=1e-4)


def gliding_ball(way=(0.4, 0.1, 0.0)) -> Source:
    body = ball("/ball", (0, 0, 1.2), 0.5, 24, glass())
    return steady([floor(), replace(moving(body, way), normal_motions=np.zeros_like(body.normals))], (sun(),))


def turning_box(angle: float) -> Source:
    body = box("/box", (-0.4, -0.4, 0.6), (0.4, 0.4, 1.4), glass())

    def at(shutter: Shutter):
        c, s = np.cos(angle * shutter.middle + 0.4), np.sin(angle * shutter.middle + 0.4)
        axis = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        points = (body.points - (0, 0, 1)) @ axis.T + (0, 0, 1)
        spin = np.cross((0, -angle * shutter.exposure, 0), points - (0, 0, 1))
        placed = replace(body, points=points, motions=spin if shutter.exposure else None)
        return replace(steady([floor(), placed], (sun(),)).scene(Shutter(0, 0.5, 0.5)), shutter=shutter)

    return Source(at)


@pytest.mark.parametrize(
    "source", [wave_source(Wave()), wave_source(Wave(wavelength=0.65, speed=0.65 / 8)), gliding_ball(), STILL_SCENE]
)
def test_waves_and_bodies_that_glide_with_their_light_are_traced_once(source):
    assert changing(source) is None


def test_light_that_leaves_by_another_facet_is_traced_again():
    cells = changing(turning_box(0.1))
    assert cells is not None and 0 < len(cells) < 2048


@pytest.mark.parametrize("height", [0.5, 0.7])
def test_what_two_faces_of_the_cube_meet_in_shines_once(height):
    """A lamp goes round a ring of mirrors, which several faces of its directions see."""
    points, triangles, normals = ring(0.5, 0.3, 96)
    tube = mesh("/ring", points, triangles, MIRROR, normals=normals)
    source = steady([floor(), tube], (lamp((0.3, 0.1, height), motion=(-0.1, 0.3, 0.0)),))
    traced = trace_frame(RenderContext(source, SETTINGS), OPEN)
    assert len(np.unique(traced.photons.ids)) > 1000 and traced.energy.counts[RETRACED] > 0
    assert traced.photons.flux.sum(dtype=np.float64) == pytest.approx(traced.energy.deposited, rel=1e-5)


def test_facets_are_planes_and_smooth_surfaces_have_none():
    cube = box("/box", (-1, -1, -1), (1, 1, 1), glass())
    assert len(np.unique(facets_of(cube, 0.01))) == 6 and facets_of(cube, 0.01).min() == 1
    assert not facets_of(ball("/ball", (0, 0, 0), 1.0, 8, glass()), 0.0).any()
    # A ball of 384 facets has none that are worth it, if a hundredth of it has to be one.
    assert not facets_of(ball("/ball", (0, 0, 0), 1.0, 8, glass(), smooth=False), 0.01).any()


def test_tags_tell_meshes_apart_by_their_path_whatever_their_number():
    def meshes(*paths: str) -> list[MeshAtShutter]:
        # Not at one place: a surface that is written twice is one.
        return [replace(WATER, path=path, points=WATER.points + (path == "/b")) for path in paths]

    def scene(*paths: str):
        return steady(meshes(*paths)).at(OPEN)

    tags = PathTags(scene("/a", "/b"), 4096)
    both, other = tags.of(scene("/a", "/b")), tags.of(scene("/b"))
    np.testing.assert_array_equal(both[2:], other)
    assert both[0] != both[2]


def turning_mirror(first: float, last: float, width: float = 0.2) -> Source:
    """A strip of mirror along y at height 1 whose normal turns from ``first`` to ``last`` [rad] off straight up."""

    def at(shutter: Shutter):
        angle, spin = first + (last - first) * shutter.middle, (last - first) * shutter.exposure
        across, normal = np.array([np.cos(angle), 0, -np.sin(angle)]), np.array([np.sin(angle), 0, np.cos(angle)])
        places = np.array([(-0.5, -2), (0.5, -2), (0.5, 2), (-0.5, 2)]) * (width, 1)
        points = places[:, :1] * across + places[:, 1:] * (0, 1, 0) + (0, 0, 1)
        moves = {"motions": -spin * places[:, :1] * normal} if spin else {}
        strip = mesh("/mirror", points, np.array([[0, 1, 2], [0, 2, 3]]), MIRROR, **moves)
        camera = looking_down((0, 3, -0.125, 0.125), height=0.5)
        return SceneAtShutter(shutter, (floor(), strip), (sun(),), camera)

    return Source(at)


def light_of_turning_mirror(first: float, last: float, width: float, columns: int) -> np.ndarray:
    """What :func:`turning_mirror` of unit length sends to each of the columns from 0 to 3, shape [columns]."""
    angle = first + (last - first) * (np.arange(4000)[:, None] + 0.5) / 4000
    place = width * ((np.arange(200) + 0.5) / 200 - 0.5)
    x, z = place * np.cos(angle), 1 - place * np.sin(angle)
    # Light straight down leaves at twice the angle off straight up.
    lands = np.where(2 * angle > 0.5 * np.pi, x - z * np.tan(2 * angle), -1.0)
    flux = np.broadcast_to(width * np.cos(angle) / angle.size / place.size, lands.shape)
    return np.histogram(lands, columns, (0, 3), weights=flux)[0] * columns / 3


# The first time light is on the floor all the time, the second time not before half of the shutter is over.
@pytest.mark.parametrize(("first", "last"), [(55, 85), (42, 60)])
def test_light_that_no_curve_of_third_order_follows_is_where_a_turning_mirror_sends_it(first, last):
    first, last, width, columns = math.radians(first), math.radians(last), 0.6, 96
    source = turning_mirror(first, last, width)
    exact = light_of_turning_mirror(first, last, width, columns)
    found, straight = (irradiance(rendered(source, columns, path=path)).mean(axis=0) for path in ("curved", "straight"))
    errors = [float(np.sqrt(np.mean((light - exact) ** 2)) / exact.mean()) for light in (found, straight)]
    # The spot is brighter than its mean by a factor of two, and passes an edge of a pixel within a sixteenth of the
    # shutter or more slowly; from eighth to eighth D_t x changes by a third, of which a curve of second order leaves
    # a 24th.
    assert errors[0] < 0.08 < 0.3 < errors[1]


@pytest.mark.parametrize(("first", "last"), [(58, 75), (60, 85), (56, 70)])
def test_light_that_curves_of_third_order_hardly_follow_is_traced_in_parts(first, last):
    first, last, width, columns = math.radians(first), math.radians(last), 0.6, 96
    exact = light_of_turning_mirror(first, last, width, columns)
    frame = rendered(turning_mirror(first, last, width), columns)
    error = np.sqrt(np.mean((irradiance(frame).mean(axis=0) - exact) ** 2))
    # .02 to .04; on curves that keyframes agree with within .25 it is .06 to .13.
    assert error < 0.05 * exact.mean()
    assert frame.energy.counts[RETRACED] > 1000


@pytest.mark.parametrize(("tilt", "segments"), [(88.0, 1), (90.0, 1), (90.0, 2)])
def test_a_mirror_that_turns_over_sends_each_way_what_it_catches(tilt, segments):
    """A thin mirror turns by 20 degrees about an axis through its middle, past the light that it lies along."""
    height, half, turn, columns = 0.8, 0.3, math.radians(20.0), 48

    def sides(s: np.ndarray) -> np.ndarray:
        """Its side across the axis at the parts ``s`` of the shutter, shape [n, 2] by x and z: vertices go straight."""
        angle = math.radians(tilt)
        along, across = np.array([math.cos(angle), -math.sin(angle)]), np.array([-math.sin(angle), -math.cos(angle)])
        return along + turn * s[:, None] * across

    upright = quad("/mirror", (-half, -half), (half, half), 0.0, MIRROR)
    places = upright.points[:, :1] * np.insert(sides(np.zeros(1)), 1, 0.0, axis=1) + upright.points[:, 1:2] * [0, 1, 0]
    motions = upright.points[:, :1] * np.insert(sides(np.ones(1)) - sides(np.zeros(1)), 1, 0.0, axis=1)
    mirror = replace(upright, points=places + np.array([0, 0, height]), motions=motions)
    source = steady([floor(), mirror], (sun(),), looking_down((-0.5, 0.5, -0.25, 0.25), height=0.1))
    # Strips of the mirror at many times: downward light turns by twice the slope of the mirror.
    r = half * ((np.arange(400) + 0.5) / 200 - 1)
    x, z = sides((np.arange(800) + 0.5) / 800 - 0.5).T
    lands = r * x[:, None] + (height + r * z[:, None]) * np.tan(2.0 * np.arctan2(x, -z))[:, None]
    caught = np.broadcast_to(np.abs(x)[:, None], lands.shape) * (r[1] - r[0]) / 800
    exact = np.histogram(lands, bins=columns, range=(-0.5, 0.5), weights=caught)[0] * columns
    found = irradiance(rendered(source, columns, photons=16384, segments=segments)).mean(axis=0)
    assert found.mean() == pytest.approx(exact.mean(), rel=5e-3)
    # As it rides, light is twice as bright on one side, and half as bright on the other; with D_t x as it rides in what
    # is traced at rest there are stripes.
    assert np.sqrt(np.mean((found - exact) ** 2)) < 0.02 * exact.mean()


def test_light_that_a_roof_hides_at_mid_shutter_is_there_when_it_is_not():
    """A pane slides out of a beam between two roofs: what of it is lit as the shutter opens is hidden in its middle."""
    columns, half, way = 64, 0.3125, 0.4
    roofs = [quad("/left", (-3, -3), (-half, 3), 1.5), quad("/right", (half, -3), (3, 3), 1.5)]

    def light(meshes) -> np.ndarray:
        source = steady([floor(), *meshes], (sun(),), looking_down((-1, 1, -0.125, 0.125), height=0.3))
        settings = Settings(photons=16384, segments=1, samples=1, aovs=("irradiance",))
        return irradiance(render_frame(RenderContext(source, settings), OPEN, columns, 8)).mean(axis=0)

    passed = np.median(light([box("/pane", (-2, -2, 0.7), (2, 2, 0.72), glass())]))
    found = light([*roofs, moving(box("/pane", (0, -2, 0.7), (1.2, 2, 0.72), glass()), (way, 0, 0))])
    x = (np.arange(columns) + 0.5) / (columns / 2) - 1
    exact = passed * np.clip(0.5 + x / way, 0, 1) * (np.abs(x) < half)
    inside = np.abs(np.abs(x) - half) > 2.0 / columns
    assert found.mean() == pytest.approx(exact.mean(), rel=0.01)
    assert np.abs(found - exact)[inside].max() < 0.06 * passed


def of_stranger(name: str, folder: Path, photons: int = 16384) -> tuple[np.ndarray, np.ndarray]:
    """Irradiance of a scene of ``usd_scenes/strangers.py`` in one segment, and its truth."""
    with np.load(CONVERGED / f"{name}.npz") as kept:
        truth = kept["light"].astype(np.float64)
    settings = Settings.of(SETTINGS, photons=photons, samples=4, camera=CAMERA, image_width=PIXELS)
    context = RenderContext(StageScene.open(write(name, folder), settings), settings)
    found = render_frame(context, Shutter(FRAME, FRAME, FRAME + 1), PIXELS, PIXELS).channels["irradiance.R"]
    return found, truth


def test_wide_light_beside_a_focus_finer_than_pixels_passes_slats_when_it_does(tmp_path):
    """Beside such a focus wide light counted for nothing, and shone on slats and floor as at mid shutter for all of it.
    Slats are narrower than cells: .946 of the light of brute force, and an error of 1.07, where footprints end at them.
    """
    found, truth = of_stranger("lens-over-louvres", tmp_path)
    assert found.mean() == pytest.approx(truth.mean(), rel=0.005)
    assert np.sqrt(np.mean((found - truth) ** 2)) < 0.35 * truth.mean()


@pytest.mark.parametrize(("name", "wanted"), [("lens-over-stairs", 0.04), ("hollow-lens-over-stairs", 0.065)])
def test_light_that_passes_over_steps_is_whole(name, wanted, tmp_path):
    """.116 and .113, with .992 and .972 of the light, where footprints spill over the edges of steps."""
    found, truth = of_stranger(name, tmp_path)
    assert found.mean() == pytest.approx(truth.mean(), rel=0.004)
    assert np.sqrt(np.mean((found - truth) ** 2)) < wanted * truth.mean()


def test_light_that_passes_pickets_between_two_keyframes_shines_on_them(tmp_path):
    """It crosses a picket in a sixth of the shutter, beside which it falls at all keyframes: .109 of the mean."""
    found, truth = of_stranger("rod-over-a-fence", tmp_path)
    assert np.sqrt(np.mean((found - truth) ** 2)) < 0.05 * truth.mean()


@pytest.mark.parametrize(("name", "wanted"), [("stick-over-a-bowl", 0.05), ("mirror-beside-a-dome", 0.1)])
def test_light_that_is_covered_or_leaves_between_keyframes_is_as_much_as_there_is(name, wanted, tmp_path):
    """.305 with 1.082 of the light where a stick shadows what it does at keyframes alone; .124 with .983 of it where
    cells of a mirror ride as those beside them, whose light falls on nothing in the middle of the shutter."""
    found, truth = of_stranger(name, tmp_path)
    assert found.mean() == pytest.approx(truth.mean(), rel=0.012)
    assert np.sqrt(np.mean((found - truth) ** 2)) < wanted * truth.mean()


def test_a_soft_cone_that_turns_away_takes_with_it_what_it_lit():
    """Its rim passes over a pane faster than sparse keyframes tell by how much the light bends there."""
    pane = quad("/pane", (-0.5, -0.5), (0.5, 0.5), 1.0, glass(1.33))

    def at(shutter: Shutter) -> SceneAtShutter:
        x, y, z = turned((0.0, 0.1 + 0.8 * shutter.middle, 0.0)).T
        motion = 0.8 * shutter.exposure * np.stack([-z, 0.0 * y, x])
        spot = replace(lamp((0.0, 0.0, 3.0)), shaping=Shaping(0.4, 0.5), axes=np.stack([x, y, z]), axes_motion=motion)
        return SceneAtShutter(shutter, (floor(), pane), (spot,), looking_down(height=0.5))

    context = RenderContext(Source(at), Settings.of(SETTINGS, photons=1 << 14, segments=4))
    times = (np.arange(24) + 0.5) / 24
    truth = np.mean([trace_frame(context, Shutter.still(time)).energy.deposited for time in times])
    found = trace_frame(context, OPEN).energy
    assert found.counts[RETRACED] > 0
    assert found.deposited == pytest.approx(truth, rel=0.005)


@pytest.mark.parametrize(
    "angle",
    [lambda s: 0.25 - 0.2 * s, lambda s: 0.05 + 0.2 * (1 - abs(2 * s - 1)), lambda s: 0.05 + 0.2 * abs(2 * s - 1)],
    ids=["closes", "opens and closes", "closes and opens"],
)
def test_a_cone_that_changes_within_the_shutter_sends_what_it_does_at_each_time(angle):
    """Nothing moves but its rim. Of a cone as it is at mid shutter, and of a lattice laid out for the shutter's ends,
    too much or too little would land."""
    pane = quad("/pane", (-0.5, -0.5), (0.5, 0.5), 1.0, glass(1.33))

    def at(shutter: Shutter) -> SceneAtShutter:
        shaping = Shaping(angle(shutter.middle), 0.3, widest=0.25)
        spot = replace(lamp((0.0, 0.0, 3.0)), shaping=shaping, reshaped=shutter.exposure > 0.0)
        return SceneAtShutter(shutter, (floor(), pane), (spot,), looking_down(height=0.5))

    context = RenderContext(Source(at), Settings.of(SETTINGS, photons=1 << 14, segments=1))
    times = (np.arange(24) + 0.5) / 24
    truth = np.mean([trace_frame(context, Shutter.still(time)).energy.deposited for time in times])
    assert abs(trace_frame(context, Shutter.still(0.5)).energy.deposited / truth - 1) > 0.05
    assert trace_frame(context, OPEN).energy.deposited == pytest.approx(truth, rel=0.01)


def bending_rod(shutter: Shutter) -> MeshAtShutter:
    """A rod of glass facets along y, whose one half bends aside by 55 degrees as the other turns by -10."""
    y, about = np.linspace(-0.7, 0.7, 17), 2.0 * np.pi * np.arange(24) / 24
    straight = np.stack(
        [0.16 * np.cos(about) + 0.0 * y[:, None], y[:, None] + 0.0 * about, 0.16 * np.sin(about) + 0.0 * y[:, None]],
        axis=-1,
    ).reshape(-1, 3)
    share = np.clip((straight[:, 1] + 0.35) / 0.7, 0.0, 1.0)[:, None]

    def at(time: float) -> np.ndarray:
        halves = [straight @ rotation((0.0, 0.0, 1.0), degrees * (time + 0.5)).T for degrees in (-10.0, 55.0)]
        return (1.0 - share) * halves[0] + share * halves[1] + [0.0, 0.0, 0.8]

    along, around = np.meshgrid(np.arange(16), np.arange(24), indexing="ij")
    a, b = (along * 24 + around).ravel(), (along * 24 + (around + 1) % 24).ravel()
    triangles = np.concatenate([np.stack([a, a + 24, b + 24], axis=1), np.stack([a, b + 24, b], axis=1)])
    motions = at(shutter.close) - at(shutter.open) if shutter.exposure > 0.0 else None
    return mesh("/rod", at(shutter.middle), triangles, glass(1.5), motions=motions)


def test_what_bends_too_far_for_cells_to_ride_catches_the_light_that_it_does_all_the_while():
    """As stills have it: cells that rest where it is at mid shutter catch a twelfth less."""

    def source() -> Source:
        return Source(lambda shutter: SceneAtShutter(shutter, (floor(), bending_rod(shutter)), (sun(),)))

    def sent(shutter: Shutter) -> float:
        return trace_frame(RenderContext(source(), Settings.of(SETTINGS, photons=16384)), shutter).energy.sent

    wanted = np.mean([sent(Shutter.still(time)) for time in (np.arange(8) + 0.5) / 8 - 0.5])
    assert sent(Shutter(0.0, -0.5, 0.5)) == pytest.approx(wanted, rel=0.01)
