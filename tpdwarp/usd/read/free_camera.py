"""What usdrecord adds to a stage that lacks it: a free camera that frames the stage, and a light at the camera."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import numpy as np
from pxr import Gf, Usd, UsdGeom

from tpdwarp.scene.description import CameraAtShutter, LightAtShutter, LightKind, Shutter
from tpdwarp.usd.read.cameras import projection
from tpdwarp.usd.read.render_settings import conformed

FREE_CAMERA, CAMERA_LIGHT = "free camera", "camera light"
# A white surface that faces the camera shows radiance 1, as under the white light of unit strength of usdrecord.
CAMERA_LIGHT_IRRADIANCE = math.pi
# A stage of one point is looked at from a distance, not from within.
SMALLEST_EXTENT = 1e-6


class FreeCamera:
    """A camera with USD's default lens that looks along −z (y up) or +y (z up) and holds the whole stage.

    The bounding box of a frame is centred; its front face's corner lies on the circle that the horizontal field of
    view (23.7°) cuts out of that face's plane. It rests over each shutter.

    Args:
        stage: The stage.
        up_axis: ``Y`` or ``Z``.
        purposes: Purposes framed.
        points_at: Gives the points [v, 3] that are rendered at a time code; used where USD knows no finite bounds.
    """

    path = FREE_CAMERA
    moves = False

    def __init__(
        self,
        stage: Usd.Stage,
        up_axis: str,
        purposes: frozenset[str],
        points_at: Callable[[float], Iterable[np.ndarray]],
    ) -> None:
        self._stage, self._up, self._purposes, self._points_at = stage, up_axis, sorted(purposes), points_at
        self._lens = Gf.Camera()

    def aspect(self, time: float) -> float:
        """Width of the aperture over its height."""
        return self._lens.aspectRatio

    def shutter_interval(self, frame: float) -> tuple[float, float]:
        """A still: nobody asked for a shutter."""
        return 0.0, 0.0

    def over(self, shutter: Shutter, image_aspect: float, policy: str) -> CameraAtShutter:
        """The camera over ``shutter``; as :meth:`tpdwarp.usd.read.cameras.Camera.over`."""
        low, high = self._bounds(shutter.frame)
        size = np.maximum(high - low, SMALLEST_EXTENT)
        across, depth = ([0, 1], 2) if self._up == "Y" else ([0, 2], 1)
        half_view = math.radians(0.5 * self._lens.GetFieldOfView(Gf.Camera.FOVHorizontal))
        distance = 0.5 * float(np.linalg.norm(size[across])) / math.tan(half_view) + 0.5 * float(size[depth])
        axes = np.eye(3) if self._up == "Y" else np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
        position = 0.5 * (low + high) + distance * axes[2]
        bounds = self._lens.frustum.window
        window = conformed((bounds.min[0], bounds.max[0], bounds.min[1], bounds.max[1]), image_aspect, policy)
        near, far = 0.1 * (distance - 0.5 * float(size[depth])), 2.0 * (distance + float(size[depth]))
        to_camera = np.eye(4)
        to_camera[:3, :3], to_camera[3, :3] = axes.T, -(axes @ position)
        return CameraAtShutter(
            self.path,
            False,
            position,
            axes,
            window,
            near,
            far,
            world_to_camera=to_camera,
            world_to_ndc=to_camera @ projection(window, near, far, False),
        )

    def _bounds(self, frame: float) -> tuple[np.ndarray, np.ndarray]:
        """Least and greatest corner of what is seen at a time code, shapes [3] and [3]."""
        cache = UsdGeom.BBoxCache(frame, self._purposes, useExtentsHint=True)
        found = cache.ComputeWorldBound(self._stage.GetPseudoRoot()).ComputeAlignedRange()
        low, high = np.array(found.GetMin()), np.array(found.GetMax())
        if not found.IsEmpty() and np.isfinite(high - low).all():
            return low, high
        parts = [points for points in self._points_at(frame) if len(points)]
        if not parts:
            return np.zeros(3), np.zeros(3)
        together = np.concatenate(parts)
        return together.min(axis=0), together.max(axis=0)


def camera_light(camera: CameraAtShutter) -> LightAtShutter:
    """Parallel light along a camera's view, which turns with it."""
    return LightAtShutter(
        CAMERA_LIGHT,
        LightKind.DISTANT,
        (CAMERA_LIGHT_IRRADIANCE,) * 3,
        camera.position,
        camera.axes,
        camera.position_motion,
        camera.axes_motion,
    )
