"""Lattices on lights: what they cover, how many photons they make, and that they stay where they are."""

from __future__ import annotations

import math

import numpy as np
import pytest
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.photons.aiming import Specular, specular_triangles
from tpdwarp.photons.beam import Beam
from tpdwarp.photons.emission import Domain, Patch, cell_flux, emit
from tpdwarp.photons.lattices import CUBE_FACE, LEAST_WEIGHT, EmissionPlan, plan_emission
from tpdwarp.scene.description import Interaction, Material, MeshAtShutter, SceneAtShutter, Shutter
from tpdwarp.scene.normalization import Normalization
from usd_scenes.oracle.optics import unit

from .moving_scenes import GRID, SCENES, wave
from .shapes import DIFFUSE, MIRROR, ball, box, floor, glass, moving, quad, ripples
from .traced import EPS, Written, lamp, scene_of, sun, traced, turning_sun

ROUNDING = 64 * EPS


@wp.kernel(enable_backward=False)
def emit_all(
    patch: Patch, coordinates: wp.array(dtype=wp.vec2), beams: wp.array(dtype=Beam), flux: wp.array(dtype=wp.vec3)
):
    i = wp.tid()
    beams[i] = emit(patch, coordinates[i])
    flux[i] = cell_flux(patch, coordinates[i])


