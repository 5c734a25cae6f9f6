"""Frames of an animation from specifications such as ``1:24,30:40x2``."""

from __future__ import annotations

import re

from pxr import Tf, UsdUtils

from tpdwarp.errors import InputError

MOST_FRAMES = 1_000_000

_NUMBER = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)"
_SPEC = re.compile(rf"({_NUMBER})(?:[:-]({_NUMBER})(?:x({_NUMBER}))?)?")
# Strides such as 0.1 add up to 0.30000000000000004; nobody means frames closer together than this many decimals.
_DECIMALS = 9


def frames_of(spec: str) -> tuple[float, ...]:
    """The frames that ``spec`` names, each once, in its order.

    Args:
        spec: Comma separated ``frame``, ``first:last`` or ``first:lastxstride``, as usdrecord takes them, backwards
            too; ``first-last`` means ``first:last``.

    Raises:
        InputError: ``spec`` cannot be understood, or names more than a million frames.
    """
    frames: dict[float, None] = {}
    for part in map(str.strip, spec.split(",")):
        found = _SPEC.fullmatch(part)
        if found is None:
            raise _refusal(spec, f"{part!r} is no frame or range" if part else "a frame or range is missing")
        first, last, stride = found.groups()
        canonical = first if last is None else f"{first}:{last}" + (f"x{stride}" if stride else "")
        try:
            selected = UsdUtils.TimeCodeRange.CreateFromFrameSpec(canonical)
        except Tf.ErrorException as error:
            reason = re.search(r"'([^']*)'\s*$", str(error))
            raise _refusal(spec, reason.group(1) if reason else f"{part!r} is no range") from error
        frames.update(dict.fromkeys(_values(selected, spec)))
        if len(frames) > MOST_FRAMES:
            raise _refusal(spec, f"that is more than {MOST_FRAMES} frames")
    return tuple(frames)


def frames_between(start: float, end: float) -> tuple[float, ...]:
    """The frames ``start``, ``start`` + 1, … up to ``end``; ``start`` alone where ``end`` lies before it.

    Raises:
        InputError: There are more than a million.
    """
    return tuple(_values(UsdUtils.TimeCodeRange(start, max(start, end)), f"{start:g}:{end:g}"))


def _values(selected: UsdUtils.TimeCodeRange, spec: str) -> list[float]:
    first, last = selected.startTimeCode.GetValue(), selected.endTimeCode.GetValue()
    if not abs(last - first) < abs(selected.stride) * MOST_FRAMES:
        raise _refusal(spec, f"that is more than {MOST_FRAMES} frames")
    # Adding 0.0 turns −0.0 into 0.0, whose file name has no sign.
    return [round(code.GetValue(), _DECIMALS) + 0.0 for code in selected]


def _refusal(spec: str, why: str) -> InputError:
    return InputError(f"--frames {spec!r}: {why} (write for instance 1:24,30:40x2)")
