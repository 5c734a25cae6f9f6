"""UsdGeom cameras, read as pinhole or orthographic cameras over a shutter."""

from __future__ import annotations

import math

import numpy as np
from pxr import Gf, Usd, UsdGeom

from tpdwarp.errors import InputError, WarnOnce
from tpdwarp.scene.description import CameraAtShutter, Shutter
from tpdwarp.usd.read.coordinate_frames import frame_over
from tpdwarp.usd.read.diagnostics import errors_at
from tpdwarp.usd.read.render_settings import conformed
from tpdwarp.usd.read.transforms import Transforms
from tpdwarp.usd.read.values import number_or_fallback

WIDEST_WINDOW = 1e12
Window = tuple[float, float, float, float]


class Camera:
    """A camera of the stage.

    Args:
        prim: The camera prim.
        transforms: Transforms of the stage.
        animation: First and last time code of the stage.
        warnings: Takes what is not supported, and names the file in errors.
    """

    def __init__(
        self, prim: Usd.Prim, transforms: Transforms, animation: tuple[float, float], warnings: WarnOnce
    ) -> None:
        self.prim, self.path = prim, str(prim.GetPath())
        self._camera = UsdGeom.Camera(prim)
        self._transforms, self._animation, self._warnings = transforms, animation, warnings

    @property
    def moves(self) -> bool:
        """Whether its place or direction may change with time."""
        return self._transforms.span(self.prim) is not None

    def aspect(self, time: float) -> float:
        """Width of the aperture over its height.

        Raises:
            InputError: An aperture of no size.
        """
        camera = self._lens(time)
        for name in ("horizontalAperture", "verticalAperture"):
            size = getattr(camera, name)
            if not (math.isfinite(size) and size > 0):
                raise InputError(
                    f"holds {size:g} (author an aperture above 0)", self._warnings.file, f"{self.path}.{name}"
                )
        ratio = camera.aspectRatio
        if not 1 / WIDEST_WINDOW < ratio < WIDEST_WINDOW:
            raise InputError(
                f"an aperture {ratio:g} times as wide as high (author another)", self._warnings.file, self.path
            )
        return ratio

    def shutter_interval(self, frame: float) -> tuple[float, float]:
        """``shutter:open`` and ``shutter:close`` at a time code, relative to it.

        Raises:
            InputError: A shutter that closes before it opens.
        """
        opening = number_or_fallback(self._camera.GetShutterOpenAttr(), frame, self._warnings)
        closing = number_or_fallback(self._camera.GetShutterCloseAttr(), frame, self._warnings)
        if not (math.isfinite(opening) and math.isfinite(closing) and opening <= closing):
            raise InputError(
                f"the shutter closes at {closing:g} but opens at {opening:g} (author it to close at or after it opens)",
                self._warnings.file,
                f"{self.path}.shutter:close",
            )
        return opening, closing

    def over(self, shutter: Shutter, image_aspect: float, policy: str) -> CameraAtShutter:
        """The camera over ``shutter``.

        Args:
            shutter: The shutter.
            image_aspect: Width of the image over its height, in the plane of the aperture.
            policy: How the aperture is fitted to the image (``aspectRatioConformPolicy``).

        Raises:
            InputError: A lens or a transform that cannot be used.
        """
        self.aspect(shutter.middle)
        camera = self._lens(shutter.middle)
        orthographic = camera.projection == Gf.Camera.Orthographic
        if not orthographic and not (math.isfinite(camera.focalLength) and camera.focalLength > 0):
            raise InputError(
                f"holds {camera.focalLength:g} (author a focal length above 0)",
                self._warnings.file,
                f"{self.path}.focalLength",
            )
        self._warn_unsupported(camera, shutter)
        bounds = camera.frustum.window
        if not all(0 < size < WIDEST_WINDOW for size in bounds.GetSize()):
            raise InputError(
                f"its apertures and focal length make a window of {bounds.GetSize()[0]:g} × {bounds.GetSize()[1]:g} "
                "(correct them)",
                self._warnings.file,
                self.path,
            )
        window = conformed((bounds.min[0], bounds.max[0], bounds.min[1], bounds.max[1]), image_aspect, policy)
        near, far = camera.clippingRange.min, camera.clippingRange.max
        if not (math.isfinite(near) and math.isfinite(far) and near < far and (orthographic or near >= 0)):
            raise InputError(
                f"holds ({near:g}, {far:g}) (author distances from near to far, 0 or more for a perspective)",
                self._warnings.file,
                f"{self.path}.clippingRange",
            )
        position, axes, position_motion, axes_motion = frame_over(
            self.prim, shutter, self._transforms, self._animation, self._warnings.file
        )
        to_camera = np.eye(4)
        to_camera[:3, :3], to_camera[3, :3] = axes.T, -(axes @ position)
        return CameraAtShutter(
            self.path,
            orthographic,
            position,
            axes,
            window,
            near,
            far,
            position_motion,
            axes_motion,
            self._exposure_scale(shutter.frame),
            to_camera,
            to_camera @ projection(window, near, far, orthographic),
            *self._lens_and_focus(camera, orthographic),
            self._clipping_planes(camera),
        )

    def _clipping_planes(self, camera: Gf.Camera) -> np.ndarray:
        """Its clipping planes [k, 4] but those that are not finite, in its own frame."""
        planes = np.array([tuple(plane) for plane in camera.clippingPlanes], np.float64).reshape(-1, 4)
        usable = np.isfinite(planes).all(axis=1) & planes[:, :3].any(axis=1)
        if not usable.all():
            self._warnings(f"{self.path}.clippingPlanes", "holds planes that are none, which are left out")
        return planes[usable]

    def _lens_and_focus(self, camera: Gf.Camera, orthographic: bool) -> tuple[float, float]:
        """Radius of the lens and distance of the focus in scene units; a radius of 0 for a pinhole."""
        if not camera.fStop > 0:
            return 0.0, 1.0
        if orthographic or not (math.isfinite(camera.focusDistance) and camera.focusDistance > 0):
            what = "an orthographic camera has" if orthographic else "without a focusDistance there is"
            self._warnings(f"{self.path}.fStop", f"{what} no depth of field: everything is sharp")
            return 0.0, 1.0
        # Focal lengths are in tenths of a scene unit; an f-stop is the focal length by the lens's diameter.
        return 0.5 * camera.focalLength * Gf.Camera.FOCAL_LENGTH_UNIT / camera.fStop, camera.focusDistance

    def _lens(self, time: float) -> Gf.Camera:
        with errors_at(self.path):
            return self._camera.GetCamera(time)

    def _exposure_scale(self, frame: float) -> float:
        camera = self._camera
        attributes = (
            camera.GetExposureAttr(),
            camera.GetExposureFStopAttr(),
            camera.GetExposureIsoAttr(),
            camera.GetExposureResponsivityAttr(),
            camera.GetExposureTimeAttr(),
        )
        if not any(attribute.HasAuthoredValue() for attribute in attributes):
            return 1.0
        scale = float(camera.ComputeLinearExposureScale(frame))
        if not (math.isfinite(scale) and scale >= 0):
            raise InputError(
                "its exposure attributes give no finite exposure (correct them)",
                self._warnings.file,
                f"{self.path}.exposure",
            )
        return scale

    def _warn_unsupported(self, camera: Gf.Camera, shutter: Shutter) -> None:
        lens = (
            self._camera.GetFocalLengthAttr(),
            self._camera.GetHorizontalApertureAttr(),
            self._camera.GetVerticalApertureAttr(),
        )
        if shutter.exposure > 0 and any(attribute.ValueMightBeTimeVarying() for attribute in lens):
            self._warnings(self.path, "a lens that zooms is not blurred: it is held at mid shutter")


def projection(window: Window, near: float, far: float, orthographic: bool) -> np.ndarray:
    """Row-vector projection to −1 … 1, shape [4, 4]."""
    left, right, bottom, top = window
    frustum = Gf.Frustum()
    frustum.window = Gf.Range2d((left, bottom), (right, top))
    frustum.nearFar = Gf.Range1d(near, far)
    frustum.projectionType = Gf.Frustum.Orthographic if orthographic else Gf.Frustum.Perspective
    return np.array(frustum.ComputeProjectionMatrix())
