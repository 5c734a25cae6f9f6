"""Lights on the device."""

from __future__ import annotations

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.scene.description import LightAtShutter, LightKind
from tpdwarp.scene.normalization import Normalization


@wp.struct
class LightArrays:
    """Lights in the tracer's units: direction of travel or position, and how these change over the shutter.

    ``power`` is irradiance at normal incidence per square unit, or radiant intensity.
    """

    distant: wp.array(dtype=wp.int32)
    place: wp.array(dtype=wp.vec3)
    place_motion: wp.array(dtype=wp.vec3)
    power: wp.array(dtype=wp.vec3)


def light_arrays(lights: tuple[LightAtShutter, ...], normalization: Normalization, launcher: Launcher) -> LightArrays:
    """The kernel's view of ``lights``."""
    out = LightArrays()
    distant = np.array([light.kind == LightKind.DISTANT for light in lights], bool)
    place, motion, power = (np.zeros((len(lights), 3)) for _ in range(3))
    for i, light in enumerate(lights):
        power[i] = normalization.light_power(light)
        if distant[i]:
            place[i], motion[i] = -light.axes[2], -light.axes_motion[2]
        else:
            place[i] = normalization.points(light.position[None])[0]
            motion[i] = light.position_motion * normalization.scale
    out.distant = launcher.array(distant.astype(np.int32), wp.int32)
    out.place = launcher.array(place.astype(np.float32), wp.vec3)
    out.place_motion = launcher.array(motion.astype(np.float32), wp.vec3)
    out.power = launcher.array(power.astype(np.float32), wp.vec3)
    return out
