"""Outlines of footprints against the areas and hulls of swept ellipses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.usd.write.test_debug_layer import photons
from tpdwarp.usd.write.outlines import COARSE, FINE, footprint_outlines, swept_outlines

CORNERS = pytest.mark.parametrize("corners", [FINE, COARSE])


def shoelace(polygons: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Signed areas of planar polygons, shape [n, k, 3], seen against ``normals``."""
    crosses = np.cross(polygons, np.roll(polygons, -1, axis=1)).sum(axis=1)
    return 0.5 * np.einsum("ni,ni->n", crosses, normals)


@CORNERS
def test_footprint_outline_has_the_area_of_its_inscribed_polygon(corners: int) -> None:
    record, smoothing = photons(), 1.5
    polygons = footprint_outlines(record, smoothing, corners) - record.positions[:, None]
    cells = np.linalg.norm(np.cross(record.dxdu, record.dxdv), axis=1) * smoothing**2
    inscribed = np.sin(2 * np.pi / corners) / (2 * np.pi / corners)
    np.testing.assert_allclose(np.abs(shoelace(polygons, record.normals)), np.pi / 4 * cells * inscribed, rtol=1e-9)


def test_footprint_outline_touches_the_sides_of_the_cell() -> None:
    record = photons()
    polygons = footprint_outlines(record, 1.0) - record.positions[:, None]
    for place, axis in ((0, record.dxdu), (FINE // 4, record.dxdv)):
        np.testing.assert_allclose(polygons[:, place], 0.5 * axis, atol=1e-12)


def test_light_of_some_extent_widens_outlines_by_its_variance() -> None:
    """The area of an ellipse is the root of the determinant of its variance, which those of both add up to."""
    record, smoothing = photons(), 1.5
    half = len(record.dxdu) // 2
    a, b = 0.7 * record.dxdv + 0.2 * record.dxdu, 0.4 * record.dxdu
    a[:half], b[:half] = 0.0, 0.0
    plain = footprint_outlines(record, smoothing) - record.positions[:, None]
    lit = footprint_outlines(replace(record, dxda=a, dxdb=b), smoothing) - record.positions[:, None]
    np.testing.assert_array_equal(lit[:half], plain[:half])
    # In units of D_u x and D_v x.
    variance = smoothing**2 * np.eye(2) + np.outer([0.2, 0.7], [0.2, 0.7]) + np.outer([0.4, 0.0], [0.4, 0.0])
    larger = np.sqrt(np.linalg.det(variance)) / smoothing**2
    areas = [np.abs(shoelace(polygons[half:], record.normals[half:])) for polygons in (plain, lit)]
    np.testing.assert_allclose(areas[1], larger * areas[0], rtol=1e-9)


@CORNERS
def test_swept_outline_is_an_ellipse_longer_by_the_motion(corners: int) -> None:
    """Area of the sweep of a convex polygon: its own, and its width across the motion times the motion's length."""
    record, smoothing = photons(), 1.5
    polygons = swept_outlines(record, smoothing, corners) - record.positions[:, None]
    cells = np.cross(record.dxdu, record.dxdv) * smoothing**2
    step = np.pi / (corners // 2)
    still = np.pi / 4 * np.linalg.norm(cells, axis=1) * np.sin(step) / step
    # Half the ellipse's width across the motion is the support function of its two semi-axes.
    across = np.cross(record.normals, record.dxdt)
    u, v = (0.5 * smoothing * np.einsum("ni,ni->n", axis, across) for axis in (record.dxdu, record.dxdv))
    swept = 2 * np.hypot(u, v)
    np.testing.assert_allclose(np.abs(shoelace(polygons, record.normals)), still + swept, rtol=1e-9)


def signed_distances(polygons: np.ndarray, normals: np.ndarray, points: np.ndarray) -> np.ndarray:
    """For each polygon the least, over its edges, of how far its points lie inside; shape [n]."""
    polygons = np.where((shoelace(polygons, normals) < 0)[:, None, None], polygons[:, ::-1], polygons)
    edges = np.roll(polygons, -1, axis=1) - polygons
    inward = np.cross(normals[:, None], edges)
    lengths = np.linalg.norm(inward, axis=-1, keepdims=True)
    inward /= np.where(lengths > 1e-9, lengths, np.inf)
    offsets = points[:, None] - polygons[:, :, None]
    return np.einsum("nekc,nec->nek", offsets, inward).min(axis=(1, 2))


@CORNERS
@pytest.mark.parametrize("motion", [0.0, 1e-3, 1.0, 100.0])
def test_swept_outline_is_convex_and_holds_the_ellipse_at_every_time(motion: float, corners: int) -> None:
    record = replace(photons(), positions=np.zeros((64, 3)))
    record = replace(record, dxdt=motion * record.dxdt)
    polygons = swept_outlines(record, 1.0, corners)
    tolerance = 1e-12 * (1 + np.linalg.norm(record.dxdt, axis=1).max())
    assert signed_distances(polygons, record.normals, polygons).min() > -tolerance
    # A polygon inscribed in the half ellipse holds the ellipse shrunk by the cosine of half its step.
    angles = np.linspace(0, 2 * np.pi, 101)
    shrunk = 0.5 * np.cos(np.pi / corners)
    ellipse = shrunk * (np.cos(angles)[:, None] * record.dxdu[:, None] + np.sin(angles)[:, None] * record.dxdv[:, None])
    for time in (-0.5, 0.0, 0.5):
        assert signed_distances(polygons, record.normals, ellipse + time * record.dxdt[:, None]).min() > -tolerance


def test_swept_outline_of_a_collapsed_footprint_is_a_parallelogram() -> None:
    """At a fold D_u x and D_v x are parallel; the ellipse is a segment of half length |(a, b)|."""
    record = photons()
    along = record.dxdu / np.linalg.norm(record.dxdu, axis=1, keepdims=True)
    record = replace(record, dxdu=2.0 * along, dxdv=-1.5 * along, positions=np.zeros((64, 3)))
    polygons = swept_outlines(record, 1.0)
    half_length = 0.5 * np.hypot(2.0, 1.5)
    expected = 2 * half_length * np.linalg.norm(np.cross(along, record.dxdt), axis=1)
    np.testing.assert_allclose(np.abs(shoelace(polygons, record.normals)), expected, rtol=1e-9)


def test_outlines_of_nothing_are_points() -> None:
    zero = np.zeros((64, 3))
    record = replace(photons(), dxdu=zero, dxdv=zero, dxdt=zero)
    for outline in (footprint_outlines(record, 1.0), swept_outlines(record, 1.0)):
        np.testing.assert_array_equal(outline, np.broadcast_to(record.positions[:, None], outline.shape))
