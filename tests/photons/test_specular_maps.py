"""What mirrors and glass have over their surface by textures: their share, tint and roughness, as photons meet them.

All of them are traced by one kernel. A photon stands for the cell of its lattice, so that a texture counts by its mean
over the cell; of a texture that rises in a line that is its value in the middle.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.photons.shapes import DIFFUSE, MIRROR, floor, glass, quad
from tests.photons.traced import Traced, scene_of, sun, traced
from tpdwarp.scene.description import MeshAtShutter, Texture, Wrap
from tpdwarp.scene.requirements import requirements_of

NEEDED = {"refraction": True, "reflection": True, "tinted": True, "partial": True, "rough": True, "specular_maps": True}
CLAMPED = Wrap.CLAMP, Wrap.CLAMP
TEXELS = 64
# The middle of each texel of a row, from s = 0.
PLACES = (np.arange(TEXELS) + 0.5) / TEXELS
# Half precision of numbers up to one.
HALF = 2.0**-11


def rising(*channels: float) -> Texture:
    """A picture that rises along s from nothing to these."""
    row = PLACES[None, :, None] * np.array(channels)
    return Texture({(0, 0): np.repeat(row, TEXELS, axis=0).astype(np.float16)}, CLAMPED)


def laid(mesh: MeshAtShutter) -> MeshAtShutter:
    """A quad of sides ±1 with texture coordinates from its corner."""
    return replace(mesh, coordinates=(mesh.points[:, :2] + 1) / 2, coordinate_indices=mesh.triangles)


def cell(result: Traced) -> float:
    return float(np.linalg.norm(np.cross(*result.steps.T)))


def inner(result: Traced) -> tuple[np.ndarray, np.ndarray]:
    """Rows of photons that take no branch and whose cells lie away from the edges, and s where they met the quad."""
    s = (result.origins()[:, 0] + 1) / 2
    rows = np.flatnonzero((result.masks == 0) & (s > 0.15) & (s < 0.85))
    assert len(rows) > 100
    return rows, s[rows]


def reflected(material, photons=1024) -> Traced:
    """A mirror under a vertical sun, which shines through the wall that what is reflected falls on."""
    wall = quad("/wall", (0, 0, 2), (9, 0, 0), (0, -9, 0), DIFFUSE)
    plate = laid(floor(1.0, 1.0, material, "/plate"))
    scene = scene_of((wall, plate), replace(sun((0, 0, -1)), passed=frozenset({"/wall"})))
    return traced(scene, photons, **NEEDED, linked=True)


@pytest.fixture(scope="module")
def mirror() -> Traced:
    maps = {"texture": rising(1.0, 0.5, 0.25), "diffuse_map": rising(0.5, 0.5, 0.5)}
    return reflected(replace(MIRROR, **maps, roughness_map=rising(0.1, 0.1, 0.1)))


def test_a_mirror_reflects_by_its_texture_where_it_is_not_diffuse(mirror):
    rows, s = inner(mirror)
    expected = cell(mirror) * ((1 - 0.5 * s) * s)[:, None] * (1.0, 0.5, 0.25)
    np.testing.assert_allclose(mirror.photons.flux[rows], expected, rtol=4 * HALF)


def test_what_is_rough_here_and_smooth_there_spreads_light_by_its_width_there(mirror):
    rows, s = inner(mirror)
    plain = reflected(replace(MIRROR, roughness=0.1), photons=64)
    one = np.linalg.norm(plain.photons.dxda[0])
    np.testing.assert_allclose(np.linalg.norm(mirror.photons.dxda[rows], axis=1), one * s, rtol=4 * HALF)


def test_flux_of_surfaces_with_textures_adds_up(mirror):
    energy = mirror.energy
    whole = energy.deposited + energy.escaped + energy.absorbed + energy.lost_total
    # The mean of 1 − s/2 over the plate is what the light meets of a mirror.
    assert energy.sent == pytest.approx(3 * 4 * 0.75, rel=1e-3)
    assert whole == pytest.approx(energy.sent, rel=1e-5) and energy.absorbed > 0


def test_a_texture_finer_than_cells_counts_by_its_mean():
    stripes = np.zeros((TEXELS, TEXELS, 3), np.float16)
    stripes[:, ::2] = 1.0
    result = reflected(replace(MIRROR, texture=Texture({(0, 0): stripes})), photons=64)
    rows = np.flatnonzero(result.masks == 0)
    np.testing.assert_allclose(result.photons.flux[rows], 0.5 * cell(result), rtol=4 * HALF)


def test_glass_passes_light_by_the_texture_of_its_tint():
    sheet = laid(floor(1.0, 1.0, replace(glass(1.0), transmittance_map=rising(1.0, 0.5, 0.25)), "/sheet"))
    result = traced(scene_of((floor(half=9.0), sheet), sun((0, 0, -1))), 1024, **NEEDED, linked=True)
    rows, s = inner(result)
    np.testing.assert_allclose(result.photons.flux[rows], cell(result) * s[:, None] * (1.0, 0.5, 0.25), rtol=4 * HALF)


def test_only_textures_of_what_is_specular_are_looked_up_by_photons():
    plain = floor(half=9.0, material=replace(DIFFUSE, texture=rising(1.0, 1.0, 1.0)))
    needs = requirements_of(scene_of((laid(plain), floor(1.0, 1.0, glass(), "/sheet")), sun((0, 0, -1))))
    assert needs.textures and not needs.specular_maps
    bare = floor(1.0, 1.0, replace(MIRROR, texture=rising(1.0, 1.0, 1.0)), "/plate")
    assert not requirements_of(scene_of((bare,), sun((0, 0, -1)))).specular_maps
    assert requirements_of(scene_of((laid(bare),), sun((0, 0, -1)))).specular_maps
