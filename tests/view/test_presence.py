"""Surfaces that are there in part, for the camera, for lights and for photons."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.view.scenes import SUN, looking_down, quad, steady
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import Interaction, Material, Shutter, Texture, Wrap
from tpdwarp.scene.requirements import requirements_of
from tpdwarp.settings import Settings
from usd_scenes.oracle.closed_forms import fresnel_reflectance

STILL = Shutter(0, 0, 0)
SIZE = 8
FLOOR = quad("/floor", (-2, -2), (2, 2), 0.0, Material(color=(0.8, 0.8, 0.8)))
RED = (0.6, 0.1, 0.2)
# Sums over a path of a few products in single precision.
ROUNDING = 1e-5


def render(meshes, camera=None, photons=4096, **settings):
    source = steady(meshes, (SUN,), camera or looking_down())
    frame = render_frame(
        RenderContext(source, Settings(samples=1, photons=photons, threads=1, **settings)), STILL, SIZE, SIZE
    )
    return np.stack([frame.channels[c] for c in "RGB"], axis=-1).astype(float), frame


def sheet(height=1.0, size=2.0, **material):
    return quad("/sheet", (-size, -size), (size, size), height, Material(**material))


def slab(**material):
    """Glass with faces at heights 1 and 1.5."""
    glass = Material(Interaction.DIELECTRIC, **material)
    top = quad("/slab", (-2, -2), (2, 2), 1.5, glass)
    bottom = quad("/slab", (-2, -2), (2, 2), 1.0, glass, up=False)
    return replace(
        top,
        points=np.concatenate([top.points, bottom.points]),
        triangles=np.concatenate([top.triangles, bottom.triangles + 4]).astype(np.int32),
    )


def middle(pixels):
    return pixels[2:-2, 2:-2]


def everywhere(pixels, expected, rtol=ROUNDING):
    np.testing.assert_allclose(pixels, np.broadcast_to(expected, pixels.shape), rtol=rtol)


@pytest.mark.parametrize("presence", [0.25, 0.9])
def test_a_sheet_that_is_there_in_part_shows_and_shades_in_part(presence):
    alone, uncovered = render([sheet(color=RED, presence=presence)])
    everywhere(alone, presence * np.array(RED) / math.pi)
    everywhere(uncovered.channels["A"], presence)
    found, frame = render([FLOOR, sheet(color=RED, presence=presence)])
    floor = 0.8 / math.pi * (1 - presence)
    everywhere(found, presence * np.array(RED) / math.pi + (1 - presence) * floor)
    assert (frame.channels["A"] == 1).all()


def test_sheets_shade_by_the_product_of_what_they_let_pass():
    sheets = [replace(sheet(0.5 + 0.1 * k, color=RED, presence=0.5), path=f"/{k}") for k in range(3)]
    below = replace(looking_down(), position=np.array([0.0, 0.0, 0.4]))
    found, _ = render([FLOOR, *sheets], below)
    everywhere(found, 0.8 / math.pi / 8)


@pytest.mark.parametrize("threshold", [0.0, 0.5])
def test_cut_outs_are_holes_for_camera_and_light(threshold):
    alpha = np.zeros((SIZE, SIZE, 3), np.float16)
    alpha[::2, 1::2] = alpha[1::2, ::2] = 1.0
    card = sheet(size=1.0, color=RED, threshold=threshold, cutout=Texture({(0, 0): alpha}, (Wrap.CLAMP, Wrap.CLAMP)))
    card = replace(card, coordinates=(card.points[:, :2] + 1) / 2, coordinate_indices=card.triangles)
    found, frame = render([FLOOR, card])
    there = alpha[..., :1] > 0.5
    # Pixels lie on texels. Light comes straight down, and the camera looks straight down.
    np.testing.assert_allclose(found, np.where(there, np.array(RED) / math.pi, 0.8 / math.pi), rtol=1e-3)
    np.testing.assert_allclose(
        render([FLOOR, card], aovs=("Z",))[1].channels["Z"], np.where(there[..., 0], 2.0, 3.0), rtol=1e-5
    )
    assert (frame.channels["A"] == 1).all()


def striped(height, periods, size):
    """A card with holes in stripes that are far finer than what looks at it, and the part of it that is there.

    Where 1/2 + 1/2 sin(2π x) is at least 3/10: 1/2 + arcsin(2/5)/π of each period.
    """
    x = (np.arange(8 * periods) + 0.5) / 8
    alpha = np.broadcast_to(0.5 + 0.5 * np.sin(2 * math.pi * x)[None, :, None], (8, len(x), 3)).astype(np.float16)
    card = sheet(height, size, color=RED, threshold=0.3, cutout=Texture({(0, 0): alpha}))
    card = replace(card, coordinates=(card.points[:, :2] / size + 1) / 2, coordinate_indices=card.triangles)
    return card, 0.5 + math.asin(0.4) / math.pi


# Linear between eight texels a period, the sine crosses .3 by up to so much of a period elsewhere, twice: its second
# derivative is at most 2π², by an eighth of the square of a texel, by the slope there, π √(1 − .4²).
STRIPES = 2 * (2 * math.pi**2 / 8**3) / (math.pi * math.sqrt(1 - 0.4**2))


def test_a_pixel_sees_the_part_of_a_fine_cut_out_that_is_there():
    card, part = striped(1.0, 4 * SIZE, 1.0)
    found, frame = render([card])
    everywhere(found, part * np.array(RED) / math.pi, rtol=STRIPES / part)
    everywhere(frame.channels["A"], part, rtol=STRIPES / part)


def test_photons_pass_the_holes_of_a_fine_cut_out_by_their_part():
    # Cells of sixteen rows are as wide as two periods.
    card, part = striped(1.8, 32, 2.0)
    below = replace(looking_down(), position=np.array([0.0, 0.0, 0.9]))
    found, _ = render([FLOOR, slab(ior=1.0), card], below, photons=256)
    everywhere(middle(found), 0.8 / math.pi * (1 - part), rtol=STRIPES / (1 - part))


def test_a_hole_over_nothing_is_no_coverage():
    card = sheet(size=1.0, threshold=0.5, cutout=Texture({(0, 0): np.zeros((2, 2, 3), np.float16)}))
    card = replace(card, coordinates=(card.points[:, :2] + 1) / 2, coordinate_indices=card.triangles)
    _, frame = render([card])
    assert (frame.channels["A"] == 0).all()


def test_photons_pass_what_is_not_there_and_land_on_what_is():
    clear = slab(ior=1.0)
    above = sheet(1.8, color=RED, presence=0.25)
    below = sheet(0.5, color=RED, presence=0.4)
    found, frame = render([FLOOR, clear, replace(above, path="/above"), replace(below, path="/below")])
    # From above: a quarter shows the sheet; what passes it meets glass of index one, then four tenths of the lower.
    passed = 0.75
    lower = passed * 0.4 * np.array(RED) / math.pi
    ground = passed * 0.6 * 0.8 / math.pi
    expected = 0.25 * np.array(RED) / math.pi + 0.75 * (0.4 * lower + 0.6 * ground)
    everywhere(middle(found), expected[None, None], rtol=1e-3)
    account = frame.energy
    # What stays on the upper sheet met no glass.
    assert account.deposited + account.escaped == pytest.approx(account.sent, rel=1e-5)


def test_a_dielectric_may_be_diffuse_in_part():
    share = 0.3
    mixed = slab(ior=1.0, color=RED, diffuse_share=share)
    found, frame = render([FLOOR, replace(mixed, points=mixed.points[:4], triangles=mixed.triangles[:2])])
    own, ground = share * np.array(RED) / math.pi, (1 - share) ** 2 * 0.8 / math.pi
    everywhere(middle(found), own + ground, rtol=1e-3)
    assert frame.energy.lost_total < 1e-4 * frame.energy.sent


@pytest.mark.parametrize("ior", [1.0, 1.5])
def test_absorption_within_a_slab_follows_beers_law(ior):
    absorption = (0.4, 1.0, 2.5)
    found, frame = render([FLOOR, slab(ior=ior, absorption=absorption)], photons=16384)
    left = np.exp(-0.5 * np.array(absorption))
    R = fresnel_reflectance(0.0, 1.0, ior) if ior > 1 else 0.0
    # Light through a slab, all orders of reflection within it; and the floor is seen through it.
    through = (1 - R) ** 2 * left / (1 - R**2 * left**2)
    # The fourth order of reflection, R⁴ < 3e-6, is given up.
    everywhere(middle(found), through**2 * 0.8 / math.pi, rtol=3e-3)
    account = frame.energy
    assert account.absorbed > 0.1 * account.sent
    assert account.deposited + account.escaped + account.absorbed + account.lost_total == pytest.approx(account.sent)


def test_a_tint_counts_at_each_refraction():
    tint = (0.9, 0.5, 0.2)
    found, frame = render([FLOOR, slab(ior=1.0, transmittance=tint)])
    everywhere(middle(found), np.array(tint) ** 4 * 0.8 / math.pi, rtol=1e-3)
    account = frame.energy
    assert account.deposited + account.escaped + account.absorbed + account.lost_total == pytest.approx(account.sent)


def test_a_surface_that_gives_off_light_is_seen_so_through_glass_too():
    glow = quad("/floor", (-2, -2), (2, 2), 0.0, Material(color=(0.8, 0.8, 0.8), emission=(5.0, 0.5, 0.0)))
    found, _ = render([glow])
    everywhere(found, 0.8 / math.pi + np.array([5.0, 0.5, 0.0]))
    through, _ = render([glow, slab(ior=1.0, transmittance=(0.5, 0.5, 0.5))])
    everywhere(middle(through), 0.25 * (0.25 * 0.8 / math.pi + np.array([5.0, 0.5, 0.0])), rtol=1e-3)


def test_whole_and_clear_scenes_require_none_of_this():
    needs = requirements_of(steady([FLOOR, slab(ior=1.5), sheet(color=RED)]).at(STILL))
    assert not (needs.partial or needs.tinted or needs.textures or needs.domes or needs.emission)
