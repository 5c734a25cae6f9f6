"""The one-dimensional caustic against its own laws and against the tracer."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tpdwarp.scene.description import Interaction, MeshAtShutter, Shutter
from usd_scenes.oracle import closed_forms
from usd_scenes.oracle.caustic_1d import (
    Wave,
    branches,
    column_irradiance,
    irradiance,
    irradiance_average,
    landing,
    stretch,
    transmittance,
)
from usd_scenes.oracle.description import linear_motion
from usd_scenes.oracle.shapes import grid_points, grid_triangles
from usd_scenes.oracle.surfaces import HeightField, Plane, TriangleMesh
from usd_scenes.oracle.tracer import trace

WAVE = Wave()
FOLDED = Wave(wavelength=0.65)
FLOOR = Plane("/floor", (0, 0, 0), (0, 0, 1))


def field(wave: Wave) -> HeightField:
    """The smooth wave as a surface of the tracer."""

    def slopes(x, y, t):
        _, nx, nz = wave.smooth(x, t)
        return -nx / nz, 0 * y

    low, high = wave.height - wave.amplitude, wave.height + wave.amplitude
    return HeightField("/water", lambda x, y, t: wave.smooth(x, t)[0], slopes, (low, high), ior=wave.ior)


def straight_down(x0: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    origins = np.stack([x0, np.full_like(x0, 0.013), np.full_like(x0, 3.0)], axis=1)
    return origins, np.broadcast_to([0.0, 0, -1], origins.shape)


def test_light_lands_where_the_tracer_lands_it():
    x0 = np.linspace(-1, 1, 101)
    path = trace([field(WAVE), FLOOR], *straight_down(x0), 0.4)
    np.testing.assert_allclose(path.positions[:, 0], landing(x0, 0.4, WAVE), atol=1e-12)
    np.testing.assert_allclose(path.throughput, transmittance(x0, 0.4, WAVE), atol=1e-12)


def test_light_through_a_mesh_in_linear_motion_lands_where_the_tracer_lands_it():
    x, y = np.linspace(-1.3, 1.3, 61), np.array([-0.1, 0.1])
    wave = replace(WAVE, vertices=x)

    def authored(frame):
        points = grid_points(x, y, lambda x, y: wave.smooth(x, frame)[0])
        _, nx, nz = wave.smooth(points[:, 0], frame)
        return points, np.stack([nx, 0 * nx, nz], axis=1)

    (p0, n0), (p1, n1) = authored(2), authored(3)
    shutter = Shutter(2, 2, 3)
    mesh = MeshAtShutter("/water", 0.5 * (p0 + p1), grid_triangles(61, 2), p1 - p0)
    water = TriangleMesh(
        mesh.path,
        linear_motion(mesh.points, mesh.motions, shutter),
        mesh.triangles,
        lambda t: (3 - t) * n0 + (t - 2) * n1,
        interaction=Interaction.DIELECTRIC,
        ior=wave.ior,
    )
    x0 = np.linspace(-1.2, 1.2, 97)
    for t in (2.0, 2.3, 2.9):
        path = trace([water, FLOOR], *straight_down(x0), t)
        np.testing.assert_allclose(path.positions[:, 0], landing(x0, t, wave, "linear"), atol=1e-12)


def test_the_stretch_is_the_slope_of_the_landing_point():
    x0, h = np.linspace(0, 1.3, 41), 1e-5
    for motion in ("smooth", "linear"):
        slope = (landing(x0 + h, 0.3, WAVE, motion) - landing(x0 - h, 0.3, WAVE, motion)) / (2 * h)
        np.testing.assert_allclose(stretch(x0, 0.3, WAVE, motion), slope, atol=1e-7)


def test_check_5_light_below_a_travelling_wave_moves_by_c_times_one_minus_the_stretch():
    x0, h = np.linspace(0, 1.3, 41), 1e-5
    moved = (landing(x0, 0.3 + h, WAVE) - landing(x0, 0.3 - h, WAVE)) / (2 * h)
    expected = closed_forms.travelling_wave_displacement(WAVE.speed, stretch(x0, 0.3, WAVE))
    np.testing.assert_allclose(moved, expected, atol=1e-8)


def test_check_15_the_first_cusp_lies_below_the_crest():
    depth = closed_forms.cusp_depth(WAVE.amplitude, WAVE.wave_number, WAVE.ior)
    at_cusp = replace(WAVE, height=depth - WAVE.amplitude)
    assert stretch(np.zeros(1), 0, at_cusp)[0] == pytest.approx(0, abs=1e-12)
    assert len(branches(0.0, 0, replace(at_cusp, height=0.9 * depth))) == 1
    assert len(branches(0.0, 0, replace(at_cusp, height=1.1 * depth))) == 3


@pytest.mark.parametrize("wave", [WAVE, FOLDED])
@pytest.mark.parametrize("motion", ["smooth", "linear"])
def test_a_period_receives_the_light_that_enters_it(wave, motion):
    edges = np.linspace(0.2, 0.2 + wave.wavelength, 65)
    everything = replace(wave, fresnel=False, irradiance=3.0)
    found = irradiance_average(edges, everything, 0, 1, times=7, motion=motion)
    # Where an edge cuts an emission interval, the interval's curvature is neglected: second order in its length.
    assert found.mean() == pytest.approx(3.0, rel=1 / 4096**2)
    x0 = (np.arange(512) + 0.5) / 512 * wave.wavelength
    entering = np.mean([transmittance(x0, (k + 0.5) / 7, wave, motion).mean() for k in range(7)])
    found = irradiance_average(edges, wave, 0, 1, times=7, motion=motion)
    assert found.mean() == pytest.approx(entering, abs=1e-7)


@pytest.mark.parametrize("motion", ["smooth", "linear"])
def test_check_16_away_from_folds_narrow_columns_hold_the_branch_sum(motion):
    x, width = np.linspace(0, FOLDED.wavelength, 40, endpoint=False), 1e-4
    exact = irradiance(x, 0.3, FOLDED, motion)
    for at, value in zip(x, exact, strict=True):
        if np.abs(stretch(branches(at, 0.3, FOLDED, motion), 0.3, FOLDED, motion)).min() < 0.2:
            continue
        edges = np.array([at - width / 2, at + width / 2])
        found = column_irradiance(edges, 0.3, FOLDED, motion, per_wavelength=20000)[0]
        assert found == pytest.approx(value, rel=1e-3)
    counts = [len(branches(at, 0.3, FOLDED, motion)) for at in x]
    assert set(counts) == {1, 3}


def test_the_branch_sum_is_what_the_closed_form_says():
    bare = replace(FOLDED, fresnel=False)
    x = 0.01
    stretches = stretch(branches(x, 0, bare), 0, bare)
    assert irradiance(np.array([x]), 0, bare)[0] == pytest.approx(closed_forms.caustic_branch_sum(stretches))


def test_columns_hold_the_photons_the_tracer_lands_in_them():
    edges = np.linspace(0, FOLDED.wavelength, 33)
    count = 6000
    x0 = -0.5 + (np.arange(count) + 0.5) / count * 1.65
    path = trace([field(FOLDED), FLOOR], *straight_down(x0), 0.4)
    photon = 1.65 / count
    landed, _ = np.histogram(path.positions[:, 0], edges, weights=path.throughput * photon)
    found = column_irradiance(edges, 0.4, FOLDED) * np.diff(edges)
    # Of each branch, a column cuts off at most one photon at either end; there are at most three branches.
    np.testing.assert_allclose(landed, found, atol=6 * photon)


def test_columns_converge_with_the_number_of_emission_intervals():
    edges = np.linspace(0, FOLDED.wavelength, 65)
    coarse, fine, finest = (column_irradiance(edges, 0.4, FOLDED, per_wavelength=n) for n in (1024, 4096, 16384))
    # Order 3/2 at least, which folds leave: four times as many intervals, an eighth of the error.
    assert np.abs(fine - finest).max() < np.abs(coarse - fine).max() / 8
    assert np.abs(fine - finest).max() < 1e-4 * finest.max()


def test_the_time_average_converges_with_the_number_of_times():
    edges = np.linspace(0, WAVE.wavelength, 65)
    coarse, fine, finest = (irradiance_average(edges, WAVE, 0, 1, times=n, per_wavelength=2048) for n in (16, 64, 256))
    assert np.abs(fine - finest).max() < 0.3 * np.abs(coarse - finest).max()
    assert np.sqrt(np.mean((fine - finest) ** 2)) < 2e-3


def test_a_wave_that_has_travelled_carries_its_caustic_along():
    edges = np.linspace(0, WAVE.wavelength, 65)
    np.testing.assert_allclose(
        column_irradiance(edges, 8.0, WAVE), column_irradiance(edges, 0.0, WAVE), atol=1e-9
    )
    shifted = np.roll(column_irradiance(edges, 0.0, WAVE), 8)
    np.testing.assert_allclose(column_irradiance(edges, 1.0, WAVE), shifted, atol=1e-5)


def test_linear_motion_agrees_with_the_wave_at_whole_frames_only():
    edges = np.linspace(0, WAVE.wavelength, 65)
    whole = column_irradiance(edges, 2.0, WAVE, "smooth")
    np.testing.assert_allclose(column_irradiance(edges, 2.0, WAVE, "linear"), whole, atol=1e-12)
    between = column_irradiance(edges, 2.5, WAVE, "smooth")
    assert np.abs(column_irradiance(edges, 2.5, WAVE, "linear") - between).max() > 0.05


def test_half_way_between_frames_linear_motion_lowers_the_wave_by_the_cosine_of_half_its_step():
    half = math.pi / 8
    z, _, _ = WAVE.surface(np.array([WAVE.speed / 2]), 0.5, "linear")
    assert z[0] == pytest.approx(WAVE.height + WAVE.amplitude * math.cos(half), abs=1e-14)


def test_a_mesh_of_the_wave_approaches_it_with_the_square_of_its_spacing():
    edges = np.linspace(0, WAVE.wavelength, 17)
    exact = column_irradiance(edges, 0.3, WAVE)
    errors = []
    for cells in (40, 80):
        meshed = replace(WAVE, vertices=np.linspace(-2 * WAVE.wavelength, 3 * WAVE.wavelength, 5 * cells + 1))
        errors.append(np.linalg.norm(column_irradiance(edges, 0.3, meshed) - exact))
    assert errors[1] < errors[0] / 3


def test_unknown_motion_and_meshed_stretches_are_refused():
    with pytest.raises(ValueError, match="smooth or linear"):
        landing(np.zeros(1), 0, WAVE, "cubic")
    with pytest.raises(ValueError, match="vertices"):
        stretch(np.zeros(1), 0, replace(WAVE, vertices=np.linspace(-1, 1, 5)))
