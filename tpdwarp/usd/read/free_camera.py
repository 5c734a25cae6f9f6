"""What usdrecord adds to a stage that lacks it: a free camera that frames the stage, and a light at the camera."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import cached_property

import numpy as np
from pxr import Gf, Tf, Usd, UsdGeom

from tpdwarp.scene.description import CameraAtShutter, LightAtShutter, LightKind, MeshAtShutter, Shutter
from tpdwarp.usd.read.cameras import projection
from tpdwarp.usd.read.render_settings import conformed

FREE_CAMERA, CAMERA_LIGHT = "free camera", "camera light"
# A white surface that faces the camera shows radiance 1, as under the white light of unit strength of usdrecord.
CAMERA_LIGHT_IRRADIANCE = math.pi
# A stage of one point is looked at from a distance, not from within.
SMALLEST_EXTENT = 1e-6
# What is thinner than this part of its length shows hardly a pixel or two from its edge. Chosen, not derived.
FLAT = 1e-2
# Of what is drawn, bounds may leave out so much of its size; where it is less than so much of theirs, for extents that
# do not fit or for lamps far off, it is a speck. Chosen, not derived.
STALE = 0.1


class FreeCamera:
    """A camera with USD's default lens that looks along −z (y up) or +y (z up) and holds the whole stage.

    The bounding box of a frame is centred; its front face's corner lies on the circle that the horizontal field of
    view (23.7°) cuts out of that face's plane. It rests over each shutter.

    Args:
        stage: The stage.
        up_axis: ``Y`` or ``Z``.
        purposes: Purposes framed.
        points_at: Gives the points [v, 3] that are rendered at a time code; used where USD knows no finite bounds.
        bounded: Whether USD may be asked for bounds.
    """

    path = FREE_CAMERA
    moves = False

    def __init__(
        self,
        stage: Usd.Stage,
        start: float,
        up_axis: str,
        purposes: frozenset[str],
        points_at: Callable[[float], Iterable[np.ndarray]],
        bounded: bool = True,
    ) -> None:
        self._stage, self._start, self._up = stage, start, up_axis
        self._purposes, self._points_at, self._bounded = sorted(purposes), points_at, bounded
        self._lens = Gf.Camera()
        self._first: tuple[np.ndarray, np.ndarray] | None = None

    def aspect(self, time: float) -> float:
        """Width of the aperture over its height."""
        return self._lens.aspectRatio

    def shutter_interval(self, frame: float) -> tuple[float, float]:
        """A still: nobody asked for a shutter."""
        return 0.0, 0.0

    def over(self, shutter: Shutter, image_aspect: float, policy: str) -> CameraAtShutter:
        """The camera over ``shutter``; as :meth:`tpdwarp.usd.read.cameras.Camera.over`."""
        low, high = self._bounds(shutter.frame)
        axes = self.axes
        width, height, depth = np.abs(axes) @ np.maximum(high - low, SMALLEST_EXTENT)
        half_view = math.radians(0.5 * self._lens.GetFieldOfView(Gf.Camera.FOVHorizontal))
        distance = 0.5 * math.hypot(width, height) / math.tan(half_view) + 0.5 * depth
        position = 0.5 * (low + high) + distance * axes[2]
        bounds = self._lens.frustum.window
        window = conformed((bounds.min[0], bounds.max[0], bounds.min[1], bounds.max[1]), image_aspect, policy)
        near, far = 0.1 * (distance - 0.5 * depth), 2.0 * (distance + depth)
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

    @cached_property
    def axes(self) -> np.ndarray:
        """Its axes to the right, up and back as rows, shape [3, 3], the same for all frames."""
        right, up, back = np.eye(3) if self._up == "Y" else np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])
        low, high = self._drawn(self._start)
        width, height, depth = np.abs([right, up, back]) @ (high - low)
        least = FLAT * max(width, height, depth)
        if depth > least and height <= least < width:
            return np.array([right, -back, up])
        if depth > least and width <= least < height:
            return np.array([-back, up, right])
        return np.array([right, up, back])

    def _bounds(self, frame: float) -> tuple[np.ndarray, np.ndarray]:
        """Least and greatest corner of what is framed at a time code, shapes [3] and [3]."""
        if not self._bounded:
            return self._drawn(frame)
        cache = UsdGeom.BBoxCache(frame, self._purposes, useExtentsHint=True)
        try:
            found = cache.ComputeWorldBound(self._stage.GetPseudoRoot()).ComputeAlignedRange()
        except Tf.ErrorException:
            # Of xformOps that USD can make nothing of, which the transforms of what is drawn leave out.
            return self._drawn(frame)
        low, high = np.array(found.GetMin()), np.array(found.GetMax())
        return self._drawn(frame) if found.IsEmpty() or self._hides(low, high) else (low, high)

    def _hides(self, low: np.ndarray, high: np.ndarray) -> bool:
        """Whether bounds are none, or do not show what is drawn as the stage begins."""
        if not np.isfinite(high - low).all():
            return True
        least, greatest = self._drawn(self._start)
        drawn, outside = (greatest - least).max(), np.maximum(low - least, greatest - high).max()
        return bool(outside > STALE * drawn or drawn < STALE * (high - low).max())

    def _drawn(self, frame: float) -> tuple[np.ndarray, np.ndarray]:
        """Least and greatest corner of what is drawn at a time code, shapes [3] and [3]."""
        if frame == self._start and self._first is not None:
            return self._first
        parts = [points for points in self._points_at(frame) if len(points)]
        corners = np.array([[points.min(axis=0), points.max(axis=0)] for points in parts]).reshape(-1, 2, 3)
        found = (corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)) if parts else (np.zeros(3), np.zeros(3))
        if frame == self._start:
            self._first = found
        return found


def camera_light(camera: CameraAtShutter, meshes: Iterable[MeshAtShutter]) -> LightAtShutter:
    """Parallel light along a camera's view, which turns with it.

    It comes from the camera, not from behind: what lies behind the camera, as the walls around it do, lets it pass.
    """
    behind = (
        mesh.path for mesh in meshes if np.max((mesh.points - camera.position) @ camera.axes[2], initial=0.0) > 0.0
    )
    return LightAtShutter(
        CAMERA_LIGHT,
        LightKind.DISTANT,
        (CAMERA_LIGHT_IRRADIANCE,) * 3,
        camera.position,
        camera.axes,
        camera.position_motion,
        camera.axes_motion,
        passed=frozenset(behind),
    )
