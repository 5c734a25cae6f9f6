"""The lobe of rough metal: against textbook forms, in a white furnace, and its directions against its density."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from tests.view.scenes import ONE_THREAD
from tpdwarp.view.ggx import ONCE, chance_of, lobe_at, mirrored_by_a_facet, reflected

WIDTHS = (0.05, 0.1, 0.3, 0.7, 1.0)
COSINES = (1.0, 0.7, 0.2)
NORMAL = np.array([0.6, 0.0, 0.8])


@wp.kernel(module="unique", enable_backward=False)
def _ask(
    base: int,
    n: wp.vec3,
    to_viewer: wp.vec3,
    alpha: float,
    color: wp.vec3,
    directions: wp.array(dtype=wp.vec3),
    places: wp.array(dtype=wp.vec2),
    seen: wp.array(dtype=wp.vec3),
    chances: wp.array(dtype=wp.float32),
    mirrored: wp.array(dtype=wp.vec3),
):
    i = base + wp.tid()
    lobe = lobe_at(n, to_viewer, alpha, color)
    seen[i] = reflected(lobe, directions[i])
    chances[i] = chance_of(lobe, directions[i])
    mirrored[i] = mirrored_by_a_facet(lobe, places[i])


def asked(viewer, alpha, color, directions, places=None):
    """What the kernel's functions say of directions [n, 3]: reflection [n, 3], density [n], and a facet's direction."""
    count = len(directions)
    places = np.zeros((count, 2)) if places is None else places
    out = [wp.zeros(count, dtype=kind, device="cpu") for kind in (wp.vec3, wp.float32, wp.vec3)]
    inputs = [wp.vec3(*NORMAL), wp.vec3(*viewer), alpha, wp.vec3(*color)]
    arrays = [wp.array(np.asarray(v, np.float32), dtype=t, device="cpu") for v, t in
              ((directions, wp.vec3), (places, wp.vec2))]  # fmt: skip
    ONE_THREAD(_ask, count, [*inputs, *arrays, *out])
    return [values.numpy().astype(float) for values in out]


def viewed_at(cosine: float) -> np.ndarray:
    """A direction at that cosine to the normal."""
    across = np.cross(NORMAL, [0.0, 1.0, 0.0])
    return cosine * NORMAL + np.sqrt(1 - cosine**2) * across


def textbook(viewer, alpha, color, w):
    """f cos θ_i as Heitz (2014) writes it, by angles."""
    i, o = w @ NORMAL, viewer @ NORMAL
    h = w + viewer
    h /= np.linalg.norm(h, axis=1, keepdims=True)
    tangent2 = 1 / (h @ NORMAL) ** 2 - 1
    density = 1 / (np.pi * alpha**2 * (h @ NORMAL) ** 4 * (1 + tangent2 / alpha**2) ** 2)
    lam = [0.5 * (np.sqrt(1 + alpha**2 * (1 / c**2 - 1)) - 1) for c in (i, o)]
    fresnel = np.asarray(color) + (1 - np.asarray(color)) * (1 - (h * w).sum(1))[:, None] ** 5
    return np.where((i > 0)[:, None], fresnel * (density / (1 + lam[0] + lam[1]) / (4 * o))[:, None], 0.0)


def albedo_once(cosine: float, alpha: float) -> float:
    """E by the table, linear in α and in μ (1 + α)/(μ + α)."""
    x, y = 10 * cosine * (1 + alpha) / (cosine + alpha), 10 * alpha
    table = np.array(ONCE).reshape(11, 11)
    i, j = min(int(x), 9), min(int(y), 9)
    a, b = x - i, y - j
    along = (1 - a) * table[:, i] + a * table[:, i + 1]
    return min(1.006 * float((1 - b) * along[j] + b * along[j + 1]), 1.0)


def sphere(count: int) -> tuple[np.ndarray, float]:
    """Directions spread evenly over the sphere (Fibonacci), and the solid angle of each."""
    k = np.arange(count) + 0.5
    z, turn = 1 - 2 * k / count, k * np.pi * (1 + 5**0.5)
    flat = np.sqrt(1 - z**2)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1), 4 * np.pi / count


@pytest.mark.parametrize("alpha", WIDTHS)
@pytest.mark.parametrize("cosine", COSINES)
def test_the_lobe_is_ggx_with_correlated_masking_and_schlicks_reflectance(alpha, cosine):
    viewer, color = viewed_at(cosine), (0.9, 0.5, 0.1)
    w, _ = sphere(5000)
    found = asked(viewer, alpha, color, w)[0]
    once = albedo_once(viewer @ NORMAL, alpha)
    gain = 1 + np.array(color) * (1 - once) / once
    # Single precision in D, which goes with the square of 1/(sin² θ_h + α²).
    np.testing.assert_allclose(found, gain * textbook(viewer, alpha, color, w), rtol=2e-4, atol=1e-6)


@pytest.mark.parametrize("alpha", [0.09, 0.16, 0.25, 0.45, 0.75, 1.0])
@pytest.mark.parametrize("cosine", [1.0, 0.85, 0.5, 0.3, 0.1])
def test_in_a_white_furnace_it_reflects_all_that_it_receives_and_no_more(alpha, cosine):
    w, solid_angle = sphere(400_000)
    seen = asked(viewed_at(cosine), alpha, (1.0, 1.0, 1.0), w)[0].sum(axis=0) * solid_angle
    # What white facets reflect at once is linear between a table's places.
    assert seen.min() > 0.975
    assert seen.max() < 1.0


def test_the_table_of_what_is_reflected_at_once_is_that_of_the_lobe():
    for row, column in ((1, 3), (3, 9), (6, 4), (9, 10), (10, 6)):
        alpha, x = 0.1 * row, 0.1 * column
        cosine = min(x * alpha / (1 + alpha - x), 1.0)
        w, solid_angle = sphere(400_000)
        once = textbook(viewed_at(cosine), alpha, (1.0, 1.0, 1.0), w)[:, 0].sum() * solid_angle
        assert ONCE[11 * row + column] == pytest.approx(once, abs=2e-3)


@pytest.mark.parametrize("alpha", WIDTHS)
@pytest.mark.parametrize("cosine", COSINES)
def test_facets_mirror_as_often_to_a_direction_as_its_density_says(alpha, cosine):
    viewer = viewed_at(cosine)
    w, solid_angle = sphere(400_000)
    k = np.arange(1 << 16)
    places = np.stack([(k + 0.5) / len(k), (k * 0.6180339887498949) % 1.0], axis=1)
    directions = asked(viewer, alpha, (1.0, 1.0, 1.0), np.broadcast_to(NORMAL, (len(k), 3)), places)[2]
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-5)
    chances = asked(viewer, alpha, (1.0, 1.0, 1.0), w)[1] * solid_angle
    above = directions @ NORMAL > 0
    # Moments of both; a lattice of 65 536 places errs by far less than a hundredth.
    assert above.mean() == pytest.approx(chances.sum(), abs=4e-3)
    np.testing.assert_allclose(np.where(above[:, None], directions, 0).mean(axis=0), chances @ w, atol=4e-3)
    second = np.einsum("ni,nj,n->ij", w, w, chances)
    np.testing.assert_allclose(np.einsum("ni,nj,n->ij", directions, directions, above) / len(k), second, atol=4e-3)


def test_a_surface_seen_from_behind_its_interpolated_normal_is_seen_at_grazing():
    behind = viewed_at(0.2) - 0.5 * NORMAL
    w, solid_angle = sphere(100_000)
    seen = asked(behind / np.linalg.norm(behind), 0.3, (1.0, 1.0, 1.0), w)[0]
    assert np.isfinite(seen).all()
    assert (seen.sum(axis=0) * solid_angle).max() < 1.01
