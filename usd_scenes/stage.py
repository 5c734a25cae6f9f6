"""A scene of the oracle as a USD stage: the same vertices, to the last bit, at the frames 1 and 2."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade, Vt

from .brute_force.description import DIELECTRIC, MIRROR, Light, Mesh, Scene

FRAME = 1
# A bulb seen from afar: a radius of zero would leave its brightness to each renderer's reading.
BULB_RADIUS = 0.0625
CAMERA = "/World/Camera"


def write_stage(scene: Scene, path: Path) -> Path:
    """Writes a scene as a stage of one frame, whose shutter is open until the next; what is still has no samples."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(24)
    stage.SetFramesPerSecond(24)
    stage.SetStartTimeCode(FRAME)
    stage.SetEndTimeCode(FRAME)
    world = UsdGeom.Xform.Define(stage, "/World")
    stage.SetDefaultPrim(world.GetPrim())
    for mesh in scene.meshes:
        _write_mesh(stage, mesh)
    for light in scene.lights:
        _write_light(stage, light)
    _write_camera(stage, scene)
    stage.GetRootLayer().Export(str(path))
    return path


def _write_mesh(stage: Usd.Stage, mesh: Mesh) -> None:
    prim = UsdGeom.Mesh.Define(stage, mesh.name)
    prim.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    prim.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(mesh.triangles), 3, np.int32)))
    prim.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(mesh.triangles.reshape(-1).astype(np.int32)))
    prim.CreateDoubleSidedAttr(mesh.interaction != DIELECTRIC)
    _set(prim.CreatePointsAttr(), mesh.points, Vt.Vec3fArray.FromNumpy)
    _set(prim.CreateExtentAttr(), mesh.points, lambda p: UsdGeom.PointBased.ComputeExtent(Vt.Vec3fArray.FromNumpy(p)))
    if mesh.normals is not None:
        prim.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
        _set(prim.CreateNormalsAttr(), mesh.normals, Vt.Vec3fArray.FromNumpy)
    UsdShade.MaterialBindingAPI.Apply(prim.GetPrim()).Bind(_write_material(stage, mesh))


def _write_material(stage: Usd.Stage, mesh: Mesh) -> UsdShade.Material:
    path = f"/World/Materials/{Sdf.Path(mesh.name).name}"
    inputs: dict[str, float | tuple[float, float, float]] = {"diffuseColor": (0.5,) * 3, "roughness": 1.0}
    if mesh.interaction == DIELECTRIC:
        inputs = {"diffuseColor": (0.0,) * 3, "opacity": 0.0, "ior": mesh.ior, "roughness": 0.0}
    elif mesh.interaction == MIRROR:
        inputs = {"diffuseColor": (mesh.tint,) * 3, "metallic": 1.0, "roughness": 0.0}
    material = UsdShade.Material.Define(stage, path)
    shader = UsdShade.Shader.Define(stage, f"{path}/Surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    for name, value in inputs.items():
        kind = Sdf.ValueTypeNames.Color3f if isinstance(value, tuple) else Sdf.ValueTypeNames.Float
        shader.CreateInput(name, kind).Set(value)
    material.CreateSurfaceOutput().ConnectToSource(shader.CreateOutput("surface", Sdf.ValueTypeNames.Token))
    return material


def _write_light(stage: Usd.Stage, light: Light) -> None:
    if light.direction is not None:
        sun = UsdLux.DistantLight.Define(stage, light.name)
        sun.CreateAngleAttr(0.0)
        sun.CreateIntensityAttr(light.power)
        turn = Gf.Rotation(Gf.Vec3d(0, 0, -1), Gf.Vec3d(*map(float, light.direction)))
        sun.AddTransformOp().Set(Gf.Matrix4d(turn, Gf.Vec3d(0)))
        return
    lamp = UsdLux.SphereLight.Define(stage, light.name)
    lamp.CreateRadiusAttr(BULB_RADIUS)
    lamp.CreateTreatAsPointAttr(True)
    lamp.CreateIntensityAttr(light.power / (math.pi * BULB_RADIUS**2))
    _set(lamp.AddTranslateOp(), light.position, lambda p: Gf.Vec3d(*map(float, p)))


def _write_camera(stage: Usd.Stage, scene: Scene) -> None:
    camera = UsdGeom.Camera.Define(stage, CAMERA)
    camera.CreateProjectionAttr(UsdGeom.Tokens.orthographic)
    # Apertures count tenths of a scene unit.
    camera.CreateHorizontalApertureAttr(10.0 * scene.camera.size)
    camera.CreateVerticalApertureAttr(10.0 * scene.camera.size * scene.camera.height / scene.camera.width)
    camera.CreateClippingRangeAttr(Gf.Vec2f(1e-4, 100.0))
    camera.CreateShutterOpenAttr(0.0)
    camera.CreateShutterCloseAttr(1.0)
    _set(camera.AddTranslateOp(), scene.camera.position, lambda p: Gf.Vec3d(*map(float, p)))
    if not np.array_equal(scene.camera.axes, np.eye(3)):
        matrix = np.eye(4)
        matrix[:3, :3] = scene.camera.axes
        camera.AddTransformOp().Set(Gf.Matrix4d(matrix.tolist()))


def _set(attribute: Usd.Attribute | UsdGeom.XformOp, ends: tuple[np.ndarray, np.ndarray], convert: object) -> None:
    """Authors a value that is the same at both ends once, another one as two samples."""
    if np.array_equal(*ends):
        attribute.Set(convert(ends[0]))
        return
    for step, value in enumerate(ends):
        attribute.Set(convert(value), FRAME + step)
