"""Primvars over time, flattened: indexed ones are expanded at each sample, because indices may change as well."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from pxr import UsdGeom

from tpdwarp.errors import InputError
from tpdwarp.usd.read.samples import SampledArray
from tpdwarp.usd.read.values import ROWS, Shape, indices_at, numbers, value_at


def flattened(
    primvar: UsdGeom.Primvar,
    file: str,
    cubic: bool = False,
    linked: Callable[[float, float], bool] | None = None,
    shape: Shape = ROWS,
) -> SampledArray:
    """A vector primvar as rows over time, shape [n, 3] (or ``shape``) at each sample.

    Raises (when read):
        InputError: Values that are not finite, or indices out of range.
    """
    values, indices = primvar.GetAttr(), primvar.GetIndicesAttr()
    times = sorted({*values.GetTimeSamples(), *(indices.GetTimeSamples() if indices else ())})

    def read(time: float | None) -> np.ndarray | None:
        rows = value_at(values, time)
        if rows is None:
            return None
        # A constant primvar may be a single value instead of an array of one.
        rows = numbers(rows[None] if rows.ndim == 1 else rows, values, shape)
        require_finite(rows, file, f"{values.GetPath()}", time)
        if not primvar.IsIndexed():
            return rows
        chosen = indices_at(indices, time)
        if chosen.size and (chosen.min() < 0 or chosen.max() >= len(rows)):
            raise InputError(
                f"an index lies outside the {len(rows)} values (author indices from 0 to {len(rows) - 1})",
                file,
                str(indices.GetPath()),
            )
        return rows[chosen]

    return SampledArray(times, read, cubic, linked=linked)


def require_finite(values: np.ndarray, file: str, attribute: str, time: float | None) -> None:
    """Refuses NaN and infinity.

    Raises:
        InputError: Naming the attribute and the time.
    """
    if not np.isfinite(values).all():
        when = "" if time is None else f" at time code {time:g}"
        raise InputError(f"holds NaN or infinity{when} (author finite values)", file, attribute)
