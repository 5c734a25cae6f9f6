"""A stage small enough to be traced in no time: a pane that rises over a floor, a sun, a camera."""

from __future__ import annotations

from pathlib import Path

_STAGE = """#usda 1.0
(
    startTimeCode = 1
    endTimeCode = {end}
    timeCodesPerSecond = 24
    framesPerSecond = 24
    upAxis = "Z"
    metersPerUnit = 1
)

def Xform "World"
{{
    def Mesh "Pane" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {{
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points.timeSamples = {{{points}
        }}
        uniform token subdivisionScheme = "none"
        rel material:binding = </World/Surface>
    }}

    def Mesh "Floor"
    {{
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [(-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0)]
        uniform token subdivisionScheme = "none"
    }}

    def Material "Surface"
    {{
        token outputs:surface.connect = </World/Surface/Shader.outputs:surface>

        def Shader "Shader"
        {{
            uniform token info:id = "UsdPreviewSurface"
            float inputs:opacity = {opacity}
            float inputs:ior = 1.5
            token outputs:surface
        }}
    }}

    def DistantLight "Sun"
    {{
        float inputs:angle = 0
        float inputs:intensity = 1
    }}
{camera}}}
"""

_CAMERA = """
    def Camera "Camera"
    {
        token projection = "orthographic"
        float horizontalAperture = 30
        float verticalAperture = 20
        float2 clippingRange = (0.1, 100)
        double shutter:open = -0.25
        double shutter:close = 0.25
        double3 xformOp:translate = (0, 0, 10)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
"""


def write_stage(
    path: Path, frames: int = 3, glass: bool = True, camera: bool = True, broken: tuple[int, ...] = ()
) -> str:
    """Writes the stage, with frames 1 to ``frames``; the pane has a point that is no number at those in ``broken``."""
    samples = ""
    for frame in range(1, frames + 1):
        height = 0.5 + 0.25 * frame
        first = "nan" if frame in broken else "-1"
        corners = f"({first}, -1, {height}), (1, -1, {height}), (1, 1, {height}), (-1, 1, {height})"
        samples += f"\n            {frame}: [{corners}],"
    text = _STAGE.format(end=frames, points=samples, opacity=0 if glass else 1, camera=_CAMERA if camera else "")
    path.write_text(text)
    return str(path)
