"""Nodes that compute values, against what the specification of MaterialX says of them, and Python's own colours."""

import colorsys

import numpy as np
import pytest

from tpdwarp.usd.read.materials.nodes import operation_of

COLORS = [(0.2, 0.5, 0.9), (0.9, 0.1, 0.1), (0.3, 0.3, 0.3), (0.7, 0.9, 0.0), (0.0, 0.0, 0.0)]


def computed(kind, **given):
    """What a node of this kind computes from these inputs, and its defaults for the others."""
    operation = operation_of(kind)
    assert set(given) <= {name for name, _ in operation.arguments}
    return operation.apply([np.atleast_1d(given.get(name, d)) for name, d in operation.arguments], "out", {})


@pytest.mark.parametrize(
    ("kind", "given", "expected"),
    [
        ("ND_smoothstep_float", {"in": 0.25}, 0.15625),
        ("ND_smoothstep_float", {"in": 3.0, "low": 1.0, "high": 2.0}, 1.0),
        ("ND_smoothstep_float", {"in": 1.0, "low": 1.0, "high": 1.0}, 1.0),
        ("ND_modulo_float", {"in1": -0.25}, 0.75),
        ("ND_fract_float", {"in": 2.75}, 0.75),
        ("ND_sign_float", {"in": -3.0}, -1.0),
        ("ND_round_float", {"in": 1.7}, 2.0),
        ("ND_sin_float", {"in": np.pi / 6}, 0.5),
        ("ND_acos_float", {"in": 0.0}, np.pi / 2),
        ("ND_safepower_float", {"in1": -2.0, "in2": 2.0}, -4.0),
        ("ND_magnitude_vector3", {"in": (2.0, 3.0, 6.0)}, 7.0),
        ("ND_dotproduct_vector3", {"in1": (1.0, 2.0, 3.0), "in2": (4.0, 5.0, 6.0)}, 32.0),
        ("ND_plus_float", {"bg": 0.25, "fg": 0.5, "mix": 0.5}, 0.5),
        ("ND_minus_float", {"bg": 0.75, "fg": 0.5}, 0.25),
        ("ND_difference_float", {"bg": 0.25, "fg": 0.75}, 0.5),
        ("ND_burn_float", {"bg": 0.5, "fg": 0.625}, 0.2),
        ("ND_dodge_float", {"bg": 0.2, "fg": 0.5}, 0.4),
        ("ND_screen_float", {"bg": 0.5, "fg": 0.5}, 0.75),
        ("ND_overlay_float", {"bg": 0.25, "fg": 0.5}, 0.25),
        ("ND_overlay_float", {"bg": 0.75, "fg": 0.5}, 0.75),
        ("arnold:flat", {"color": (0.1, 0.2, 0.3)}, (0.1, 0.2, 0.3)),
        ("arnold:clamp", {"input": 2.0, "max": 0.5}, 0.5),
    ],
)
def test_nodes_compute_what_their_definitions_say(kind, given, expected):
    np.testing.assert_allclose(computed(kind, **given), np.atleast_1d(expected), rtol=1e-12)


@pytest.mark.parametrize(
    ("output", "expected"),
    [("outColor", (0.5, 0.7, 0.9)), ("outColorG", 0.7), ("outAlpha", 0.25)],
)
def test_a_file_texture_of_mayas_scales_and_moves_colours(output, expected):
    operation = operation_of("MayaND_fileTexture_color4")
    given = [np.array([0.2, 0.3, 0.4, 0.25]), np.full(3, 2.0), np.full(3, 0.1)]
    np.testing.assert_allclose(operation.apply(given, output, {}), np.atleast_1d(expected), rtol=1e-12)


@pytest.mark.parametrize("color", COLORS)
def test_hues_are_those_of_python(color):
    np.testing.assert_allclose(computed("ND_rgbtohsv_color3", **{"in": color}), colorsys.rgb_to_hsv(*color), atol=1e-12)
    turned = colorsys.hsv_to_rgb(*color)
    np.testing.assert_allclose(computed("ND_hsvtorgb_color3", **{"in": color}), turned, atol=1e-12)
    hue, saturation, value = colorsys.rgb_to_hsv(*color)
    adjusted = computed("ND_hsvadjust_color3", **{"in": color, "amount": (0.3, 0.5, 2.0)})
    expected = colorsys.hsv_to_rgb((hue + 0.3) % 1.0, 0.5 * saturation, 2.0 * value)
    np.testing.assert_allclose(adjusted, expected, atol=1e-12)


def test_pictures_are_computed_as_numbers_are():
    picture = np.array(COLORS).reshape(1, 5, 3)
    by_pixel = [computed("ND_rgbtohsv_color3", **{"in": color}) for color in COLORS]
    found = operation_of("ND_rgbtohsv_color3").apply([picture], "out", {})
    np.testing.assert_array_equal(found[0], by_pixel)
