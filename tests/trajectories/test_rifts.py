"""Laws of rifts: where bodies pass before one another, no light is missing and none shines twice."""

from __future__ import annotations

import numpy as np
import pytest

from tests.estimators.frames import OPEN, irradiance
from tests.photons.shapes import box, floor, glass, moving
from tests.photons.traced import sun
from tests.view.scenes import Source, looking_down, steady
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.settings import Settings
from tpdwarp.trajectories.rifts import LARGEST_DRIFT_APART, gradients, rift_cells

SETTINGS = Settings(photons=16384, segments=1, samples=1, aovs=("irradiance",))
WAY = 0.6
LOWER = box("/lower", (-2, -2, 0.5), (2, 2, 0.7), glass())


def plates(upper_end: float | None, way: float = 0.0) -> Source:
    """A plate of glass at rest under a sun; above it another that ends at ``upper_end`` and glides along x."""
    meshes = [floor(), LOWER]
    if upper_end is not None:
        upper = box("/upper", (-3, -2.5, 1.2), (upper_end, 2.5, 1.4), glass())
        meshes.append(moving(upper, (way, 0, 0)) if way else upper)
    return steady(meshes, (sun(),), looking_down((-1, 1, -0.125, 0.125), height=0.3))


def rendered(source: Source, columns: int) -> np.ndarray:
    frame = render_frame(RenderContext(source, SETTINGS), OPEN, columns, 8)
    return irradiance(frame).reshape(8, columns).mean(axis=0)


@pytest.mark.parametrize("way", [WAY, -WAY])
def test_light_between_plates_that_drift_apart_is_neither_missing_nor_there_twice(way):
    columns = 64
    one, two = (float(np.median(rendered(plates(end), 16))) for end in (None, 3.0))
    x = (np.arange(columns) + 0.5) / (columns / 2) - 1
    exact = one + (two - one) * np.clip(0.5 - x / WAY, 0, 1)
    found = rendered(plates(0.0, way), columns)
    # Cells that ride with their plates open a gap of half the way, and lie over one another as long.
    assert np.abs(found - exact).max() < 0.04 * one
    assert found.mean() == pytest.approx(exact.mean(), rel=5e-3)


def test_a_field_without_rifts_stays_as_it_is():
    u, v = np.meshgrid(np.arange(20.0), np.arange(30.0), indexing="ij")
    smooth = 0.9 * LARGEST_DRIFT_APART * np.stack([u, v], axis=-1) / np.sqrt(2.0)
    torn, field = rift_cells(smooth)
    assert not torn.any()
    np.testing.assert_array_equal(field, smooth)
    np.testing.assert_allclose(gradients(smooth)[5, 5], 0.9 * LARGEST_DRIFT_APART * np.eye(2) / np.sqrt(2.0))


@pytest.mark.parametrize("apart", [2.0, 7.0, -7.0])
def test_cells_along_the_field_never_pass_each_other(apart):
    field = np.zeros((60, 8, 2))
    field[30:, :, 0] = apart
    torn, smooth = rift_cells(field)
    ride = np.where(torn[..., None], smooth, field)
    for part in (-0.5, 0.5):
        edges = np.arange(60) + part * ride[:, 4, 0]
        # By a quarter of a cell at the most, to either end of the shutter.
        assert (np.diff(edges) > 0.74).all() and (np.diff(edges) < 1.26).all()
    np.testing.assert_allclose(np.linalg.det(np.eye(2) + 0.5 * gradients(ride))[1:-1].sum(), 8 * 58 + 4 * apart)


def test_the_field_is_that_of_the_bodies_away_from_rifts():
    field = np.zeros((60, 8, 2))
    field[30:, :, 0] = 5.0
    torn, smooth = rift_cells(field)
    np.testing.assert_array_equal(torn[:24].any(), False)
    np.testing.assert_allclose(smooth[:24], 0.0, atol=1e-12)
    np.testing.assert_allclose(smooth[36:, :, 0], 5.0)
