"""How far photons of one scene told twice may be from each other."""

from __future__ import annotations

import numpy as np

from tests.photons.traced import EPS, Traced

OPERATIONS = 400
"""Roundings between light and floor: about 100 an interaction, and four of them."""
EDGE = 0.97
"""Part of the photons that must agree: those nearer to an edge than rounding may meet the triangle beside it.

Steps are about 1/20 of an edge, so that one photon in 10⁴ comes as near as 10⁻⁵ of an edge; but at the rims of
solids the light grazes, and photons miss or hit by rounding alone. The rim of a body that k photons cross is
crossed by √k of them, and a few hundred hit.
"""


def common(one: Traced, other: Traced) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the photons that both have.

    Raises:
        AssertionError: Too many have no counterpart.
    """
    ids, here, there = np.intersect1d(one.photons.ids, other.photons.ids, return_indices=True)
    assert len(ids) >= EDGE * max(len(one.photons), len(other.photons))
    return here, there


def assert_same_photons(one: Traced, other: Traced, turn=None, shift=(0, 0, 0), scale=1.0, time=1.0, flux=1.0) -> None:
    """Whether ``other`` has the photons of ``one``, each point p at scale · turn p + shift, and D_t x ``time`` times.

    A rounding displaces a photon at the light by ε of the scene's size, and where it lands by that much times
    ∂x/∂x₀; columns change by that over an edge, across which normals turn: relatively to their size, by 10 times
    as much as positions do.
    """
    turn = np.eye(3) if turn is None else turn
    here, there = common(one, other)
    a, b = one.pick(here), other.pick(there)
    size = np.ptp(np.concatenate([mesh.points for mesh in one.scene.meshes]), axis=0).max()
    columns = np.linalg.norm(a.dxdu, axis=1) + np.linalg.norm(a.dxdv, axis=1)
    # A lattice step at the light, in scene units; distances to the light are about the size of the scene.
    step = min(min(lattice.step) for lattice in one.plan.lattices) * (
        1 / one.plan.normalization.scale if one.plan.lattices[0].axes is None else 1.0
    )
    stretch = 1 + columns / step
    bound = OPERATIONS * EPS * size * stretch
    expected = {
        "positions": scale * a.positions @ turn.T + shift,
        "dxdu": scale * a.dxdu @ turn.T,
        "dxdv": scale * a.dxdv @ turn.T,
        "dxdt": time * scale * a.dxdt @ turn.T,
    }
    for name, rows in expected.items():
        error = np.linalg.norm(getattr(b, name) - rows, axis=1) / scale
        limit = bound if name == "positions" else 10 * OPERATIONS * EPS * stretch * (
            np.linalg.norm(rows, axis=1) / scale + columns + np.linalg.norm(a.dxdt, axis=1)
        )
        agreeing = np.mean(error <= limit + 1e-12)
        assert agreeing >= EDGE, f"{name}: {agreeing:.1%} agree; {np.max(error / (limit + 1e-12)):.3g} at most"
    ratio = b.flux / np.where(a.flux > 0, flux * a.flux, 1.0)
    # Near the critical angle transmittance goes with the root of the distance from it.
    assert np.mean(np.abs(ratio[a.flux > 0] - 1) <= np.sqrt(OPERATIONS * EPS)) >= EDGE
