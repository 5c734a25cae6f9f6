"""What mirrors and glass have over their surface by textures, as the camera sees it, and what a surface gives off.

Pixels lie on texels, of which each shows its own. All scenes are seen by one kernel.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.view.scenes import looking_down, quad, see
from tpdwarp.scene.description import Interaction, Material, SceneAtShutter, Shutter, Texture, Wrap

SIZE = 8
STILL = Shutter.still(0.0)
NEEDED = {
    "refraction": True, "reflection": True, "textures": True, "partial": True, "tinted": True, "emission": True,
    "thin_walls": True, "rough": True, "specular_maps": True,
}  # fmt: skip
PIXELS = np.random.default_rng(11).uniform(0.1, 0.9, (SIZE, SIZE, 3)).astype(np.float16)
GREY = np.repeat(PIXELS[..., :1], 3, axis=2)
CLAMPED = Wrap.CLAMP, Wrap.CLAMP
# Positions and texture coordinates in single precision, times the steepest slope: 8 texels of .8 over two units.
POSITION = 1e-5 * SIZE
BLACK = (0.0, 0.0, 0.0)
SHINING = Material(color=BLACK, emission=(2.0, 2.0, 2.0))
CEILING = quad("/ceiling", (-9, -9), (9, 9), 5.0, SHINING, up=False)
FLOOR = quad("/floor", (-9, -9), (9, 9), 0.0, SHINING)


def card(material: Material, *others):
    """A square with texture coordinates, a pixel to a texel, and more meshes."""
    mesh = quad("/card", (-1, -1), (1, 1), 1.0, material)
    laid = replace(mesh, coordinates=(mesh.points[:, :2] + 1) / 2, coordinate_indices=mesh.triangles)
    return SceneAtShutter(STILL, (laid, *others), (), looking_down())


def film() -> np.ndarray:
    x, y = np.meshgrid(np.arange(SIZE) + 0.5, np.arange(SIZE) + 0.5)
    return np.stack([x.ravel(), y.ravel()], axis=1)


def shown(scene: SceneAtShutter) -> np.ndarray:
    """Radiance of each pixel, shape [SIZE, SIZE, 3]."""
    total = np.zeros((SIZE * SIZE, 3))
    for batch in see(scene, SIZE, SIZE, film(), **NEEDED):
        np.add.at(total, batch.items, batch.direct)
    return total.reshape(SIZE, SIZE, 3)


def texture(pixels: np.ndarray) -> Texture:
    return Texture({(0, 0): pixels}, CLAMPED)


def test_a_mirror_shows_what_it_reflects_by_its_texture():
    found = shown(card(Material(Interaction.MIRROR, texture=texture(PIXELS)), CEILING))
    np.testing.assert_allclose(found, 2.0 * PIXELS, atol=2 * POSITION)


def test_where_a_mirror_is_diffuse_it_reflects_nothing():
    mirror = Material(Interaction.MIRROR, (1.0, 1.0, 1.0), diffuse_map=texture(GREY))
    np.testing.assert_allclose(shown(card(mirror, CEILING)), 2.0 * (1.0 - GREY.astype(float)), atol=2 * POSITION)


def test_glass_shows_what_is_behind_it_by_the_texture_of_its_tint():
    sheet = Material(Interaction.DIELECTRIC, ior=1.0, thin_walled=True, transmittance_map=texture(PIXELS))
    np.testing.assert_allclose(shown(card(sheet, FLOOR)), 2.0 * PIXELS, atol=2 * POSITION)


def test_what_a_surface_gives_off_differs_over_it_as_its_texture_does():
    found = shown(card(Material(color=BLACK, emission_map=texture(PIXELS))))
    np.testing.assert_allclose(found, PIXELS, atol=POSITION)


def test_a_texture_of_roughness_turns_rays_as_that_roughness_does_everywhere():
    ends = []
    for roughness in (
        {"roughness": 0.0},
        {"roughness": 0.0625},
        {"roughness_map": texture(np.full((SIZE, SIZE, 3), 0.0625, np.float16))},
    ):
        sheet = Material(Interaction.DIELECTRIC, thin_walled=True, **roughness)
        first = see(card(sheet, FLOOR), SIZE, SIZE, film(), **NEEDED)[0]
        ends.append(first.positions)
    smooth, plain, mapped = ends
    assert np.abs(plain - smooth).max() > 0.01
    np.testing.assert_array_equal(mapped, plain)
