"""Stages with what nobody means and everybody has: they are rendered, and what is lost is said in one line."""

from __future__ import annotations

import numpy as np
import pytest

from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import Shutter
from tpdwarp.settings import Settings
from tpdwarp.usd.read.stage import StageScene

HEAD = """#usda 1.0
(
    startTimeCode = 1
    endTimeCode = 3
)
def Mesh "Floor" {
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-4, -4, 0), (4, -4, 0), (4, 4, 0), (-4, 4, 0)]
    uniform token subdivisionScheme = "none"
}
def DistantLight "Sun" {
    float inputs:intensity = 3
    float inputs:angle = 0
}
def Material "Glass" {
    token outputs:surface.connect = </Glass/S.outputs:surface>
    def Shader "S" {
        uniform token info:id = "UsdPreviewSurface"
        float inputs:opacity = 0
        token outputs:surface
    }
}
"""
CORNERS = [(x, y, z) for z in (1, 2) for y in (-1, 1) for x in (-1, 1)]
QUADS = [0, 2, 3, 1, 4, 5, 7, 6, 0, 1, 5, 4, 2, 6, 7, 3, 0, 4, 6, 2, 1, 3, 7, 5]
SQUARE = [(-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)]


def mesh(counts, indices, points, binding="/Glass", name="Odd", more="", scheme="none"):
    return f"""def Mesh "{name}" (prepend apiSchemas = ["MaterialBindingAPI"]) {{
    int[] faceVertexCounts = {counts}
    int[] faceVertexIndices = {indices}
    point3f[] points = {points}
    uniform token subdivisionScheme = "{scheme}"
    rel material:binding = <{binding}>
    {more}
}}
"""


def cube(**changes):
    return mesh([4] * 6, QUADS, CORNERS, **changes)


def material(name, surface, *nodes):
    shaders = "".join(f'    def Shader "{node}" {{\n{inputs}\n    }}\n' for node, inputs in (("S", surface), *nodes))
    return f'def Material "{name}" {{\n    token outputs:surface.connect = </{name}/S.outputs:surface>\n{shaders}}}\n'


ADD = """        uniform token info:id = "ND_add_float"
        float inputs:in1.connect = </Loop/{}.outputs:out>
        float outputs:out"""
STANDARD = """        uniform token info:id = "ND_standard_surface_surfaceshader"
        float inputs:transmission.connect = <{}>
        token outputs:surface"""
