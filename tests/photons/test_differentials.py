"""The algebra alone, one column at a time, against float64 finite differences of the optics it differentiates.

The functions work in float32. Inputs are exactly representable, so that a result of order one is off by its own
operations only: a few dozen, each by half a unit in the last place.
"""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.photons.differentials import (
    fresnel_reflectance,
    normal_differential,
    reflect,
    reflect_differential,
    refract,
    refract_differential,
    refracted_cosine_squared,
    riding_shift,
    transfer,
)
from usd_scenes.oracle.optics import reflectance, reflected, refracted

from .traced import EPS

COUNT = 64
ROUNDING = 40 * EPS
"""Forty operations on numbers of order one."""


@wp.kernel(enable_backward=False)
def algebra(
    dxda: wp.array(dtype=wp.vec3),
    dwda: wp.array(dtype=wp.vec3),
    w: wp.array(dtype=wp.vec3),
    n: wp.array(dtype=wp.vec3),
    dnda: wp.array(dtype=wp.vec3),
    motion: wp.array(dtype=wp.vec3),
    distance: float,
    eta: float,
    length: float,
    out: wp.array2d(dtype=wp.vec3),
):
    i = wp.tid()
    cos_t_squared = refracted_cosine_squared(-wp.dot(w[i], n[i]), eta)
    cos_t = wp.sqrt(wp.max(cos_t_squared, 0.0))
    shift = riding_shift(dxda[i], dwda[i], n[i], motion[i])
    out[i, 0] = transfer(dxda[i], dwda[i], w[i], distance, n[i], motion[i])
    out[i, 1] = normal_differential(n[i], length, dnda[i])
    out[i, 2] = reflect(w[i], n[i])
    out[i, 3] = reflect_differential(w[i], n[i], dwda[i], dnda[i])
    out[i, 4] = refract(w[i], n[i], eta, cos_t)
    out[i, 5] = refract_differential(w[i], n[i], eta, cos_t, dwda[i], dnda[i])
    out[i, 6] = wp.vec3(shift[0], shift[1], cos_t_squared)
    out[i, 7] = wp.vec3(fresnel_reflectance(-wp.dot(w[i], n[i]), cos_t, eta), 0.0, 0.0)


class Case:
    """Random beams that meet random surfaces at 60° or less, and what the algebra makes of them."""

    def __init__(self, eta: float = 0.75, distance: float = 1.5, length: float = 0.5, **given: np.ndarray) -> None:
        random = np.random.default_rng(5)

        def directions(count: int) -> np.ndarray:
            vectors = random.normal(size=(count, 3))
            return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)

        n = directions(4 * COUNT)
        w = directions(4 * COUNT)
        facing = np.einsum("ij,ij->i", w, n) < -0.5
        columns = {
            "dxda": random.uniform(-1, 1, (COUNT, 3)),
            "dwda": random.uniform(-1, 1, (COUNT, 3)),
            "w": w[facing][:COUNT],
            "n": n[facing][:COUNT],
            "dnda": random.uniform(-1, 1, (COUNT, 3)),
            "motion": random.uniform(-1, 1, (COUNT, 3)),
            **given,
        }
        count = min(len(values) for values in columns.values())
        self.__dict__.update({name: values[:count].astype(np.float32) for name, values in columns.items()})
        launcher = Launcher("cpu", 1)
        out = wp.zeros((count, 8), dtype=wp.vec3, device="cpu")
        inputs = [launcher.array(getattr(self, name), wp.vec3) for name in columns]
        wp.launch(algebra, dim=count, inputs=[*inputs, distance, eta, length, out], device="cpu")
        for name, values in list(self.__dict__.items()):
            self.__dict__[name] = values.astype(np.float64)
        self.count, self.eta, self.distance, self.length = count, np.full(count, eta), distance, length
        names = ("moved", "dn", "mirrored", "dmirrored", "bent", "dbent", "shift", "fresnel")
        self.__dict__.update(zip(names, out.numpy().astype(np.float64).transpose(1, 0, 2), strict=True))


def difference(function, h: float = 1e-4) -> np.ndarray:
    """Fourth-order central difference at 0: error h⁴, rounding 1e-16/h; both below 1e-11."""
    return (8 * (function(h) - function(-h)) - (function(2 * h) - function(-2 * h))) / (12 * h)


@pytest.fixture(scope="module")
def case() -> Case:
    return Case()


def test_transfer_lands_on_the_plane_that_has_moved(case):
    def landing(h):
        origin, direction = h * case.dxda, case.w + h * case.dwda
        on_plane = case.distance * case.w + h * case.motion
        gap = np.einsum("ij,ij->i", case.n, on_plane - origin) / np.einsum("ij,ij->i", case.n, direction)
        return origin + gap[:, None] * direction

    # Division by |n·ω| ≥ 0.5 doubles, the distance multiplies.
    np.testing.assert_allclose(case.moved, difference(landing), atol=4 * ROUNDING * case.distance)


