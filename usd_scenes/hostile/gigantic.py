"""Small files that stand for far more than any machine holds: billions of instances, endless nesting, huge arrays."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from pxr import Sdf, Vt

_HEAD = "#usda 1.0\n(\n    startTimeCode = 1\n    endTimeCode = 2\n)\n\n"
_TRIANGLE = """{indent}def Mesh "{name}"
{indent}{{
{indent}    int[] faceVertexCounts = [3]
{indent}    int[] faceVertexIndices = [0, 1, 2]
{indent}    point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
{indent}}}
"""


def nested_instancers(path: Path, levels: int, count: int) -> Path:
    """Point instancers nested in each other: ``count`` to the power of ``levels`` triangles."""
    text = _HEAD
    for level in range(levels):
        inner = f"</I{level + 1}>" if level + 1 < levels else "</Drop>"
        places = ", ".join(f"({place}, 0, 0)" for place in range(count))
        text += (
            f'def PointInstancer "I{level}"\n{{\n    rel prototypes = {inner}\n'
            f"    int[] protoIndices = [{', '.join('0' * count)}]\n    point3f[] positions = [{places}]\n}}\n\n"
        )
    path.write_text(text + _TRIANGLE.format(indent="", name="Drop"))
    return path


def nested_references(path: Path, levels: int, count: int, instanceable: bool) -> Path:
    """Prims that reference each other: ``count`` to the power of ``levels`` triangles; shared if ``instanceable``."""
    text = _HEAD + 'over "Library"\n{\n'
    for level in range(levels):
        text += f'    def Xform "P{level}"\n    {{\n'
        for child in range(count):
            shared = "        instanceable = true\n" if instanceable else ""
            text += f'        def Xform "c{child}" (\n            prepend references = </Library/P{level + 1}>\n'
            text += f"    {shared}        )\n        {{\n        }}\n"
        text += "    }\n"
    text += f'    def Xform "P{levels}"\n    {{\n' + _TRIANGLE.format(indent=" " * 8, name="Drop") + "    }\n}\n"
    path.write_text(text + '\ndef Xform "World" (\n    prepend references = </Library/P0>\n)\n{\n}\n')
    return path


def nested_prims(path: Path, depth: int) -> Path:
    """Prims in each other, ``depth`` deep, as text or, by the name, as a crate."""
    if path.suffix == ".usda":
        path.write_text(_HEAD + 'def Xform "a"\n{\n' * depth + "}\n" * depth)
        return path
    layer = Sdf.Layer.CreateNew(str(path))
    with Sdf.ChangeBlock():
        parent = layer.pseudoRoot
        for _ in range(depth):
            parent = Sdf.PrimSpec(parent, "a", Sdf.SpecifierDef, "Xform")
    layer.Save()
    return path


def many_faces(path: Path, count: int) -> Path:
    """A crate with a mesh of ``count`` faces, which takes next to no room on disk."""
    layer = Sdf.Layer.CreateNew(str(path))
    mesh = Sdf.CreatePrimInLayer(layer, "/World/Mesh")
    mesh.specifier, mesh.typeName = Sdf.SpecifierDef, "Mesh"
    counts = Sdf.AttributeSpec(mesh, "faceVertexCounts", Sdf.ValueTypeNames.IntArray)
    counts.default = Vt.IntArray.FromNumpy(np.full(count, 3, np.int32))
    points = Sdf.AttributeSpec(mesh, "points", Sdf.ValueTypeNames.Point3fArray)
    points.default = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
    layer.Save()
    return path


def many_pixels(path: Path, width: int, height: int) -> Path:
    """A black image of ``width`` × ``height`` pixels, which takes next to no room on disk."""
    spec = oiio.ImageSpec(width, height, 4, "half")
    spec.attribute("compression", "zip")
    output = oiio.ImageOutput.create(str(path))
    output.open(str(path), spec)
    rows = np.zeros((16, width, 4), np.float16)
    for row in range(0, height, 16):
        some = min(16, height - row)
        output.write_scanlines(row, row + some, 0, rows[:some])
    output.close()
    return path
