"""Small stages, written to disk and opened again."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade

from tpdwarp.scene.description import MeshAtShutter, SceneAtShutter
from tpdwarp.settings import Settings
from tpdwarp.usd.read.stage import StageScene

SQUARE = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0))


class SmallStage:
    """A stage of time codes 1 … 5 with one unit distant light; add to it, then ``open`` it."""

    def __init__(self, folder: Path, start: float = 1, end: float = 5, light: bool = True) -> None:
        self.file = str(folder / "scene.usda")
        self.stage = Usd.Stage.CreateNew(self.file)
        self.stage.SetStartTimeCode(start)
        self.stage.SetEndTimeCode(end)
        self.stage.SetTimeCodesPerSecond(24)
        if light:
            self.light = UsdLux.DistantLight.Define(self.stage, "/Light")
            self.light.CreateAngleAttr(0.0)
            self.light.CreateIntensityAttr(1.0)

    def mesh(
        self,
        path: str = "/Mesh",
        points: Sequence[Sequence[float]] | None = SQUARE,
        counts: Sequence[int] = (4,),
        indices: Sequence[int] = (0, 1, 2, 3),
        scheme: str = "none",
    ) -> UsdGeom.Mesh:
        mesh = UsdGeom.Mesh.Define(self.stage, path)
        if points is not None:
            mesh.CreatePointsAttr([Gf.Vec3f(*map(float, p)) for p in points])
        mesh.CreateFaceVertexCountsAttr(list(counts))
        mesh.CreateFaceVertexIndicesAttr(list(indices))
        mesh.CreateSubdivisionSchemeAttr(scheme)
        return mesh

    def moving(self, path: str, points_at: dict[float, np.ndarray], **faces: Any) -> UsdGeom.Mesh:
        mesh = self.mesh(path, None, **faces)
        for time, points in points_at.items():
            mesh.GetPointsAttr().Set([Gf.Vec3f(*map(float, p)) for p in points], time)
        return mesh

    def preview(self, path: str, **inputs: Any) -> UsdShade.Shader:
        """A material with a UsdPreviewSurface; colours are 3-tuples, the rest numbers."""
        material = UsdShade.Material.Define(self.stage, path)
        shader = UsdShade.Shader.Define(self.stage, f"{path}/Surface")
        shader.CreateIdAttr("UsdPreviewSurface")
        material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
        set_inputs(shader, **inputs)
        return shader

    def bind(self, prim: Usd.SchemaBase, material: str) -> None:
        UsdShade.MaterialBindingAPI.Apply(prim.GetPrim()).Bind(UsdShade.Material(self.stage.GetPrimAtPath(material)))

    def open(self, **settings: Any) -> StageScene:
        self.stage.Save()
        return StageScene.open(self.file, Settings(**settings))


def set_inputs(shader: UsdShade.Shader, **inputs: Any) -> None:
    for name, value in inputs.items():
        if isinstance(value, tuple):
            shader.CreateInput(name, Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*value))
        elif isinstance(value, str):
            shader.CreateInput(name, Sdf.ValueTypeNames.Token).Set(value)
        else:
            shader.CreateInput(name, Sdf.ValueTypeNames.Float).Set(float(value))


def mesh_named(scene: SceneAtShutter, path: str) -> MeshAtShutter:
    return next(mesh for mesh in scene.meshes if mesh.path == path)


def face_normals(mesh: MeshAtShutter) -> np.ndarray:
    a, b, c = (mesh.points[mesh.triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)
