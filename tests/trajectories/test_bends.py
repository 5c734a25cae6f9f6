"""Bends of footprints against the exact second derivatives of light under a wave, and where there are none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from tests.estimators.frames import OPEN, SETTINGS
from tests.footprints.photons import ONE_THREAD
from tests.trajectories.test_fit import on_water, root_mean_square
from tests.view.scenes import looking_down, wave_source
from tpdwarp.clock import Clock
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.photons.vectors import lengths
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.settings import Settings
from tpdwarp.trajectories.bends import Beside, over_cells, with_bends
from usd_scenes.oracle import Wave, irradiance_average
from usd_scenes.oracle.caustic_1d import landing


def bent_photons(wave: Wave, photons: int) -> tuple[PhotonMap, float]:
    """Photons under a wave at mid shutter, and the size of the scene in the tracer's units."""
    context = RenderContext(wave_source(wave), Settings.of(SETTINGS, photons=photons))
    plan = context.tracer.plan(photons)
    found, _ = context.tracer.trace(context.tracer.load(OPEN), plan, Clock())
    return with_bends(found, plan, ONE_THREAD), context.normalization.scale


def test_light_under_a_wave_bends_by_half_of_its_second_derivative():
    wave = Wave()
    photons, scale = bent_photons(wave, 1024)
    x0, cell = on_water(photons), 4 / np.ceil(photons.emission[:, 0].max())
    # The change of D_u x from one neighbour to the other, by differences a tenth of a cell apart.
    sides = [(landing(x0 + k * cell + 0.1 * cell, 0.5, wave) - landing(x0 + k * cell - 0.1 * cell, 0.5, wave)) / 0.2
             for k in (-1, 1)]  # fmt: skip
    exact = 0.25 * (sides[1] - sides[0])
    inside = np.abs(x0) < 1.9
    error = (photons.bend[:, 0] / scale - exact)[inside]
    # The mesh's normals are straight between vertices, as bends are between cells.
    assert root_mean_square(error) < 0.1 * root_mean_square(exact[inside])
    np.testing.assert_allclose(photons.bend[inside, 1:], 0, atol=2e-2 * root_mean_square(exact) * scale)


def test_smooth_light_bends_as_much_when_it_goes_far():
    """The same photons at rest, and as they go ten footprints within the shutter."""
    context = RenderContext(wave_source(Wave()), Settings.of(SETTINGS, photons=4096))
    plan = context.tracer.plan(4096)
    found, _ = context.tracer.trace(context.tracer.load(OPEN), plan, Clock())
    slow, fast = (with_bends(replace(found, dxdt=speed * found.dxdu), plan, ONE_THREAD).bend for speed in (0.0, 10.0))
    bent = lengths(slow) > 0.1 * root_mean_square(lengths(slow))
    # Where the bend is less than a sixth of the column; at the rim there is no neighbour to tell.
    smooth = bent & (lengths(slow) < 0.14 * lengths(found.dxdu)) & (np.abs(on_water(found)) < 1.9)
    assert smooth.sum() > 1000
    np.testing.assert_allclose(fast[smooth], slow[smooth], atol=0.02 * root_mean_square(slow))


def test_light_that_lies_elsewhere_bends_nothing():
    """Every second column of cells lands on another receiver, or far off: no neighbour lies where it should."""
    context = RenderContext(wave_source(Wave()), Settings.of(SETTINGS, photons=4096))
    plan = context.tracer.plan(4096)
    found, _ = context.tracer.trace(context.tracer.load(OPEN), plan, Clock())
    odd = np.floor(found.emission).astype(int).sum(axis=1) % 2 == 1
    found.receiver[odd] += 1
    np.testing.assert_array_equal(with_bends(found, plan, ONE_THREAD).bend, 0)
    found.receiver[odd] -= 1
    found.position[odd] += np.float32([0.3, 0.0, 0.0])
    np.testing.assert_array_equal(with_bends(found, plan, ONE_THREAD).bend, 0)


