"""From a state at any time to its middle and its displacement over a shutter.

The rules, the same for meshes, lights and cameras:

- The state is evaluated at mid shutter, not averaged from the ends. Its motion is the difference of the ends, or, for
  cubic motion, the derivative at the middle times the exposure.
- A shutter that reaches past the end of the animation continues with the backward difference over the exposure (over
  one frame for a still), and before the start with the forward difference: nothing stops dead at the last frame.
- An animation of one moment, as velocities at one sample make it, goes on as they say.
- A frame that itself lies outside the animation holds the nearest end.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from pxr import Usd, UsdGeom

from tpdwarp.errors import WarnOnce
from tpdwarp.scene.description import Shutter
from tpdwarp.usd.read.values import not_negative

# A thousandth of a frame: the central difference errs by 2e-7 of the third derivative, and rounding stays below 1e-12.
DERIVATIVE_STEP = 1e-3

State = tuple[np.ndarray, ...]


def over_shutter(
    state: Callable[[float], State], shutter: Shutter, span: tuple[float, float], cubic: bool = False
) -> tuple[State, State | None]:
    """A state at mid shutter and its displacement over the shutter.

    Args:
        state: Arrays at a time code; must keep their shapes over the shutter.
        shutter: The shutter.
        span: First and last time code of the animation of this thing.
        cubic: Whether the motion is the derivative at the middle times the exposure.

    Returns:
        The arrays at mid shutter, and their displacements (None where the shutter has no duration or nothing moved).
    """
    at = _continued(state, shutter, span)
    middle = at(shutter.middle)
    if shutter.exposure <= 0:
        return middle, None
    if cubic:
        step = min(DERIVATIVE_STEP, 0.5 * shutter.exposure)
        opening, closing = at(shutter.middle - step), at(shutter.middle + step)
        scale = 0.5 * shutter.exposure / step
    else:
        opening, closing, scale = at(shutter.open), at(shutter.close), 1.0
    motions = tuple(scale * (after - before) for before, after in zip(opening, closing, strict=True))
    return middle, motions if any(np.any(motion) for motion in motions) else None


def blur_scale(prim: Usd.Prim, frame: float, warnings: WarnOnce) -> float:
    """What ``motion:blurScale`` makes of a prim's shutter at a time code; 1 where it means nothing, which is said."""
    scale = UsdGeom.MotionAPI(prim).ComputeMotionBlurScale(frame)
    if not_negative(scale):
        return scale
    warnings(f"{prim.GetPath()}.motion:blurScale", f"amounts to {scale:g}; 1 is used (author 0 or more)")
    return 1.0


def blur_scaled(shutter: Shutter, scale: float) -> Shutter:
    """The shutter with its interval scaled about the frame."""
    if scale == 1.0:
        return shutter
    frame = shutter.frame
    return Shutter(frame, frame + scale * (shutter.open - frame), frame + scale * (shutter.close - frame))


def touched(shutter: Shutter, span: tuple[float, float]) -> tuple[float, float]:
    """First and last time code at which :func:`over_shutter` evaluates a state."""
    low, high = span
    if low == high == shutter.frame:
        return shutter.open, shutter.close
    first, last = (min(max(time, low), high) for time in (shutter.open, shutter.close))
    if low <= shutter.frame <= high:
        if shutter.close > high:
            first = min(first, high - _reach(shutter, span))
        if shutter.open < low:
            last = max(last, low + _reach(shutter, span))
    return first, last


def _reach(shutter: Shutter, span: tuple[float, float]) -> float:
    """Length of the difference that continues a motion past the end of its animation."""
    return min(shutter.exposure if shutter.exposure > 0 else 1.0, span[1] - span[0])


def _continued(
    state: Callable[[float], State], shutter: Shutter, span: tuple[float, float]
) -> Callable[[float], State]:
    low, high = span
    if low == high == shutter.frame:
        return state
    reach = _reach(shutter, span)
    inside = low <= shutter.frame <= high and reach > 0
    known: dict[float, State] = {}

    def held(time: float) -> State:
        time = min(max(time, low), high)
        if time not in known:
            known[time] = state(time)
        return known[time]

    def at(time: float) -> State:
        if low <= time <= high or not inside:
            return held(time)
        end, inner = (high, high - reach) if time > high else (low, low + reach)
        step = (time - end) / (end - inner)
        return tuple(p + step * (p - q) for p, q in zip(held(end), held(inner), strict=True))

    return at
