"""Values of attributes, of the kind they are read as: anything else that a layer may hold is refused, by attribute.

What a picture can do without falls back to its schema's default instead.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from pxr import Usd

from tpdwarp.errors import InputError, WarnOnce

Shape = tuple[int | None, ...]
ROWS: Shape = (None, 3)
LIST: Shape = (None,)
NUMBER: Shape = ()
# How a warning ends that what an attribute holds is nothing that it takes.
ITS_DEFAULT = "its default is used"
# What is asked for in the place of a number that is none, that is not above 0, or that is below it.
FINITE, ABOVE_0, FROM_0 = "a finite value", "a finite value above 0", "a finite value of 0 or more"
# Types of USD that hold no numbers.
NO_NUMBERS = ("string", "token", "asset", "opaque", "group", "timecode", "pathExpression")


def raw_at(attribute: Usd.Attribute, time: float | None) -> object | None:
    """An attribute's value at a time code (None: its default); its schema's fallback where it is blocked, or None."""
    value = attribute.Get(Usd.TimeCode.Default() if time is None else time)
    if value is None and attribute:
        return _fallback(attribute)
    return value


def value_at(attribute: Usd.Attribute, time: float | None, shape: Shape | None = None) -> np.ndarray | None:
    """An attribute's value as float64 at a time code (None: its default); None where it has no value.

    Args:
        attribute: A numeric attribute.
        time: The time code.
        shape: The shape that is read, None for any size along an axis; None for any shape.

    Raises:
        InputError: Something else than numbers, or numbers of another shape.
    """
    value = raw_at(attribute, time)
    return None if value is None else numbers(value, attribute, shape)


def number_at(attribute: Usd.Attribute, time: float | None, default: float = 0.0) -> float:
    """A number at a time code; ``default`` where there is no value.

    Raises:
        InputError: Something else than a number.
    """
    value = value_at(attribute, time, NUMBER)
    return default if value is None else float(value)


def value_or_fallback(
    attribute: Usd.Attribute, time: float | None, warnings: WarnOnce, shape: Shape = NUMBER
) -> np.ndarray | None:
    """As :func:`value_at`; where an attribute holds something else than it should, its schema's fallback, and says so.

    As Hydra has it, which looks at values of the right type only.
    """
    try:
        return value_at(attribute, time, shape)
    except InputError as error:
        fallback = _fallback(attribute)
        warnings(error.prim, f"{error.message}; {ITS_DEFAULT}", f"{ITS_DEFAULT} for its type")
        return None if fallback is None else numbers(fallback, attribute, shape)


def number_or_fallback(
    attribute: Usd.Attribute, time: float | None, warnings: WarnOnce, default: float = 0.0
) -> float:
    """A number as :func:`value_or_fallback`; ``default`` where there is none."""
    value = value_or_fallback(attribute, time, warnings)
    return default if value is None else float(value)


def usable_number(
    attribute: Usd.Attribute,
    time: float | None,
    warnings: WarnOnce,
    wanted: str = FINITE,
    usable: Callable[[float], bool] = math.isfinite,
    default: float = 0.0,
) -> float:
    """A number as :func:`number_or_fallback`; its schema's fallback where it is none that means anything, and says so.

    Args:
        wanted: What is to be authored, in words.
        usable: Whether a number means anything.
        default: The number where the schema has no fallback.
    """
    value = number_or_fallback(attribute, time, warnings, default)
    if usable(value):
        return value
    fallback = _fallback(attribute)
    instead = default if fallback is None else float(fallback)
    kind = f"{attribute.GetName()} is unusable"
    warnings(str(attribute.GetPath()), f"holds {value:g}; {ITS_DEFAULT}, {instead:g} (author {wanted})", kind)
    return instead


def positive(value: float) -> bool:
    """Whether a number is finite and above 0."""
    return math.isfinite(value) and value > 0


def not_negative(value: float) -> bool:
    """Whether a number is finite and 0 or more."""
    return math.isfinite(value) and value >= 0


def indices_at(attribute: Usd.Attribute, time: float | None) -> np.ndarray:
    """A list of whole numbers at a time code, shape [n] int64; empty where there is no value.

    Raises:
        InputError: Something else than a list of whole numbers.
    """
    value = raw_at(attribute, time)
    if value is None:
        return np.zeros(0, np.int64)
    found = np.array(value)
    if found.ndim != 1 or (found.size and found.dtype.kind not in "iu"):
        raise _refusal(value, attribute)
    return found.astype(np.int64)


def indices_or_none(attribute: Usd.Attribute, time: float | None, warnings: WarnOnce) -> np.ndarray:
    """As :func:`indices_at`; empty where an attribute holds something else, which is said."""
    try:
        return indices_at(attribute, time)
    except InputError as error:
        warnings(error.prim, f"{error.message}; it is ignored", "indices are ignored for their type")
        return np.zeros(0, np.int64)


def numbers(value: object, attribute: Usd.Attribute, shape: Shape | None = None) -> np.ndarray:
    """A value as float64; ``attribute`` is what it comes from.

    Raises:
        InputError: Something else than numbers, or numbers of another shape.
    """
    found = np.array(value)
    fits = shape is None or (
        found.ndim == len(shape) and all(want in (None, have) for want, have in zip(shape, found.shape, strict=True))
    )
    if found.dtype.kind not in "biuf" or not fits:
        raise _refusal(value, attribute)
    return found.astype(np.float64)


def text_at(attribute: Usd.Attribute, time: float | None = None) -> str:
    """A token or string at a time code (by default, its default); empty where it is something else."""
    value = raw_at(attribute, time)
    return value if isinstance(value, str) else ""


def texts_at(attribute: Usd.Attribute, time: float | None = None) -> tuple[str, ...]:
    """A list of tokens or strings; empty where it is something else."""
    value = raw_at(attribute, time)
    try:
        found = tuple(value or ())
    except TypeError:
        return ()
    return found if all(isinstance(entry, str) for entry in found) else ()


def _fallback(attribute: Usd.Attribute) -> object | None:
    """The fallback of an attribute's schema, or None."""
    definition, name = attribute.GetPrim().GetPrimDefinition(), attribute.GetName()
    found = definition.GetAttributeFallbackValue(name)
    # Inputs of lights had no prefix until USD 21.02.
    return definition.GetAttributeFallbackValue(f"inputs:{name}") if found is None else found


def _refusal(value: object, attribute: Usd.Attribute) -> InputError:
    kind = attribute.GetTypeName()
    if str(kind).rstrip("[]") in NO_NUMBERS:
        kind = "numbers"
    return InputError(
        f"holds a value of type {type(value).__name__}, which cannot be read (author {kind})",
        prim=str(attribute.GetPath()),
    )
