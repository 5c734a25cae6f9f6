"""Holding frames out behind what another renderer saw nearer, by its depth."""

from __future__ import annotations

import os
from collections.abc import Mapping

import numpy as np

from tpdwarp.errors import InputError
from tpdwarp.io.digests import file_digest
from tpdwarp.io.frame_names import FrameNames
from tpdwarp.io.image_region import ImageRegion
from tpdwarp.io.images import StoredImage, read_stored

# Channels that hold light; what else there is describes geometry, and stays.
_LIGHT = ("R", "G", "B", "A", "caustic", "direct", "irradiance", "shadow")
# Depths of the same point differ by this part of themselves where a host writes half floats.
_HALF = 1e-3
# What hosts call depth: the last parts of a channel's name, in the order in which they are taken.
_DEPTHS = ("z", "depth.z", "depth.v", "depth.y", "depth.r", "depth")


def held_out(
    channels: dict[str, np.ndarray], template: str, frame: float, region: ImageRegion
) -> dict[str, np.ndarray]:
    """The channels of a frame, held out by the images that a setting names; as they are where it names none.

    Raises:
        InputError: As for :meth:`Holdouts.applied`.
    """
    return Holdouts(template).applied(frame, channels, region) if template else channels


class Holdouts:
    """Frames of a host's render whose depth hides what lies behind it.

    Depth is the distance along the camera's axis [scene units], as ``Z`` here and as Arnold, Cycles, Karma and
    RenderMan write it. A pixel is held out whole, as depth is not filtered.

    Args:
        template: The host's images, with ``####`` where the frame number goes.
    """

    def __init__(self, template: str) -> None:
        self._names = FrameNames(template)

    def path(self, frame: float) -> str:
        """The host's image of a frame."""
        return self._names.path(frame)

    def digest(self, frame: float) -> str:
        """Hash of the host's image of a frame; ``none`` where it cannot be read."""
        try:
            return file_digest(self.path(frame))
        except OSError:
            return "none"

    def applied(self, frame: float, channels: Mapping[str, np.ndarray], region: ImageRegion) -> dict[str, np.ndarray]:
        """The channels of a frame, with light and alpha 0 where the host saw something nearer.

        Args:
            frame: Which frame it is.
            channels: Its channels with ``Z``, each [height, width].
            region: What part of the image they are.

        Raises:
            InputError: The host's image is missing, has no depth, or is not of the size of this one.
        """
        host, own = self._depth(frame, region), channels["Z"]
        # The same surface is met elsewhere within a pixel by both.
        hidden = host < own - (slope(own) + _HALF * np.abs(own))
        held = {name: values for name, values in channels.items() if _is_light(name)}
        return {**channels, **{name: np.where(hidden, np.float32(0), values) for name, values in held.items()}}

    def _depth(self, frame: float, region: ImageRegion) -> np.ndarray:
        path = self.path(frame)
        image = read_stored(path)
        left, top, *_, width, height = image.window
        if (width, height) != (region.width, region.height):
            raise InputError(
                f"is {width} × {height} pixels, the frame {region.width} × {region.height} (they must be the same)",
                file=path,
            )
        # What the host's data window leaves out hides nothing.
        depth = np.full((height, width), np.inf, np.float32)
        left, top = left - image.window[2], top - image.window[3]
        rows, columns = image.pixels.shape[:2]
        ahead_x, ahead_y = max(-left, 0), max(-top, 0)
        inside = image.pixels[ahead_y : height - top, ahead_x : width - left, _depth_channel(image, path)]
        depth[top + ahead_y : top + rows, left + ahead_x : left + columns] = inside
        return depth[region.above : region.below, region.first : region.end]


def slope(depth: np.ndarray) -> np.ndarray:
    """How much the depth of a surface changes within a pixel, [height, width].

    Of both neighbours of a pixel in a row or a column the one nearer in depth counts, so that a silhouette is no slope.
    """
    found = np.zeros_like(depth)
    for axis in (0, 1):
        steps = np.abs(np.diff(depth, axis=axis))
        edge = np.full_like(np.take(depth, [0], axis), np.inf)
        nearer = np.minimum(np.concatenate([edge, steps], axis), np.concatenate([steps, edge], axis))
        found += np.where(np.isfinite(nearer), nearer, 0.0)
    return found


def _is_light(channel: str) -> bool:
    group = channel.partition(".")[0]
    return group in _LIGHT or group.startswith(("caustic_", "irradiance_"))


def _depth_channel(image: StoredImage, path: str | os.PathLike[str]) -> int:
    lowered = [name.lower() for name in image.names]
    for wanted in _DEPTHS:
        for index, name in enumerate(lowered):
            # N.Z and P.Z are no depths.
            if name == wanted or (wanted != "z" and name.endswith(f".{wanted}")):
                return index
    raise InputError(f"has no depth (a channel Z; there are {', '.join(image.names[:12])})", file=os.fspath(path))