def emitted(patch: Patch, coordinates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Beams (a structured array) and flux [n, 3] at lattice coordinates [n, 2]."""
    launcher = Launcher("cpu", 1)
    beams = wp.zeros(len(coordinates), dtype=Beam, device="cpu")
    flux = launcher.zeros(len(coordinates), wp.vec3)
    inputs = [patch, launcher.array(coordinates.astype(np.float32), wp.vec2), beams, flux]
    wp.launch(emit_all, dim=len(coordinates), inputs=inputs, device="cpu")
    return beams.numpy(), flux.numpy().astype(np.float64)


def planned(source: SceneAtShutter | Written, photons: int = 1000) -> tuple[EmissionPlan, Written]:
    source = source if isinstance(source, Written) else Written(source)
    return plan_emission(source, photons, Normalization.of(source.at(source.reference_shutters()[0]))), source


def cells(patch: Patch) -> np.ndarray:
    """Lattice coordinates [n, 2] of the middles of all cells."""
    u, v = np.meshgrid(patch.first_u + np.arange(patch.count_u), patch.first_v + np.arange(patch.count_v))
    return np.stack([u.ravel(), v.ravel()], axis=1) + 0.5


def corner_range(patch: Patch) -> np.ndarray:
    """Lowest and highest patch coordinates covered, shape [2, 2]."""
    first = np.array([patch.first_u, patch.first_v])
    count = np.array([patch.count_u, patch.count_v])
    return np.array(patch.origin) + np.array([first, first + count]) * np.array(patch.step)


def placed(patch: Patch, time: float) -> list[np.ndarray]:
    """Position and axes u, v, w of a patch at a time (−½ … ½), float64."""
    names = ("position", "axis_u", "axis_v", "axis_w")
    return [
        np.array(getattr(patch, name), np.float64) + time * np.array(getattr(patch, f"{name}_motion"), np.float64)
        for name in names
    ]


def analytic_beams(patch: Patch, coordinates: np.ndarray, time: float) -> np.ndarray:
    """Positions and directions [n, 2, 3] at lattice coordinates [n, 2] and a time (−½ … ½), float64."""
    uv = np.array(patch.origin, np.float64) + coordinates * np.array(patch.step, np.float64)
    position, u, v, w = placed(patch, time)
    if patch.domain == Domain.PLANE:
        return np.stack(np.broadcast_arrays(position + uv @ np.array([u, v]), unit(w[None])), axis=1)
    directions = unit(np.tan(uv) @ np.array([u, v]) + w)
    return np.stack(np.broadcast_arrays(position, directions), axis=1)


PATCHES = {
    "a still sun": lambda: wave(True, sun((0.3, 0.2, -1))),
    "a turning sun": lambda: wave(True, turning_sun((0.2, 0.1, -1), (0.3, 0.05, -1))),
    "a moving lamp": lambda: wave(True, lamp((0.3, 0.1, 2.5), (0.15, -0.1, 0.2))),
}


@pytest.mark.parametrize("name", PATCHES)
def test_columns_are_the_derivatives_of_the_emission_map(name):
    scene = PATCHES[name]()
    plan, _ = planned(scene)
    ((_, patch),) = plan.patches(scene)
    at = cells(patch)[:: max(1, patch.count_u // 3)]
    beams, _ = emitted(patch, at)
    size = 1 + np.abs(np.array(patch.position)).max()
    found = np.stack([beams["x"], beams["w"]], axis=1)
    np.testing.assert_allclose(found, analytic_beams(patch, at, 0), atol=size * EPS * 8)

    def derivative(function, h: float = 1e-3) -> np.ndarray:
        return (8 * (function(h) - function(-h)) - (function(2 * h) - function(-2 * h))) / (12 * h)

    columns = {
        "u": derivative(lambda h: analytic_beams(patch, at + np.array([h, 0]), 0)),
        "v": derivative(lambda h: analytic_beams(patch, at + np.array([0, h]), 0)),
        "t": derivative(lambda h: analytic_beams(patch, at, h)),
    }
    for a, expected in columns.items():
        found = np.stack([beams[f"dxd{a}"], beams[f"dwd{a}"]], axis=1)
        np.testing.assert_allclose(found, expected, atol=size * ROUNDING)


def test_cells_of_a_plane_share_its_irradiance_equally():
    scene = wave(True, sun(irradiance=2.0))
    plan, _ = planned(scene)
    ((_, patch),) = plan.patches(scene)
    _, flux = emitted(patch, cells(patch))
    area = np.prod(np.array(patch.step)) / plan.normalization.scale**2
    np.testing.assert_allclose(plan.normalization.power * flux, 2.0 * area, rtol=ROUNDING)


def test_cells_of_six_faces_share_the_sphere():
    scene = scene_of([box("/room", (-1, -1, 0), (1, 1, 2), MIRROR)], lamp((0.3, -0.2, 1.4), intensity=0.5))
    plan, _ = planned(scene, 6000)
    patches = plan.patches(scene)
    assert len(patches) == 6
    total = plan.normalization.power * sum(emitted(patch, cells(patch))[1].sum(axis=0) for _, patch in patches)
    step = max(max(lattice.step) for lattice, _ in patches)
    # Midpoint rule; the density's second derivative is below 4 of its own size.
    np.testing.assert_allclose(total, 0.5 * 4 * math.pi, rtol=4 * step**2 / 24 + ROUNDING)


@pytest.mark.parametrize("photons", [100, 1000, 20000])
@pytest.mark.parametrize("name", PATCHES)
def test_about_as_many_photons_as_asked_meet_the_water(name, photons):
    scene = PATCHES[name]()

    def still(shutter: Shutter) -> SceneAtShutter:
        lights = [sun(tuple(-light.axes[2])) if light.kind == 0 else lamp(light.position) for light in scene.lights]
        return scene_of([ripples(GRID, GRID, 1.0, 0.04, glass(1.33), True), floor()], *lights)

    plan, source = planned(Written(still), photons)
    count = sum(patch.count_u * patch.count_v for _, patch in plan.patches(source.at(Shutter.still(4))))
    # The rectangle along what bends the light may be larger than the water. Rows and columns are whole numbers.
    (candidate,) = plan.candidates
    assert count == pytest.approx(photons * candidate.shape.excess, rel=2 / math.sqrt(photons))


def test_lights_share_photons_by_the_eighth_root_of_the_power_that_they_send():
    meshes = [floor(1.0, 1.0, glass(), "/water"), floor()]
    lights = [sun(irradiance=1.0, path="/weak"), sun(irradiance=3.0, path="/strong")]
    plan, source = planned(scene_of(meshes, *lights), 4000)
    counts = {lattice.light: p.count_u * p.count_v for lattice, p in plan.patches(source.at(Shutter.still(4)))}
    assert counts["/strong"] / counts["/weak"] == pytest.approx(3 ** (1 / 8), rel=0.05)
    assert sum(counts.values()) == pytest.approx(4000, rel=0.05)


@pytest.mark.parametrize("ratio", [1e3, 1e6, 1e12])
def test_no_light_starves_however_faint_beside_another(ratio):
    meshes = [floor(1.0, 1.0, glass(), "/water"), floor()]
    lights = [sun(irradiance=1 / ratio, path="/faint"), sun(irradiance=1.0, path="/strong")]
    plan, source = planned(scene_of(meshes, *lights), 4000)
    counts = {lattice.light: p.count_u * p.count_v for lattice, p in plan.patches(source.at(Shutter.still(4)))}
    assert counts["/faint"] >= 0.9 * LEAST_WEIGHT / (1 + LEAST_WEIGHT) * 4000


def test_a_dark_light_emits_nothing():
    plan, source = planned(scene_of([floor(1.0, 1.0, glass(), "/water"), floor()], sun(irradiance=0.0)))
    assert plan.patches(source.at(Shutter.still(4))) == []


def test_nothing_specular_emits_nothing():
    plan, source = planned(scene_of([floor()], sun(), lamp((0, 0, 2))))
    assert plan.patches(source.at(Shutter.still(4))) == [] and plan.planned_ids == 0


@pytest.mark.parametrize("name", SCENES)
def test_the_domain_covers_every_specular_vertex_at_mid_shutter_and_little_else(name):
    scene = SCENES[name]()
    plan, _ = planned(scene)
    ((_, patch),) = plan.patches(scene)
    low, high = corner_range(patch)
    corners = Specular.of(scene, plan.normalization).points
    position, u, v, w = placed(patch, 0.0)
    if patch.domain == Domain.PLANE:
        uv = corners @ np.array([u, v]).T
    else:
        offsets = corners - position
        uv = np.arctan2(offsets @ np.array([u, v]).T, (offsets @ w)[:, None])
    step, slack = np.array(patch.step), 1.1e-4 * np.array(patch.step)
    assert (uv >= low - slack).all() and (uv <= high + slack).all()
    assert (uv.min(axis=0) < low + step + slack).all() and (uv.max(axis=0) > high - step - slack).all()


def orbiting(shutter: Shutter) -> SceneAtShutter:
    """A glass ball that circles a lamp, once in sixteen frames."""
    angle = 2 * math.pi * shutter.middle / 16 + 0.2
    body = ball("/ball", (1.5 * math.cos(angle), 1.5 * math.sin(angle), 1.0), 0.3, 6, glass())
    return scene_of([body, floor(half=3.0)], lamp((0, 0, 1)), shutter=shutter)


def test_cells_of_one_face_of_the_cube_never_reach_into_another():
    plan, source = planned(Written(orbiting, references=(0, 3, 6, 9, 12, 15)), 2000)
    partial = 0
    for frame in range(16):
        for lattice, patch in plan.patches(source.at(Shutter.still(frame))):
            assert lattice.limit == CUBE_FACE
            assert np.abs(corner_range(patch)).max() <= CUBE_FACE + 1e-4 * max(lattice.step)
            partial += np.abs(corner_range(patch)).max() > CUBE_FACE - max(lattice.step)
    assert partial > 4


@pytest.mark.parametrize("references", [(0, 1), (0, 8), (0, 3, 6, 9, 12, 15)])
def test_a_body_is_lit_at_every_frame_wherever_the_references_saw_it(references):
    for frame in range(16):
        found = traced(Written(orbiting, references), 500, shutter=Shutter.still(frame))
        # The cap that a ball of radius 0.3 at 1.5 covers; a lattice counts cells on its rim for a few per cent.
        expected = 3 * 2 * math.pi * (1 - math.sqrt(1 - 0.2**2))
        assert found.energy.sent == pytest.approx(expected, rel=0.08)


def flashing(shutter: Shutter) -> SceneAtShutter:
    """A strong light that shines at frame 5 only, beside one that always does; readers leave dark lights out."""
    water = floor(1.0, 1.0, glass(), "/water")
    flash = [lamp((0, 0, 3), intensity=50.0)] if shutter.frame == 5 else []
    return scene_of([water, floor()], sun(), *flash, shutter=shutter)


def test_a_flash_between_the_stills_is_emitted_with_ids_of_its_own():
    plan, source = planned(Written(flashing, references=(0, 4, 8)), 1000)
    (_, steady), (late, flash) = plan.patches(source.at(Shutter.still(5)))
    assert late.light == "/lamp" and flash.count_u * flash.count_v == pytest.approx(1000, rel=0.1)
    assert steady.count_u * steady.count_v == pytest.approx(1000, rel=0.1)
    assert plan.planned_ids <= late.first_id
    assert late.first_id + late.wrap[0] * late.wrap[1] <= plan.id_count
    assert len(plan.patches(source.at(Shutter.still(4)))) == 1


def rising(shutter: Shutter) -> SceneAtShutter:
    """A ball that rises far above where the scene was when it was measured."""
    body = ball("/ball", (0, 0, 1 + 5.0 * shutter.middle), 0.5, 6, glass())
    return scene_of([body, floor(half=2.0)], sun(), shutter=shutter)


def test_light_from_afar_comes_from_beyond_everything_in_the_frame():
    plan, source = planned(Written(rising, references=(0, 8)))
    for frame in (0, 4, 8):
        scene = source.at(Shutter.still(frame))
        ((_, patch),) = plan.patches(scene)
        highest = plan.normalization.points(scene.meshes[0].points)[:, 2].max()
        assert -patch.start > highest and patch.axis_w[2] == -1


def test_a_lattice_keeps_its_phase_from_frame_to_frame():
    def drifting(shutter: Shutter) -> SceneAtShutter:
        body = ball("/ball", (0.137 * shutter.middle, 0, 1.2), 0.5, 6, glass())
        return scene_of([body, floor()], sun(), shutter=shutter)

    plan, source = planned(Written(drifting, references=(0, 4, 8)))
    firsts = []
    for frame in range(9):
        ((lattice, patch),) = plan.patches(source.at(Shutter.still(frame)))
        np.testing.assert_allclose(np.array(patch.origin), lattice.origin, rtol=2 * EPS)
        np.testing.assert_allclose(np.array(patch.step), lattice.step, rtol=2 * EPS)
        firsts.append(patch.first_u)
    # The window on the lattice moves with the ball, by whole cells.
    step = lattice.step[0] / plan.normalization.scale
    assert firsts[-1] - firsts[0] == pytest.approx(0.137 * 8 / step, abs=1.001)


def test_ids_of_different_lattices_do_not_overlap():
    scene = scene_of([floor(1.0, 1.0, glass(), "/water"), floor()], sun(path="/a"), sun(path="/b"), lamp((0, 0, 2)))
    plan, _ = planned(scene)
    ends = [lattice.first_id + lattice.wrap[0] * lattice.wrap[1] for lattice in plan.lattices]
    assert [lattice.first_id for lattice in plan.lattices] == [0, *ends[:-1]]
    assert ends[-1] == plan.planned_ids < plan.id_count


def test_only_the_specular_triangles_of_a_mesh_are_aimed_at():
    part = ball("/ball", (0, 0, 0), 1.0, 1, glass())
    kinds = np.arange(len(part.triangles), dtype=np.int32) % 3
    materials = (DIFFUSE, Material(Interaction.DIELECTRIC), MIRROR)
    several = MeshAtShutter("/ball", part.points, part.triangles, materials=materials, triangle_materials=kinds)
    np.testing.assert_array_equal(specular_triangles(several), part.triangles[kinds > 0])
    assert len(specular_triangles(floor())) == 0
    np.testing.assert_array_equal(specular_triangles(part), part.triangles)


def test_specular_points_stand_where_they_are_at_mid_shutter():
    body = moving(ball("/ball", (0, 0, 1), 0.5, 2, glass()), (0.2, 0, -0.4))
    norm = Normalization((0.0, 0.0, 0.0), 0.25, 1.0)
    specular = Specular.of(scene_of([body, floor()], sun()), norm)
    np.testing.assert_allclose(specular.points[specular.triangles], 0.25 * body.points[body.triangles], atol=2 * EPS)


@pytest.mark.parametrize("far", [1.0, 1e3, 1e6])
def test_how_far_things_go_within_the_shutter_does_not_change_how_many_photons_are_emitted(far):
    body = moving(ball("/ball", (0, 0, 1), 0.5, 4, glass()), (far, 0, far))
    plan, source = planned(scene_of([body, floor()], sun(), lamp((0, 0, 3), (far, far, 0))))
    count = sum(patch.count_u * patch.count_v for _, patch in plan.patches(source.at(Shutter(4, 3, 5))))
    # Rows and columns are whole numbers, of each of two lights.
    assert count == pytest.approx(1000, rel=4 / math.sqrt(1000))


@pytest.mark.parametrize("angle", [1e-2, 1e-5, 1e-9])
def test_a_strip_seen_edge_on_gets_as_many_cells_as_were_asked_for(angle):
    light = sun((math.cos(angle), 0, -math.sin(angle)))
    plan, source = planned(scene_of([floor(1.0, 1.0, glass(), "/water"), floor()], light))
    ((_, patch),) = plan.patches(source.at(Shutter.still(4)))
    assert patch.count_u * patch.count_v == pytest.approx(1000, rel=0.05)


def test_what_shows_its_edge_in_the_stills_and_its_side_between_them_is_lit_by_as_many_photons_as_were_asked_for():
    def turning_plate(shutter: Shutter) -> SceneAtShutter:
        angle = 0.5 * math.pi * (shutter.middle + 1.0) + 1e-7
        across = (math.cos(angle), 0, math.sin(angle))
        plate = quad("/plate", (0, 0, 2), across, (0, 1, 0), glass())
        return scene_of([plate, floor()], sun(), shutter=shutter)

    plan, source = planned(Written(turning_plate, references=(0, 2, 4)))
    patches = plan.patches(source.at(Shutter.still(1)))
    assert sum(patch.count_u * patch.count_v for _, patch in patches) == pytest.approx(1000, rel=0.1)
    energy = traced(Written(turning_plate, (0, 2, 4)), shutter=Shutter.still(1)).energy
    assert energy.sent == pytest.approx(12, rel=0.01)
