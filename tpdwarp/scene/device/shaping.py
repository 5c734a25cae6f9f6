"""Shaped lights: cones that fade towards their rim, and beams focused along their axis."""

import warp as wp

from tpdwarp.scene.description import LightAtShutter

# A smoothstep over less than this [rad] is a step.
NARROWEST = wp.constant(1.0e-6)


def shaping_values(light: LightAtShutter) -> tuple[float, float, float]:
    """Angle, softness and focus of a light for kernels; an angle below 0 for one that is not shaped."""
    shaping = light.shaping
    return (-1.0, 0.0, 0.0) if shaping is None else (shaping.angle, shaping.softness, shaping.focus)


@wp.func
def shaped(shaping: wp.vec3, axis: wp.vec3, w: wp.vec3) -> float:
    """Intensity along ω over that along the unit ``axis``, as :class:`tpdwarp.scene.description.Shaping` has it."""
    if shaping[0] < 0.0:
        return 1.0
    cosine = wp.clamp(wp.dot(axis, w), -1.0, 1.0)
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
