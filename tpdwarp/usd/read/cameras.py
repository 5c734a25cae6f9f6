"""UsdGeom cameras, read as pinhole or orthographic cameras over a shutter."""

from __future__ import annotations

import math

import numpy as np
from pxr import Gf, Usd, UsdGeom

from tpdwarp.errors import WarnOnce
from tpdwarp.scene.description import CameraAtShutter, Shutter
from tpdwarp.usd.read.coordinate_frames import frame_over
from tpdwarp.usd.read.render_settings import conformed
from tpdwarp.usd.read.transforms import Transforms
from tpdwarp.usd.read.values import (
    ABOVE_0,
    ITS_DEFAULT,
    not_negative,
    positive,
    text_at,
    usable_number,
    value_or_fallback,
)

WIDEST_WINDOW = 1e12
LARGEST_SINGLE = float(np.finfo(np.float32).max)
LONGEST_SHUTTER = 1e6
NEAR_FRAME = f"less than {LONGEST_SHUTTER:g} frames"
THEIR_DEFAULTS = "their defaults are used"
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
        own = (attribute for attribute in prim.GetAttributes() if not attribute.GetName().startswith("xformOp"))
        self._zooms = any(attribute.ValueMightBeTimeVarying() for attribute in own)
        self._held_lens: Gf.Camera | None = None

    @property
    def moves(self) -> bool:
        """Whether its place or direction may change with time."""
        return self._transforms.span(self.prim) is not None

    def aspect(self, time: float) -> float:
        """Width of the aperture over its height."""
        return self._lens(time).aspectRatio

    def shutter_interval(self, frame: float) -> tuple[float, float]:
        """``shutter:open`` and ``shutter:close`` at a time code, relative to it; a still where they mean nothing."""
        opening, closing = (
            usable_number(attribute, frame, self._warnings, NEAR_FRAME, lambda value: abs(value) <= LONGEST_SHUTTER)
            for attribute in (self._camera.GetShutterOpenAttr(), self._camera.GetShutterCloseAttr())
        )
        if opening > closing:
            self._warnings(
                f"{self.path}.shutter:close",
                f"the shutter closes at {closing:g} but opens at {opening:g}; a still is taken "
                "(author it to close at or after it opens)",
            )
            return 0.0, 0.0
        return opening, closing

    def over(self, shutter: Shutter, image_aspect: float, policy: str) -> CameraAtShutter:
        """The camera over ``shutter``.

        Args:
            shutter: The shutter.
            image_aspect: Width of the image over its height, in the plane of the aperture.
            policy: How the aperture is fitted to the image (``aspectRatioConformPolicy``).

        Raises:
            InputError: A transform that cannot be used.
        """
        camera = self._lens(shutter.middle)
        orthographic = camera.projection == Gf.Camera.Orthographic
        self._warn_unsupported(camera, shutter)
        bounds = camera.frustum.window
        window = conformed((bounds.min[0], bounds.max[0], bounds.min[1], bounds.max[1]), image_aspect, policy)
        near, far = camera.clippingRange.min, camera.clippingRange.max
        position, axes, position_motion, axes_motion = frame_over(
            self.prim, shutter, self._transforms, self._animation, self._warnings
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
        if orthographic or not positive(camera.focusDistance):
            what = "an orthographic camera has" if orthographic else "without a focusDistance there is"
            self._warnings(f"{self.path}.fStop", f"{what} no depth of field: everything is sharp")
            return 0.0, 1.0
        # Focal lengths are in tenths of a scene unit; an f-stop is the focal length by the lens's diameter.
        return 0.5 * camera.focalLength * Gf.Camera.FOCAL_LENGTH_UNIT / camera.fStop, camera.focusDistance

    def _lens(self, time: float) -> Gf.Camera:
        """The camera but its transform, with its schema's defaults in the place of what means nothing."""
        if self._held_lens is None or self._zooms:
            self._held_lens = self._usable_lens(time)
        return self._held_lens

    def _usable_lens(self, time: float) -> Gf.Camera:
        lens = self._authored_lens(time)
        size = lens.frustum.window.GetSize()
        if all(0 < side < WIDEST_WINDOW for side in size) and 1 / WIDEST_WINDOW < lens.aspectRatio < WIDEST_WINDOW:
            return lens
        self._warnings(
            self.path,
            f"its apertures and focal length make a window of {size[0]:g} × {size[1]:g}; "
            f"{THEIR_DEFAULTS} (correct them)",
        )
        default = Gf.Camera()
        lens.horizontalAperture, lens.verticalAperture = default.horizontalAperture, default.verticalAperture
        lens.horizontalApertureOffset = lens.verticalApertureOffset = 0.0
        lens.focalLength = default.focalLength
        return lens

    def _authored_lens(self, time: float) -> Gf.Camera:
        """The camera as authored, but its transform and each value that alone means nothing."""
        of, lens = self._camera, Gf.Camera()
        if text_at(of.GetProjectionAttr(), time) == UsdGeom.Tokens.orthographic:
            lens.projection = Gf.Camera.Orthographic
        orthographic = lens.projection == Gf.Camera.Orthographic

        def number(attribute: Usd.Attribute, above_0: bool = False) -> float:
            wanted = (ABOVE_0, positive) if above_0 else ()
            value = usable_number(attribute, time, self._warnings, *wanted)
            # What USD's camera holds in single precision.
            return math.copysign(min(abs(value), LARGEST_SINGLE), value)

        lens.horizontalAperture = number(of.GetHorizontalApertureAttr(), above_0=True)
        lens.verticalAperture = number(of.GetVerticalApertureAttr(), above_0=True)
        lens.horizontalApertureOffset = number(of.GetHorizontalApertureOffsetAttr())
        lens.verticalApertureOffset = number(of.GetVerticalApertureOffsetAttr())
        lens.focalLength = number(of.GetFocalLengthAttr(), above_0=not orthographic)
        lens.fStop, lens.focusDistance = number(of.GetFStopAttr()), number(of.GetFocusDistanceAttr())
        planes = value_or_fallback(of.GetClippingPlanesAttr(), time, self._warnings, (None, 4))
        lens.clippingPlanes = [] if planes is None else [Gf.Vec4f(*map(float, plane)) for plane in planes]
        lens.clippingRange = self._clipping_range(time, orthographic)
        return lens

    def _clipping_range(self, time: float, orthographic: bool) -> Gf.Range1f:
        attribute = self._camera.GetClippingRangeAttr()
        near, far = map(float, value_or_fallback(attribute, time, self._warnings, (2,)))
        if math.isfinite(near) and math.isfinite(far) and near < far and (orthographic or near >= 0):
            return Gf.Range1f(near, far)
        self._warnings(
            str(attribute.GetPath()),
            f"holds ({near:g}, {far:g}); {ITS_DEFAULT} "
            "(author distances from near to far, 0 or more for a perspective)",
        )
        return Gf.Camera().clippingRange

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
        if not_negative(scale):
            return scale
        self._warnings(
            f"{self.path}.exposure", f"its exposure attributes give no finite exposure; {THEIR_DEFAULTS} (correct them)"
        )
        return 1.0

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