def test_transferred_columns_lie_in_the_tangent_plane_plus_its_motion(case):
    off = np.einsum("ij,ij->i", case.n, case.moved - case.motion)
    np.testing.assert_allclose(off, 0, atol=4 * ROUNDING * case.distance)


def test_the_differential_of_a_unit_normal_is_that_of_its_direction(case):
    def normal(h):
        N = case.length * case.n + h * case.dnda
        return N / np.linalg.norm(N, axis=1, keepdims=True)

    np.testing.assert_allclose(case.dn, difference(normal), atol=ROUNDING / case.length)


def test_reflection_and_its_differential(case):
    np.testing.assert_allclose(case.mirrored, reflected(case.w, case.n), atol=ROUNDING)
    expected = difference(lambda h: reflected(case.w + h * case.dwda, case.n + h * case.dnda))
    np.testing.assert_allclose(case.dmirrored, expected, atol=4 * ROUNDING)


@pytest.mark.parametrize("eta", [0.75, 1.0, 1.125])
def test_refraction_and_its_differential(eta):
    case = Case(eta=eta)
    # Where the arguments leave the unit sphere the paper's form is one of many extensions: stay on it.
    w, n = (np.array(getattr(case, name)) for name in ("w", "n"))
    tangent = {
        "dwda": case.dwda - np.einsum("ij,ij->i", case.dwda, w)[:, None] * w,
        "dnda": case.dnda - np.einsum("ij,ij->i", case.dnda, n)[:, None] * n,
    }
    case = Case(eta=eta, **tangent)

    def bent(h):
        direction, normal = case.w + h * case.dwda, case.n + h * case.dnda
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        return refracted(direction, normal, case.eta)

    np.testing.assert_allclose(case.bent, bent(0.0), atol=4 * ROUNDING)
    # cosθ_t ≥ √(1 − η²·¾): 0.22 at the least here, which enters squared.
    np.testing.assert_allclose(case.dbent, difference(bent), atol=16 * ROUNDING)


def test_an_index_of_one_lets_light_pass():
    case = Case(eta=1.0)
    np.testing.assert_allclose(case.bent, case.w, atol=4 * ROUNDING)
    np.testing.assert_allclose(case.dbent, case.dwda, atol=16 * ROUNDING)
    np.testing.assert_allclose(case.fresnel[:, 0], 0, atol=ROUNDING**2)


def test_beyond_the_critical_angle_the_refracted_cosine_is_imaginary():
    degrees = np.radians([0.0, 41.8, 41.82, 60.0])
    w = np.stack([np.sin(degrees), np.zeros(4), -np.cos(degrees)], axis=1)
    case = Case(eta=1.5, w=w, n=np.tile([0.0, 0.0, 1.0], (4, 1)))
    np.testing.assert_allclose(case.shift[:, 2], 1 - 2.25 * np.sin(degrees) ** 2, atol=ROUNDING)
    assert (case.shift[:, 2] > 0).tolist() == [True, True, False, False]


@pytest.mark.parametrize("eta", [1 / 1.5, 1.125])
def test_fresnel_reflectance_is_that_of_unpolarised_light(eta):
    case = Case(eta=eta)
    cos_i = -np.einsum("ij,ij->i", case.w, case.n)
    # n and ω are rounded, so that cosθ_i² is off by 2 EPS and cosθ_t by that over 2 cosθ_t.
    np.testing.assert_allclose(case.fresnel[:, 0], reflectance(cos_i, np.full(case.count, np.float32(eta))),
                               atol=4 * ROUNDING)


def test_normal_incidence_on_glass_reflects_four_hundredths():
    down = np.array([[0.0, 0.0, -1.0]])
    case = Case(eta=1 / 1.5, w=down, n=-down)
    assert case.fresnel[0, 0] == pytest.approx(0.04, abs=4 * EPS)


def test_the_riding_shift_slides_along_the_surface_to_the_material_point(case):
    a, b = case.shift[:, 0], case.shift[:, 1]
    reached = a[:, None] * case.dxda + b[:, None] * case.dwda
    missed = case.motion - reached
    # Only the tangential part can be reached; the conditioning is that of the parallelogram.
    across = np.cross(case.dxda, case.dwda)
    area = np.abs(np.einsum("ij,ij->i", case.n, across))
    tangential = missed - np.einsum("ij,ij->i", missed, case.n)[:, None] * case.n
    error = np.linalg.norm(tangential, axis=1)
    assert (area > 1e-3).sum() > COUNT / 2
    tolerance = ROUNDING * (1 + 9 / area)
    assert (error <= tolerance).all()


def test_the_riding_shift_is_zero_where_light_grazes_the_surface():
    along = np.array([[1.0, 0.0, 0.0]])
    case = Case(
        dxda=along,
        dwda=np.array([[1.0, 0.0, 1.0]]),
        n=np.array([[0.0, 0.0, 1.0]]),
        w=np.array([[0.0, 0.0, -1.0]]),
        motion=np.array([[0.2, 0.3, 0.0]]),
    )
    assert case.shift[0, :2].tolist() == [0, 0]
