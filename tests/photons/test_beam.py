"""One interaction of a beam: its directions too, and the choice of the normal it is shaded by."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.photons.beam import Beam, interface_at, relative_index, scatter, transfer_to
from tpdwarp.scene.description import Interaction
from tpdwarp.scene.device.geometry import Surfaces, geometry_of
from tpdwarp.scene.device.intersection import closest_hit
from tpdwarp.scene.normalization import Normalization
from usd_scenes.oracle import closed_forms, finite_differences, surfaces_of
from usd_scenes.oracle.emission import beam_around

from .shapes import DIFFUSE, MIRROR, cap, floor, glass, mesh, ripples
from .traced import EPS, SHUTTER, scene_of

UNIT = Normalization((0.0, 0.0, 0.0), 1.0, 1.0)
GRID = np.linspace(-0.5, 0.5, 9)
CELL = GRID[1] - GRID[0]


@wp.kernel(enable_backward=False)
def interact(
    surfaces: Surfaces,
    beams: wp.array(dtype=Beam),
    dielectric: bool,
    reflected: bool,
    out: wp.array(dtype=Beam),
    flat: wp.array(dtype=wp.int32),
):
    i = wp.tid()
    beam = beams[i]
    hit = closest_hit(surfaces, beam.x, beam.w, beam.offset, surfaces.magnitude, 0.0, 100.0, True, wp.rand_init(1, i))
    arrived = transfer_to(beam, hit, True, True)
    eta = relative_index(surfaces, hit, beam.w)
    at = interface_at(surfaces, hit, beam.w, dielectric, eta, True)
    out[i] = scatter(arrived, hit, at, reflected, True, True)
    flat[i] = int(at.flat)


def interaction(scene, columns: dict[str, np.ndarray], reflected: bool) -> tuple[np.ndarray, np.ndarray]:
    """Beams after the first surface of a scene, as a structured array, and whether they were shaded flat."""
    launcher = Launcher("cpu", 1)
    geometry = geometry_of(scene, UNIT, launcher, with_motions=True)
    dielectric = scene.meshes[0].materials[0].interaction == Interaction.DIELECTRIC
    count = len(columns["x"])
    beams = np.zeros(count, dtype=Beam.numpy_dtype())
    for name, values in columns.items():
        beams[name] = values
    out, flat = wp.zeros(count, dtype=Beam, device="cpu"), launcher.zeros(count, wp.int32)
    given = wp.array(beams, dtype=Beam, device="cpu")
    wp.launch(interact, count, inputs=[geometry.surfaces, given, dielectric, reflected, out, flat], device="cpu")
    return out.numpy(), flat.numpy()


def columns_of(count: int) -> dict[str, np.ndarray]:
    """Beams from above with every column different from zero; float32 values, in float64."""
    random = np.random.default_rng(9)
    x = np.append(random.uniform(-0.3, 0.3, (count, 2)), np.full((count, 1), 0.8), axis=1)
    w = np.append(random.uniform(-0.3, 0.3, (count, 2)), np.full((count, 1), -1.0), axis=1)
    columns = {"x": x, "w": w / np.linalg.norm(w, axis=1, keepdims=True)}
    for a in "uvt":
        columns[f"dxd{a}"] = random.uniform(-0.2, 0.2, (count, 3))
        turn = random.uniform(-0.2, 0.2, (count, 3))
        columns[f"dwd{a}"] = turn - columns["w"] * np.einsum("ij,ij->i", turn, columns["w"])[:, None]
    return columns


@pytest.mark.parametrize("smooth", [True, False])
@pytest.mark.parametrize("material, reflected", [(glass(1.33), False), (glass(1.33), True), (MIRROR, True)])
def test_directions_and_their_columns_are_those_of_finite_differences(material, reflected, smooth):
    count = 48
    columns = columns_of(count)
    scene = scene_of([ripples(GRID, GRID, 0.0, 0.03, material, smooth)])
    beams, flat = interaction(scene, columns, reflected)
    screen = floor(2.0 if reflected else -2.0, 50.0)
    around = beam_around(
        columns["x"], columns["w"], columns["dxdu"], columns["dxdv"], columns["dwdu"], columns["dwdv"],
        columns["dxdt"], columns["dwdt"], SHUTTER,
    )  # fmt: skip
    zeros = np.zeros(count)
    choices = "reflect" if reflected else "refract"
    found = finite_differences(
        surfaces_of(scene_of([*scene.meshes, screen])), around, zeros, zeros, SHUTTER, "light", choices
    )
    inside = np.nanmin(found.path.barycentrics[0], axis=1) > 1e-4
    assert inside.sum() > 40 and not flat[inside].any()
    # Hits round to EPS, barycentrics to EPS over a cell, a facet's normal to that; normals turn by 0.2 over a cell.
    tolerance = 20 * EPS / CELL
    np.testing.assert_allclose(beams["w"][inside], found.path.directions[inside], atol=tolerance)
    for a in "uvt":
        expected = getattr(found, f"domegad{a}")[inside]
        assert np.abs(expected).max() > 0.05
        np.testing.assert_allclose(beams[f"dwd{a}"][inside], expected, atol=20 * tolerance)


def test_check_13_light_from_afar_keeps_the_lagrange_invariant_at_zero():
    count, half_angle, cells = 64, 0.3, 128
    random = np.random.default_rng(2)
    x = np.append(random.uniform(-0.2, 0.2, (count, 2)), np.full((count, 1), 2.0), axis=1)
    w = np.array([0.2, 0.1, -1.0]) / np.linalg.norm([0.2, 0.1, -1.0])
    u = np.cross(w, [0, 1, 0])
    x += w * [1, 1, 0] * -1.0
    columns = {name: np.tile(value, (count, 1)) for name, value in (("w", w), ("dxdu", u), ("dxdv", [0, 1, 0]))}
    columns["x"] = x
    scene = scene_of([cap("/ball", (0, 0, 0), 1.0, (0, 0, 1), half_angle, cells, glass())])
    for reflected in (False, True):
        beams, _ = interaction(scene, columns, reflected)
        dxdu, dxdv, dwdu, dwdv = (beams[name].astype(np.float64) for name in ("dxdu", "dxdv", "dwdu", "dwdv"))
        invariant = closed_forms.lagrange_invariant(dxdu, dxdv, dwdu, dwdv, 1.0 if reflected else 1.5)
        # Facets are tilted against the normals they are shaded with, by half a cell at most.
        assert np.abs(np.einsum("ij,ij->i", dwdu, dxdu)).min() > 0.1
        np.testing.assert_allclose(invariant, 0, atol=4 * half_angle / cells)


def leaning(tilt: float, material) -> object:
    """A horizontal triangle whose interpolated normal leans by ``tilt`` along x."""
    normal = [np.sin(tilt), 0, np.cos(tilt)]
    return mesh("/leaning", [[-9, -9, 0], [9, -9, 0], [0, 9, 0]], [[0, 1, 2]], material, normals=np.array([normal] * 3))


@pytest.mark.parametrize("material, reflected", [(MIRROR, True), (glass(), True), (glass(), False)])
def test_light_never_leaves_through_the_wrong_side_of_a_facet(material, reflected):
    angles = np.radians([10.0, 40.0, 70.0, 85.0, 89.0])
    w = np.stack([-np.sin(angles), 0 * angles, -np.cos(angles)], axis=1)
    w = np.concatenate([w, w * [-1, 1, 1]])
    columns = {"x": -w, "w": w}
    beams, flat = interaction(scene_of([leaning(0.3, material)]), columns, reflected)
    side = 1 if reflected else -1
    assert (np.sign(beams["w"][:, 2]) == side).all()
    assert flat.any() and not flat.all()
    # Where the facet's own normal is taken, light obeys the law at that normal.
    bent = np.sin(np.concatenate([angles, angles])) / (1.0 if reflected else 1.5)
    np.testing.assert_allclose(np.abs(beams["w"][flat == 1, 0]), bent[flat == 1], atol=20 * EPS)


def test_a_beam_starts_on_the_side_that_it_leaves_to():
    down = {"x": np.array([[0.1, 0.1, 1.0]]), "w": np.array([[0.0, 0.0, -1.0]])}
    for material, reflected, side in ((MIRROR, True, 1), (glass(), False, -1), (glass(), True, 1)):
        beams, _ = interaction(scene_of([leaning(0.1, material), floor(-1.0, 1.0, DIFFUSE)]), down, reflected)
        assert np.sign(beams["offset"][0, 2]) == side