# What is authored, and words of what is said of it; None where nothing is lost.
GEOMETRY = {
    "a cube": (cube(), None),
    "inside out": (mesh([4] * 6, [q for f in range(6) for q in QUADS[4 * f : 4 * f + 4][::-1]], CORNERS), None),
    "open glass": (mesh([4] * 5, QUADS[:4] + QUADS[8:], CORNERS), None),
    "an edge of three faces": (mesh([4] * 7, [*QUADS, 0, 1, 7, 6], CORNERS), None),
    "an edge of three faces, subdivided": (mesh([4] * 7, [*QUADS, 0, 1, 7, 6], CORNERS, scheme="catmullClark"), None),
    "faces twice": (mesh([4] * 12, QUADS * 2, CORNERS), None),
    "faces without area": (mesh([4] * 8, [*QUADS, 0, 0, 0, 0, 1, 1, 2, 2], CORNERS), None),
    "nothing but a point": (mesh([4], [0, 1, 2, 3], [(0, 0, 1)] * 4), None),
    "nothing but a point, subdivided": (mesh([4], [0, 1, 2, 3], [(0, 0, 1)] * 4, scheme="catmullClark"), None),
    "corners of their own": (mesh([4] * 6, list(range(24)), [CORNERS[q] for q in QUADS]), None),
    "a corner twice": (mesh([5], [0, 1, 1, 2, 3], SQUARE), None),
    "a face that crosses itself": (mesh([4], [0, 2, 1, 3], SQUARE), None),
    "a name in other letters": (cube(name="Würfel_玻璃"), None),
}
LOST = {
    "a material that is not there": (cube(binding="/Nowhere"), "names /Nowhere, which is no material"),
    "a mesh for a material": (cube(binding="/Floor"), "names /Floor, which is no material"),
    "a circular network": (
        material("Loop", STANDARD.format("/Loop/A.outputs:out"), ("A", ADD.format("B")), ("B", ADD.format("A")))
        + cube(binding="/Loop"),
        "circular",
    ),
    "a node that is not there": (
        material("Gone", STANDARD.format("/Gone/A.outputs:out")) + cube(binding="/Gone"),
        "is connected to /Gone/A.outputs:out, which does not exist",
    ),
    "displacement": (
        material(
            "Bumpy",
            '        uniform token info:id = "UsdPreviewSurface"\n        float inputs:displacement = 0.3\n'
            "        token outputs:surface",
        )
        + cube(binding="/Bumpy"),
        "is not rendered",
    ),
    "edges for a subset": (
        cube(
            more='def GeomSubset "E" (prepend apiSchemas = ["MaterialBindingAPI"]) {\n        int[] indices = [0, 99]\n'
            '        uniform token elementType = "edge"\n        uniform token familyName = "materialBind"\n'
            "        rel material:binding = </Glass>\n    }"
        ),
        "something other than faces",
    ),
    "a prototype that holds itself": (
        'def PointInstancer "I" {\n    rel prototypes = [</I>]\n    int[] protoIndices = [0]\n'
        "    point3f[] positions = [(0, 0, 0)]\n}\n" + cube(),
        "holds itself",
    ),
    "a prototype that is not there": (
        'def PointInstancer "I" {\n    rel prototypes = [</Glass/S>, </Gone>]\n    int[] protoIndices = [1]\n'
        "    point3f[] positions = [(0, 0, 0)]\n}\n" + cube(),
        "names /Gone, which does not exist",
    ),
    "references in a circle": (
        'def "A" (references = </B>) {\n}\ndef "B" (references = </A>) {\n}\n' + cube(),
        "Cycle",
    ),
    "an offset that scales time to nothing": (
        'def "A" (references = </Floor> (scale = 0)) {\n}\n' + cube(),
        "Invalid reference offset",
    ),
    "an xformOp of no known kind": (
        'def Xform "X" {\n    float3 constrainedXformOp:constrainScale = (1, 1, 1)\n'
        '    uniform token[] xformOpOrder = ["constrainedXformOp:constrainScale"]\n' + cube() + "}\n",
        "left out (correct the order)",
    ),
}


def shown(folder, text):
    """The frame of a stage, and what is said of it beside what is missing in all of these."""
    path = folder / "odd.usda"
    path.write_text(HEAD + text)
    scene = StageScene.open(path, Settings(image_width=24))
    settings = Settings(photons=256, samples=1)
    frame = render_frame(RenderContext(scene, settings), Shutter.still(1), *scene.resolution())
    pixels = np.stack([frame.channels[name] for name in "RGBA"])
    assert np.isfinite(pixels).all() and pixels[:3].max() > 0
    energy = frame.energy
    assert energy.deposited <= energy.sent * (1 + 1e-5)
    return energy, [line.removeprefix(str(path)) for line in scene.warnings.messages if "camera" not in line]


@pytest.mark.parametrize("what", GEOMETRY)
def test_odd_meshes_are_rendered_as_they_are(tmp_path, what):
    energy, said = shown(tmp_path, GEOMETRY[what][0])
    assert said == []
    assert energy.sent > 0 or "nothing" in what


def test_corners_of_their_own_and_faces_without_area_change_no_light(tmp_path):
    expected, _ = shown(tmp_path, GEOMETRY["a cube"][0])
    for what in ("corners of their own", "faces without area", "a name in other letters", "inside out"):
        found, _ = shown(tmp_path, GEOMETRY[what][0])
        assert (found.sent, found.deposited) == pytest.approx((expected.sent, expected.deposited), rel=1e-5), what


@pytest.mark.parametrize("what", LOST)
def test_what_is_lost_is_said_in_one_line_and_the_rest_is_rendered(tmp_path, what):
    text, words = LOST[what]
    _, said = shown(tmp_path, text)
    assert sum(words in line for line in said) == 1, said


def test_warnings_of_usd_that_differ_by_their_prim_are_one_line(tmp_path):
    bound = "".join(
        cube(name=f"Odd{k}").replace(' (prepend apiSchemas = ["MaterialBindingAPI"])', "") for k in range(5)
    )
    _, said = shown(tmp_path, bound)
    assert len(said) == 1 and "and 4 more" in said[0]