def test_photons_of_other_maps_are_neighbours_too():
    """Of light of which a part is traced otherwise, the rest knows what it knows of all of it."""
    context = RenderContext(wave_source(Wave()), Settings.of(SETTINGS, photons=1024))
    plan = context.tracer.plan(1024)
    found, _ = context.tracer.trace(context.tracer.load(OPEN), plan, Clock())
    inside = np.abs(on_water(found)) < 1.0
    whole, alone = with_bends(found, plan, ONE_THREAD).rows(inside), with_bends(found.rows(inside), plan, ONE_THREAD)
    beside = with_bends(found.rows(inside), plan, ONE_THREAD, [found.rows(~inside)])
    for name in ("ids", "cell_u", "cell_v", "bend", "reach"):
        np.testing.assert_array_equal(getattr(beside, name), getattr(whole, name))
    assert np.any(alone.cell_u != whole.cell_u) and np.any(alone.bend != whole.bend)


# Vertices along each side of water on which triangles lie across the waves.
COLUMNS = 257


def test_columns_count_all_triangles_that_a_cell_has_light_from():
    """Waves that go across the rows of triangles: nothing bends light along them, where cells are the longest."""
    wave, heading = Wave(), 30.0
    context = RenderContext(wave_source(wave, columns=COLUMNS, heading=heading), Settings.of(SETTINGS, photons=4096))
    plan = context.tracer.plan(4096)
    found, _ = context.tracer.trace(context.tracer.load(OPEN), plan, Clock())
    ahead = np.array([np.cos(np.radians(heading)), np.sin(np.radians(heading)), 0.0])
    shaped = with_bends(found, plan, ONE_THREAD)
    # Some cells from the rim, past which photons have no neighbours.
    inside = np.abs(found.position[:, :2] / context.normalization.scale).max(axis=1) < 1.5
    across = [root_mean_square((column @ ahead)[inside]) for column in (found.dxdv, shaped.cell_v)]
    narrow = root_mean_square(lengths(found.dxdu)[inside])
    assert across[0] > 0.1 * narrow
    assert across[1] < 0.02 * narrow


@pytest.mark.parametrize("wavelength", [1.3, 0.65])
def test_waves_are_as_exact_wherever_they_go(wavelength):
    """Bands of light, and folds, of water that is cut along x and y."""
    wave, size = Wave(wavelength=wavelength, speed=wavelength / 8), (128, 32)
    truth = irradiance_average(np.linspace(-1, 1, size[0] + 1), wave, 0, 1, 128)
    camera = looking_down((-1, 1, -0.25, 0.25), height=0.85 * wave.height)

    def error(heading: float) -> float:
        source = wave_source(wave, columns=2 * COLUMNS - 1, camera=camera, heading=heading)
        context = RenderContext(source, Settings.of(SETTINGS, photons=4096))
        frame = render_frame(context, OPEN, *size)
        return root_mean_square(frame.channels["irradiance.R"] - truth) / truth.mean()

    # Normals that are straight between vertices leave .0002 of the light.
    assert error(30.0) < 1.2 * error(360.0) + 0.0002


@pytest.mark.parametrize(("turn", "part"), [(0.0, 1.0), (0.3, 1.0), (0.45, 0.5), (0.6, 0.0)])
def test_columns_stand_where_light_changes_from_cell_to_cell(turn, part):
    """Three photons in a row, whose two ways differ by part ``turn`` of the column."""
    position = np.zeros((3, 3), np.float32)
    position[:, 0], position[:, 1] = (-1.0, 0.0, 1.0), (0.5 * turn, 0.0, 0.5 * turn)
    told = np.tile(np.float32([1.0, 0.0, 0.0]), (3, 1))
    told[1] = (0.6, 0.8, 0.0)
    beside = Beside()
    beside.ahead = ONE_THREAD.array(np.int32([1, 2, -1]), wp.int32)
    beside.behind = ONE_THREAD.array(np.int32([-1, 0, 1]), wp.int32)
    widened = over_cells(told, ONE_THREAD.array(position, wp.vec3), beside, ONE_THREAD)
    found, smooth = widened.column.numpy(), widened.smooth.numpy()
    np.testing.assert_allclose(smooth, [0.0, part, 0.0], atol=1e-5)
    np.testing.assert_allclose(found[1], part * np.float32([1, 0, 0]) + (1 - part) * told[1], atol=1e-5)
    # Nothing is known beyond the ends of a row.
    np.testing.assert_array_equal(found[[0, 2]], told[[0, 2]])
