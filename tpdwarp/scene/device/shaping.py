"""Lights that shine differently in different directions: cones, focused beams, flat and cylindrical surfaces."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import warp as wp

from tpdwarp.scene.description import PROFILE_COUNT, EmissionProfile, LightAtShutter, Shaping

# A smoothstep over less than this [rad] is a step.
NARROWEST = wp.constant(1.0e-6)
# The shaping of a light in kernels: angle, softness and focus, then the factors of its profile, the first of which is
# below 0 where it has none; then what its surface multiplies that by (``OF_SINE``, ``OF_COSINE``, ``OF_SHOWN`` or 0 for
# nothing), the axis of the shaping where that of the surface is another, and the rows of what tells the area shown.
SHAPING_COUNT = 3 + PROFILE_COUNT + 4 + 9
ShapingValues = wp.types.vector(length=SHAPING_COUNT, dtype=wp.float32)
PROFILE_STEP = wp.constant(math.pi / (PROFILE_COUNT - 1))
LAST_OF_PROFILE = wp.constant(PROFILE_COUNT - 1)
SURFACE = wp.constant(3 + PROFILE_COUNT)
OF_SINE, OF_COSINE, OF_SHOWN = wp.constant(1.0), wp.constant(2.0), wp.constant(3.0)
SHOWN = wp.constant(3 + PROFILE_COUNT + 4)


def shaping_values(light: LightAtShutter) -> list[float]:
    """The shaping of a light for kernels, with the profile of its surface.

    The angle is below 0 for a light that shines alike in all directions. The cosine of a flat surface adds one to the
    focus where both are about one axis.
    """
    shaping, own = light.shaping or Shaping(2.0 * math.pi), light.cone_axis[0]
    if light.profile == EmissionProfile.SINE:
        return _values(shaping, float(OF_SINE), own)
    if light.profile == EmissionProfile.SHOWN:
        return _values(shaping, float(OF_SHOWN), own, light.shown)
    cosine = light.profile == EmissionProfile.COSINE
    if cosine and light.shaped_about is not None:
        return _values(shaping, float(OF_COSINE), own)
    if light.shaping is None and not cosine:
        return _values(None)
    return _values(replace(shaping, focus=shaping.focus + float(cosine)))


def shaping_of_surface(light: LightAtShutter) -> list[float]:
    """The shaping of a light for kernels, without the profile of its surface, which its shape says."""
    return _values(light.shaping)


def _values(
    shaping: Shaping | None,
    surface: float = 0.0,
    axis: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0),
    shown: np.ndarray | None = None,
) -> list[float]:
    shaping = shaping or Shaping(-1.0)
    profile = shaping.profile or (-1.0,) * PROFILE_COUNT
    rows = [0.0] * 9 if shown is None else shown.ravel().tolist()
    return [shaping.angle, shaping.softness, shaping.focus, *profile, surface, *map(float, axis), *rows]


def is_shaped(light: LightAtShutter) -> bool:
    """Whether a light shines differently in different directions."""
    return light.shaping is not None or light.profile != EmissionProfile.UNIFORM


def shaping_axis(light: LightAtShutter) -> tuple[np.ndarray, np.ndarray]:
    """The axis [3] of what a light's surface and shaping do by direction, at mid shutter, and its change over the
    shutter; where they have two, that of the surface."""
    if light.profile == EmissionProfile.SINE:
        return light.axes[0], light.axes_motion[0]
    return -light.axes[2], -light.axes_motion[2]


@wp.func
def across_of(w: wp.vec3) -> wp.vec3:
    """A unit vector across a direction ω, from which the disc that a sphere looks like there is spanned."""
    if wp.abs(w[0]) > 0.5:
        return wp.normalize(wp.vec3(w[2], 0.0, -w[0]))
    return wp.normalize(wp.vec3(0.0, -w[2], w[1]))


@wp.func
def area_shown(shaping: ShapingValues, w: wp.vec3) -> float:
    """The area that a light shows along ω, by what it shows on average, of one that shines by that."""
    total = float(0.0)
    for row in range(3):
        first = SHOWN + 3 * row
        along = shaping[first] * w[0] + shaping[first + 1] * w[1] + shaping[first + 2] * w[2]
        total += along * along
    return wp.sqrt(total)


@wp.func
def shaped(shaping: ShapingValues, axis: wp.vec3, w: wp.vec3) -> float:
    """Intensity along ω over that along the unit ``axis``, as :class:`tpdwarp.scene.description.Shaping` has it."""
    if shaping[0] < 0.0:
        return 1.0
    cosine = wp.clamp(wp.dot(axis, w), -1.0, 1.0)
    intensity = float(1.0)
    if shaping[SURFACE] > 0.0:
        intensity = wp.max(cosine, 0.0)
        if shaping[SURFACE] == OF_SINE:
            intensity = wp.sqrt(1.0 - cosine * cosine)
        elif shaping[SURFACE] == OF_SHOWN:
            intensity = area_shown(shaping, w)
        own = wp.vec3(shaping[SURFACE + 1], shaping[SURFACE + 2], shaping[SURFACE + 3])
        cosine = wp.clamp(wp.dot(own, w), -1.0, 1.0)
    theta = wp.acos(cosine)
    if theta >= shaping[0]:
        return 0.0
    if shaping[2] > 0.0:
        intensity *= wp.pow(wp.max(cosine, 0.0), shaping[2])
    fade = shaping[0] * shaping[1]
    if fade > NARROWEST:
        s = wp.clamp((theta - shaping[0] + fade) / fade, 0.0, 1.0)
        intensity *= 1.0 - s * s * (3.0 - 2.0 * s)
    if shaping[3] >= 0.0:
        place = theta / PROFILE_STEP
        below = wp.min(int(place), LAST_OF_PROFILE - 1)
        intensity *= wp.lerp(shaping[3 + below], shaping[4 + below], place - float(below))
    return intensity
