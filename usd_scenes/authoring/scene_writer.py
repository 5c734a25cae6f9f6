"""Writing the example scenes with USD: Z up, metres, 24 frames a second, everything below ``/World``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from pxr import Gf, Kind, Sdf, Usd, UsdGeom, UsdLux, UsdRender, UsdShade, Vt

from tpdwarp.io.files import check_writable, complete_or_absent

FIRST_FRAME = 1
IMAGE_SIZE = (960, 540)
APERTURE_IN_TENTHS = 20.955


class SceneWriter:
    """A stage in memory with a floor's worth of defaults, saved in one piece.

    Args:
        frames: Frames of the animation; time samples go one further, so that the last frame's shutter has data.
        options: What the scene was made with, kept in the layer's custom data.
    """

    def __init__(self, frames: int, options: Mapping[str, float]) -> None:
        self.times = [float(FIRST_FRAME + step) for step in range(frames + 1)]
        self.stage = Usd.Stage.CreateInMemory()
        UsdGeom.SetStageUpAxis(self.stage, UsdGeom.Tokens.z)
        UsdGeom.SetStageMetersPerUnit(self.stage, 1.0)
        self.stage.SetTimeCodesPerSecond(24)
        self.stage.SetFramesPerSecond(24)
        self.stage.SetStartTimeCode(FIRST_FRAME)
        self.stage.SetEndTimeCode(FIRST_FRAME + frames - 1)
        self.stage.GetRootLayer().customLayerData = {"scene": dict(options)}
        world = UsdGeom.Xform.Define(self.stage, "/World")
        Usd.ModelAPI(world).SetKind(Kind.Tokens.component)
        self.stage.SetDefaultPrim(world.GetPrim())
        UsdGeom.Scope.Define(self.stage, "/World/Materials")

    def material(self, name: str, **inputs: float | tuple[float, float, float]) -> UsdShade.Material:
        """A UsdPreviewSurface material; inputs are floats or linear Rec.709 colours."""
        material = UsdShade.Material.Define(self.stage, f"/World/Materials/{name}")
        shader = UsdShade.Shader.Define(self.stage, f"/World/Materials/{name}/Surface")
        shader.CreateIdAttr("UsdPreviewSurface")
        for key, value in inputs.items():
            kind = Sdf.ValueTypeNames.Color3f if isinstance(value, tuple) else Sdf.ValueTypeNames.Float
            shader.CreateInput(key, kind).Set(value)
        material.CreateSurfaceOutput().ConnectToSource(shader.CreateOutput("surface", Sdf.ValueTypeNames.Token))
        return material

    def mesh(
        self,
        path: str,
        faces: Sequence[np.ndarray],
        material: UsdShade.Material,
        normals_per: str = UsdGeom.Tokens.vertex,
    ) -> UsdGeom.Mesh:
        """A polygonal mesh without its points: ``faces`` are vertex indices, each [n, corners]; normals per vertex or
        ``faceVarying``."""
        mesh = UsdGeom.Mesh.Define(self.stage, path)
        mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        counts = np.concatenate([np.full(len(group), group.shape[1]) for group in faces])
        indices = np.concatenate([group.reshape(-1) for group in faces])
        mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(counts.astype(np.int32)))
        mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(indices.astype(np.int32)))
        mesh.SetNormalsInterpolation(normals_per)
        UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
        return mesh

    def shape(
        self,
        mesh: UsdGeom.Mesh,
        points: np.ndarray,
        normals: np.ndarray,
        time: Usd.TimeCode | float = Usd.TimeCode.Default(),  # noqa: B008 (immutable)
    ) -> None:
        """Points, normals and extent of ``mesh`` at ``time``."""
        positions = Vt.Vec3fArray.FromNumpy(points)
        mesh.CreatePointsAttr().Set(positions, time)
        mesh.CreateNormalsAttr().Set(Vt.Vec3fArray.FromNumpy(normals), time)
        mesh.CreateExtentAttr().Set(UsdGeom.PointBased.ComputeExtent(positions), time)

    def floor(self, size: float, albedo: float) -> None:
        """A diffuse square of side ``size`` at z = 0, ``/World/Floor``."""
        corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32) * np.float32(size / 2)
        material = self.material("Floor", diffuseColor=(albedo,) * 3, metallic=0.0, roughness=1.0)
        mesh = self.mesh("/World/Floor", [np.array([[0, 1, 2, 3]])], material)
        self.shape(mesh, corners, np.tile(np.array([0, 0, 1], np.float32), (4, 1)))

    def sun(self, irradiance: float, tilt: float = 0.0) -> None:
        """Parallel light, ``/World/Sun``; ``irradiance`` in W/m², from ``tilt`` degrees off straight down towards x."""
        light = UsdLux.DistantLight.Define(self.stage, "/World/Sun")
        light.CreateAngleAttr(0.0)
        light.CreateIntensityAttr(irradiance)
        if tilt:
            light.AddRotateYOp().Set(-tilt)

    def camera(
        self, eye: Sequence[float], target: Sequence[float], field_of_view: float, exposure: float = 0.0
    ) -> None:
        """The picture's camera, ``/World/Camera``: horizontal field of view in degrees, exposure in stops."""
        camera = self._camera("/World/Camera", APERTURE_IN_TENTHS, IMAGE_SIZE[1] / IMAGE_SIZE[0])
        camera.CreateFocalLengthAttr(APERTURE_IN_TENTHS / 2 / math.tan(math.radians(field_of_view) / 2))
        camera.CreateExposureAttr(exposure)
        view = Gf.Matrix4d().SetLookAt(Gf.Vec3d(*eye), Gf.Vec3d(*target), Gf.Vec3d(0, 0, 1))
        camera.AddTransformOp().Set(view.GetInverse())

    def measuring_camera(self, center: tuple[float, float, float], size: float) -> None:
        """Orthographic, straight down from ``center`` on a square of side ``size``, ``/World/TopOrtho``."""
        camera = self._camera("/World/TopOrtho", 10 * size, 1.0)
        camera.CreateProjectionAttr(UsdGeom.Tokens.orthographic)
        camera.AddTranslateOp().Set(Gf.Vec3d(*center))

    def _camera(self, path: str, aperture: float, aspect: float) -> UsdGeom.Camera:
        camera = UsdGeom.Camera.Define(self.stage, path)
        camera.CreateHorizontalApertureAttr(aperture)
        camera.CreateVerticalApertureAttr(aperture * aspect)
        camera.CreateClippingRangeAttr(Gf.Vec2f(0.01, 100.0))
        camera.CreateShutterOpenAttr(0.0)
        camera.CreateShutterCloseAttr(1.0)
        return camera

    def save(self, path: Path) -> None:
        """Adds the render settings and writes the layer; ``path`` appears only when complete.

        Raises:
            InputError: The folder cannot be written.
            FrameError: The disk is full.
        """
        settings = UsdRender.Settings.Define(self.stage, "/Render/Settings")
        settings.CreateResolutionAttr(Gf.Vec2i(*IMAGE_SIZE))
        settings.CreateCameraRel().SetTargets(["/World/Camera"])
        self.stage.SetMetadata("renderSettingsPrimPath", "/Render/Settings")
        check_writable(path)
        with complete_or_absent(path) as temporary:
            self.stage.GetRootLayer().Export(temporary)
