"""What a camera sees of light, roughly: which photons are worth finer cells (:mod:`tpdwarp.estimators.seen_light`)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
import warp as wp

from tpdwarp.clock import Clock
from tpdwarp.footprints.irradiance import QueryArrays
from tpdwarp.footprints.shaping import PixelSize, pixel_on_plane, tangent_frame
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.scene.device.loading import LoadedScene, SceneLoader
from tpdwarp.settings import Settings
from tpdwarp.view.camera import camera_of, pixel_size
from tpdwarp.view.queries import CameraView
from tpdwarp.view.query_batches import QueryBatch

# Pixels of the picture that is looked at, about. Chosen, not derived: a side of the picture is 64 of them.
PIXELS = 4096


@wp.kernel(enable_backward=False)
def surroundings(
    base: int,
    queries: QueryArrays,
    pixel: PixelSize,
    # Out
    lower: wp.array(dtype=wp.vec3),
    upper: wp.array(dtype=wp.vec3),
):
    """A box around each visible point that holds what its pixel and those beside it see of its plane, all the while."""
    i = base + wp.tid()
    x = queries.position[i]
    n = queries.normal[i]
    frame = tangent_frame(n)
    seen = pixel_on_plane(pixel, x, n, frame)
    half = wp.vec3()
    for side in range(2):
        along = wp.where(side == 0, seen.p, seen.q)
        half += wp.abs(along[0] * frame.e1 + along[1] * frame.e2)
    if queries.motion.shape[0] > 0:
        half += wp.abs(0.5 * queries.motion[i])
    lower[i] = x - half
    upper[i] = x + half


@wp.kernel(enable_backward=False)
def meet(
    base: int,
    boxes: wp.uint64,
    lower: wp.array(dtype=wp.vec3),
    upper: wp.array(dtype=wp.vec3),
    # Out
    met: wp.array(dtype=wp.bool),
):
    """Whether each of some boxes has anything in common with any of those of a tree."""
    i = base + wp.tid()
    query = wp.bvh_query_aabb(boxes, lower[i], upper[i])
    number = int(0)
    met[i] = wp.bvh_query_next(query, number)


class CameraSight:
    """What the camera of a frame sees.

    Args:
        settings: How it is rendered.
        loader: Loaded the scenes.
        size: Pixels of the frame across and down.
        scenes: The scenes of the segments of a shutter.
        clock: Where the time goes.
    """

    def __init__(
        self,
        settings: Settings,
        loader: SceneLoader,
        size: tuple[int, int],
        scenes: Sequence[LoadedScene],
        clock: Clock,
    ) -> None:
        self._settings, self._loader, self._scenes, self._clock = settings, loader, list(scenes), clock
        shrunk = min(1.0, math.sqrt(PIXELS / (size[0] * size[1])))
        self._size = tuple(max(1, round(shrunk * side)) for side in size)

    def frames(self, photons: PhotonMap) -> np.ndarray:
        """Which photons lie before the camera, whether or not anything hides them, shape [n]."""
        camera = self._scenes[len(self._scenes) // 2].scene.camera
        points = self._loader.normalization.world_points(photons.position) - camera.position
        x, y, z = camera.axes @ points.T
        depth = 1.0 if camera.orthographic else np.maximum(-z, np.finfo(np.float64).tiny)
        left, right, bottom, top = camera.window
        inside = (x >= left * depth) & (x <= right * depth) & (y >= bottom * depth) & (y <= top * depth)
        return inside & (z < 0.0)

    def sees(self, photons: PhotonMap, reach: float) -> np.ndarray:
        """Which photons light anything that the camera sees, up to ``reach`` of their steps beside them, shape [n]."""
        if not len(photons) or self._boxes is None:
            return np.zeros(len(photons), bool)
        with self._clock.stage("plan"):
            launcher = self._loader.launcher
            half = np.float32(reach) * (np.abs(photons.dxdu) + np.abs(photons.dxdv)) + 0.5 * np.abs(photons.dxdt)
            if len(photons.dxda):
                half = half + np.abs(photons.dxda) + np.abs(photons.dxdb)
            met = launcher.zeros(len(photons), wp.bool)
            ends = [launcher.array(photons.position + sign * half, wp.vec3) for sign in (-1.0, 1.0)]
            launcher(meet, len(photons), [self._boxes.id, *ends, met])
            return met.numpy()

    @cached_property
    def _boxes(self) -> wp.Bvh | None:
        """Boxes around visible points; None without any."""
        launcher, normalization = self._loader.launcher, self._loader.normalization
        settings = replace(self._settings, samples=1, aovs=())
        seen_by = normalization, launcher, *self._size, self._clock
        camera = self._scenes[len(self._scenes) // 2].scene.camera
        pixel = pixel_size(camera_of(camera, *self._size, normalization), 1)
        lower, upper = [], []
        for seen in CameraView(self._scenes, settings, *seen_by).look():
            if isinstance(seen, QueryBatch):
                ends = [launcher.zeros(len(seen.pixels), wp.vec3) for _ in range(2)]
                launcher(surroundings, len(seen.pixels), [seen.queries, pixel, *ends])
                for found, end in zip((lower, upper), ends, strict=True):
                    found.append(end.numpy())
        if not lower:
            return None
        return wp.Bvh(*(launcher.array(np.concatenate(ends), wp.vec3) for ends in (lower, upper)))
