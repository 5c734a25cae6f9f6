"""Laws of edges at rest: cells that they go through are traced again in finer cells."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.estimators.frames import irradiance
from tests.photons.shapes import floor, glass, mesh
from tests.photons.traced import sun
from tests.view.scenes import Source, looking_down, quad, steady
from tpdwarp.photons.record import PART_IDS
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame, trace_frame
from tpdwarp.scene.description import (
    EmissionProfile,
    Extent,
    ExtentShape,
    LightAtShutter,
    LightKind,
    Shutter,
)
from tpdwarp.settings import Settings
from tpdwarp.trajectories.edges import FINER, FIRST_PART, place_in_finer_cell
from tpdwarp.trajectories.parts import LAST_PART
from usd_scenes import shapes
from usd_scenes.oracle.closed_forms import fresnel_reflectance

SETTINGS = Settings(photons=4096, segments=1, samples=1, aovs=("irradiance",))
STILL = Shutter(0, 0, 0)
# Of 64 cells along each side of the water.
CELL = 4 / 64
WATER = quad("/water", (-2, -2), (2, 2), 1.0, glass(1.33))


def half_covered(place: float) -> Source:
    """Flat water under a sun, and a board above it from ``place`` [cells] on, at rest."""
    board = quad("/board", (place * CELL, -9), (6, 9), 2.0)
    return steady([floor(), WATER, board], (sun(),), looking_down((-1, 1, -0.125, 0.125), height=0.5))


@pytest.mark.parametrize("place", [0.0, 0.3, 0.45, 0.8])
def test_an_edge_takes_part_of_a_cell_wherever_it_lies(place):
    energy = trace_frame(RenderContext(half_covered(place), SETTINGS), STILL).energy
    lit = energy.sent / (3 * 4)  # the width of water in the light
    # Sixteen places along each side of a cell; photons in the middle of it would be wrong by up to half a cell.
    assert lit == pytest.approx(2 + place * CELL, abs=CELL / FINER**2 / 2)


def test_a_shadow_is_as_sharp_as_finer_cells_are_where_cells_are_no_larger_than_pixels():
    place, columns = 0.45, 32
    found = irradiance(render_frame(RenderContext(half_covered(place), SETTINGS), STILL, columns, 4))
    passed = 1 - fresnel_reflectance(0.0, 1.0, 1.33)
    # Pixels are a cell wide, and so is what the edge is blurred by without; a finer one is a quarter as wide: the edge
    # is blurred by as much and lies within half of that of where it should.
    edges = np.linspace(-1, 1, columns + 1)
    exact = passed * np.clip((place * CELL - edges[:-1]) / np.diff(edges), 0, 1)
    assert np.abs(found.reshape(-1, columns).mean(axis=0) - exact).max() < passed * (1 / 16 + 1 / 8)


def test_finer_cells_fit_in_where_footprints_are_larger_than_pixels():
    columns = 512
    frame = render_frame(RenderContext(half_covered(0.45), SETTINGS), STILL, columns, 64)
    found = irradiance(frame).reshape(-1, columns)
    x = (np.arange(columns) + 0.5) / 256 - 1
    passed = 1 - fresnel_reflectance(0.0, 1.0, 1.33)
    # A B-spline reaches one and a half cells: beyond two from the edge, light is what it is without any.
    np.testing.assert_allclose(found[:, x < (0.45 - 2) * CELL], passed, rtol=1e-3)
    # Wide footprints are interpolated between squares of a third of a cell, which errs by .002 (docs/method.md).
    assert found.max() <= passed * (1 + 4e-3)


def test_finer_cells_start_at_places_of_their_own_along_either_side():
    cells = np.stack(np.meshgrid(np.arange(FINER), np.arange(FINER)), axis=-1).reshape(-1, 2)
    along = (cells + 0.5 + place_in_finer_cell(cells)) / FINER
    for axis in (0, 1):
        np.testing.assert_allclose(np.sort(along[:, axis]), (np.arange(FINER**2) + 0.5) / FINER**2, atol=1e-6)
    assert math.isclose(place_in_finer_cell(cells).sum(), 0.0, abs_tol=1e-5)


def test_few_photons_of_each_of_many_lights_send_as_much_through_a_ball_as_many_of_one():
    """Of a ball's silhouette, where light grazes, some cells send much of theirs and some little."""
    points, triangles, normals = shapes.sphere()
    points = 0.4 * points + np.array([0.0, 0.0, 0.6])
    ball = mesh("/ball", points, triangles, glass(), normals=normals)
    extent = Extent(ExtentShape.RECT, 0.0, np.array([[2e-3, 0.0, 0.0], [0.0, 1.5e-3, 0.0]]))
    lamp = LightAtShutter("/lamp", LightKind.POINT, (4.0, 4.0, 4.0), np.array([0.1, 0.05, 1.5]))
    lamp = replace(lamp, profile=EmissionProfile.COSINE, extent=extent)
    context = RenderContext(steady([floor(), ball], (lamp,), looking_down((-1, 1, -1, 1), height=0.1)), SETTINGS)
    settings = replace(SETTINGS, photons=1 << 16)
    many, one = (trace_frame(context.with_settings(replace(settings, light_splits=n)), STILL) for n in (91, 1))
    assert many.photons.ids.max() >= FIRST_PART * PART_IDS, "no cell at an edge is traced again"
    assert many.energy.sent == pytest.approx(one.energy.sent, rel=2e-3)
    assert many.energy.deposited == pytest.approx(one.energy.deposited, rel=2e-3)


def test_photons_of_finer_cells_at_any_instant_have_ids_of_their_own():
    """A board glides below the water along the edge of a shadow: there, light ends at an edge and in time."""
    still, gliding = quad("/board", (0.3, -9), (6, 9), 2.0), quad("/below", (-1, -0.6), (1, 0), 0.5, motion=(0, 0.4, 0))
    source = steady([floor(), WATER, still, gliding], (sun(),), looking_down((-1, 1, -1, 1), height=0.4))
    photons = trace_frame(RenderContext(source, replace(SETTINGS, photons=1 << 14)), Shutter(0, 0, 1)).photons
    parts = photons.ids // PART_IDS
    assert len(np.unique(photons.ids)) == len(photons) and photons.ids.min() >= 0
    assert np.any(parts >= FIRST_PART + FINER**2) and parts.max() < FIRST_PART + FINER**2 * (LAST_PART + 1)
    assert (FIRST_PART + FINER**2 * (LAST_PART + 1)) * PART_IDS < 2**63
