"""Patterns that nodes draw over a surface, against what their definitions say of places on it."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Gf, Sdf, UsdGeom, UsdShade

from tests.usd.stages import SmallStage, mesh_named, set_inputs
from tpdwarp.scene.description import Shutter, Wrap

TYPES = Sdf.ValueTypeNames
CORNERS = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))
RED, BLUE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
# A texel of 256, whose value is that of its middle, and half precision.
TEXEL = 1 / 512 + 2.0**-11
KNOTS = ([0.0, 0.25, 1.0], [RED, (0.0, 1.0, 0.0), BLUE])


@pytest.fixture
def small(tmp_path):
    return SmallStage(tmp_path)


def node(small, kind, **given):
    made = UsdShade.Shader.Define(small.stage, "/Material/Pattern")
    made.CreateIdAttr(kind)
    for name, value in given.items():
        if name == "position":
            made.CreateInput(name, TYPES.FloatArray).Set(value)
        elif name == "color":
            made.CreateInput(name, TYPES.Color3fArray).Set([Gf.Vec3f(*color) for color in value])
        elif name == "interpolation":
            made.CreateInput(name, TYPES.IntArray).Set(value)
        elif name == "uvtiling":
            made.CreateInput(name, TYPES.Float2).Set(Gf.Vec2f(*value))
        else:
            set_inputs(made, **{name: value})
    return made


def drawn(small, kind, **given):
    """Base colour of a quad by texture coordinates: what looks it up at (s, t), and what is said."""
    material = UsdShade.Material.Define(small.stage, "/Material")
    surface = UsdShade.Shader.Define(small.stage, "/Material/Surface")
    surface.CreateIdAttr("ND_standard_surface_surfaceshader")
    pattern = node(small, kind, **given)
    surface.CreateInput("base_color", TYPES.Color3f).ConnectToSource(pattern.ConnectableAPI(), "out")
    material.CreateSurfaceOutput("mtlx").ConnectToSource(surface.ConnectableAPI(), "out")
    mesh = small.mesh()
    coordinates = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", TYPES.TexCoord2fArray, "vertex")
    coordinates.Set([Gf.Vec2f(*corner) for corner in CORNERS])
    small.bind(mesh, "/Material")
    source = small.open()
    found = mesh_named(source.at(Shutter.still(1)), "/Mesh")
    said = [message for message in source.warnings.messages if "/Material" in message]
    texture = found.materials[0].texture
    if texture is None:
        return found.materials[0].color, said
    (pixels,) = texture.tiles.values()
    corners = found.coordinates[found.coordinate_indices.ravel()]
    points = found.points[found.triangles.ravel()][:, :2]
    affine = np.linalg.lstsq(np.column_stack([points, np.ones(len(points))]), corners, rcond=None)[0]

    def at(s, t):
        place = np.array([s, t, 1.0]) @ affine
        if texture.wrap[0] == Wrap.REPEAT:
            place %= 1.0
        column, row = (min(int(part * 256), 255) for part in (place[0], 1.0 - place[1]))
        return pixels[row, column].astype(float)

    return at, said


@pytest.mark.parametrize(
    ("kind", "place"),
    [
        ("u", lambda s, t: s),
        ("v", lambda s, t: t),
        ("diagonal", lambda s, t: (s + t) / 2),
        ("circular", lambda s, t: np.hypot(s - 0.5, t - 0.5) * np.sqrt(2)),
        ("", lambda s, t: t),
    ],
)
def test_a_ramp_of_arnolds_goes_from_knot_to_knot(small, kind, place):
    at, said = drawn(small, "arnold:ramp_rgb", position=KNOTS[0], color=KNOTS[1], **({"type": kind} if kind else {}))
    assert said == []
    for s, t in ((0.1, 0.2), (0.2, 0.7), (0.9, 0.4)):
        expected = [np.interp(place(s, t), KNOTS[0], np.array(KNOTS[1])[:, k]) for k in range(3)]
        # Between the first two knots values change by 4 a unit, which circles cross by √2.
        np.testing.assert_allclose(at(s, t), expected, atol=4 * np.sqrt(2) * TEXEL)


def test_a_ramp_that_holds_its_values_has_steps(small):
    at, _ = drawn(small, "arnold:ramp_rgb", type="u", position=KNOTS[0], color=KNOTS[1], interpolation=[0, 0, 0])
    np.testing.assert_array_equal([at(0.2, 0.5), at(0.3, 0.5), at(0.9, 0.5)], [RED, (0, 1, 0), (0, 1, 0)])


def test_a_ramp_of_a_number_gives_its_value_there(small):
    found, said = drawn(small, "arnold:ramp_rgb", type="custom", input=0.125, position=KNOTS[0], color=KNOTS[1])
    assert said == [] and found == pytest.approx((0.5, 0.5, 0.0))


@pytest.mark.parametrize(
    ("kind", "given", "expected"),
    [
        ("ND_ramplr_color3", {"valuel": RED, "valuer": BLUE}, lambda s, t: (1 - s, 0, s)),
        ("ND_ramptb_color3", {"valuet": RED, "valueb": BLUE}, lambda s, t: (t, 0, 1 - t)),
        ("ND_ramp4_color3", {"valuetl": RED, "valuebr": BLUE}, lambda s, t: (t * (1 - s), 0, s * (1 - t))),
        ("ND_splitlr_color3", {"valuel": RED, "valuer": BLUE, "center": 0.3}, lambda s, t: RED if s < 0.3 else BLUE),
        ("ND_splittb_color3", {"valuet": RED, "valueb": BLUE}, lambda s, t: RED if t > 0.5 else BLUE),
        (
            "ND_checkerboard_color3",
            {"color1": RED, "color2": BLUE, "uvtiling": (4.0, 2.0)},
            lambda s, t: RED if (int(4 * s) + int(2 * t)) % 2 == 0 else BLUE,
        ),
        (
            "arnold:checkerboard",
            {"color1": RED, "color2": BLUE, "u_frequency": 2.0, "v_frequency": 1.0},
            lambda s, t: RED if (int(4 * s) + int(2 * t)) % 2 == 0 else BLUE,
        ),
    ],
)
def test_patterns_are_what_their_definitions_say(small, kind, given, expected):
    at, said = drawn(small, kind, **given)
    assert said == []
    for s, t in ((0.1, 0.2), (0.35, 0.2), (0.1, 0.8), (0.9, 0.9)):
        np.testing.assert_allclose(at(s, t), expected(s, t), atol=TEXEL)


def test_a_pattern_in_the_place_of_a_surface_is_seen_as_it_is(small):
    material = UsdShade.Material.Define(small.stage, "/Material")
    pattern = node(small, "arnold:checkerboard", color1=RED, color2=BLUE)
    material.CreateSurfaceOutput("arnold").ConnectToSource(pattern.ConnectableAPI(), "out")
    small.bind(small.mesh(), "/Material")
    found = mesh_named(small.open().at(Shutter.still(1)), "/Mesh").materials[0]
    (pixels,) = found.emission_map.tiles.values()
    assert found.color == (0.0, 0.0, 0.0) and {tuple(row) for row in pixels.reshape(-1, 3)} == {RED, BLUE}


def test_noise_is_the_middle_of_its_ends_and_said(small):
    found, said = drawn(small, "arnold:noise", color1=RED, color2=BLUE)
    assert found == pytest.approx((0.5, 0.0, 0.5))
    assert len(said) == 1 and "is noise" in said[0]
