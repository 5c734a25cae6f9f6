"""Lights that shine differently in different directions: cones, focused beams, flat and cylindrical surfaces."""

import math

import numpy as np
import warp as wp

from tpdwarp.scene.description import EmissionProfile, LightAtShutter

# A smoothstep over less than this [rad] is a step.
NARROWEST = wp.constant(1.0e-6)


def shaping_values(light: LightAtShutter) -> tuple[float, float, float]:
    """Angle, softness and focus of a light for kernels, with its profile.

    The angle is below 0 for a light that shines alike in all directions. The cosine of a flat surface adds one to the
    focus; a focus below 0 stands for the sine of a cylinder, which has no cone.
    """
    if light.profile == EmissionProfile.SINE:
        return 2.0 * math.pi, 0.0, -1.0
    cosine = 1.0 if light.profile == EmissionProfile.COSINE else 0.0
    if light.shaping is None:
        return (2.0 * math.pi, 0.0, cosine) if cosine else (-1.0, 0.0, 0.0)
    return light.shaping.angle, light.shaping.softness, light.shaping.focus + cosine


def is_shaped(light: LightAtShutter) -> bool:
    """Whether a light shines differently in different directions."""
    return light.shaping is not None or light.profile != EmissionProfile.UNIFORM


def shaping_axis(light: LightAtShutter) -> tuple[np.ndarray, np.ndarray]:
    """The axis [3] about which a light is shaped, at mid shutter, and its change over the shutter."""
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
def shaped(shaping: wp.vec3, axis: wp.vec3, w: wp.vec3) -> float:
    """Intensity along ω over that along the unit ``axis``, as :class:`tpdwarp.scene.description.Shaping` has it."""
    if shaping[0] < 0.0:
        return 1.0
    cosine = wp.clamp(wp.dot(axis, w), -1.0, 1.0)
    if shaping[2] < 0.0:
        return wp.sqrt(1.0 - cosine * cosine)
    theta = wp.acos(cosine)
    if theta >= shaping[0]:
        return 0.0
    intensity = float(1.0)
    if shaping[2] > 0.0:
        intensity = wp.pow(wp.max(cosine, 0.0), shaping[2])
    fade = shaping[0] * shaping[1]
    if fade > NARROWEST:
        s = wp.clamp((theta - shaping[0] + fade) / fade, 0.0, 1.0)
        intensity *= 1.0 - s * s * (3.0 - 2.0 * s)
    return intensity
