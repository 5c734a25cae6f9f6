"""How paths end, and where the flux of those that met something specular went: summed up where they are traced."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
import warp as wp

from tpdwarp.photons.energy import BELOW_CUTOFF, EnergyAccount


class Fate(IntEnum):
    """How a path ended."""

    DIRECT = 0  # met no specular surface: direct light's business
    DEPOSITED = 1
    ESCAPED = 2
    DEPTH = 3
    NONFINITE = 4


# Kernels know no enumerations.
FATE_DIRECT = wp.constant(int(Fate.DIRECT))
FATE_DEPOSITED = wp.constant(int(Fate.DEPOSITED))
FATE_ESCAPED = wp.constant(int(Fate.ESCAPED))
FATE_DEPTH = wp.constant(int(Fate.DEPTH))
FATE_NONFINITE = wp.constant(int(Fate.NONFINITE))


@wp.struct
class FluxSums:
    """Where the flux of some paths went, summed over channels, in the tracer's units.

    It is ``sent`` by lights, counted there and not added up from where it went, so that an account can show that
    something is missing. ``culled`` are branches below the cutoff, ``retried`` counts hits at the second try.
    """

    sent: wp.float64
    deposited: wp.float64
    escaped: wp.float64
    too_deep: wp.float64
    not_finite: wp.float64
    absorbed: wp.float64
    culled: wp.float64
    retried: int


@wp.func
def channel_sum(flux: wp.vec3) -> wp.float64:
    """The sum over channels."""
    return wp.float64(flux[0]) + wp.float64(flux[1]) + wp.float64(flux[2])


@wp.func
def with_path(
    sums: FluxSums, fate: int, sent: wp.vec3, flux: wp.vec3, absorbed: wp.vec3, culled: wp.vec3, retried: int
) -> FluxSums:
    """The sums with another path.

    Args:
        sent: Its part of what lights sent that no other path has counted.
        flux: What it carried where it ended.
    """
    out = sums
    out.retried += retried
    if fate != FATE_DIRECT:
        out.sent += channel_sum(sent)
        out.absorbed += channel_sum(absorbed)
        out.culled += channel_sum(culled)
        left = channel_sum(flux)
        if fate == FATE_DEPOSITED:
            out.deposited += left
        elif fate == FATE_ESCAPED:
            out.escaped += left
        elif fate == FATE_DEPTH:
            out.too_deep += left
        else:
            out.not_finite += left
    return out


def add_sums(account: EnergyAccount, sums: np.ndarray, unit: float) -> None:
    """Adds the paths of one launch to an account.

    Args:
        sums: Rows of :class:`FluxSums`, structured, shape [n].
        unit: The tracer's unit of power [W].
    """

    def watts(name: str) -> float:
        return unit * float(sums[name].sum())

    for name in ("sent", "deposited", "escaped", "absorbed"):
        setattr(account, name, getattr(account, name) + watts(name))
    for cause, name in (
        (BELOW_CUTOFF, "culled"),
        ("too many bounces", "too_deep"),
        ("not finite", "not_finite"),
    ):
        if value := watts(name):
            account.lost[cause] = account.lost.get(cause, 0.0) + value
    if retried := int(sums["retried"].sum()):
        account.counts["hits at the second try"] = account.counts.get("hits at the second try", 0) + retried
