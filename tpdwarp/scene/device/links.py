"""Links between lights and surfaces: what a light does not shine on, and what it passes as if it were not there."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
import warp as wp

from tpdwarp.scene.description import LightAtShutter
from tpdwarp.scene.device.geometry import Surfaces
from tpdwarp.scene.device.intersection import is_plane_left, plane_of
from tpdwarp.scene.device.presence import LEAST_SHARE, MOST_LAYERS, STEP, presence_at
from tpdwarp.scene.device.ray_tree import first_met
from tpdwarp.scene.device.textures import TextureArrays

# Bits of a link: the light does not shine on an object; the light passes through it.
UNLIT = wp.constant(1)
PASSED = wp.constant(2)


def links_of(lights: Sequence[LightAtShutter], paths: Sequence[str]) -> np.ndarray:
    """The links of lights (rows) to objects of these paths (columns), shape [n, m] int32; no rows without any."""
    if not any(light.linked for light in lights):
        return np.zeros((0, len(paths)), np.int32)
    rows = [
        [UNLIT * (path in light.unlit) + PASSED * (path in light.passed) for path in paths] if light.linked
        else [0] * len(paths)
        for light in lights
    ]  # fmt: skip
    return np.array(rows, np.int32).reshape(len(lights), len(paths))


@cache
def linked_share(partial: bool) -> wp.Function:
    """The function that gives the share of a light that gets from x + distance·ω to x, through what it passes.

    Args:
        partial: Whether surfaces may be there in part.
    """

    @wp.func
    def share_of_light(
        surfaces: Surfaces,
        textures: TextureArrays,
        links: wp.array2d(dtype=wp.int32),
        row: int,
        x: wp.vec3,
        w: wp.vec3,
        offset: wp.vec3,
        distance: float,
    ) -> float:
        side = wp.normalize(offset)
        reach = wp.length(offset)
        share = float(1.0)
        start = float(0.0)
        for _layer in range(MOST_LAYERS):
            met = first_met(surfaces.tree, x + offset + start * w, w, distance - start)
            if met.triangle < 0:
                return share
            if (links[row, surfaces.object_of[met.triangle]] & PASSED) == 0:
                if not is_plane_left(plane_of(surfaces, met.triangle), x, side, reach):
                    if wp.static(partial):
                        beta = wp.vec3(met.u, met.v, 1.0 - met.u - met.v)
                        share *= 1.0 - presence_at(surfaces, textures, met.triangle, beta)
                        if share < LEAST_SHARE:
                            return 0.0
                    else:
                        return 0.0
            start += met.distance + STEP
            if start >= distance:
                return share
        return 0.0

    return share_of_light
