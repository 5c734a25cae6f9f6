"""Branches of a path at dielectrics, as photons and camera rays take them.

At a dielectric both branches are followed. Where light can be reflected or refracted a path decides; mirrors and total
internal reflection leave it no choice. A path is named by a mask whose bit b says that it was reflected at decision b.
The first path follows mask 0 (always refracted) and reports the decisions whose reflected share is worth following;
others follow those, and report in turn. So every path has an identity that stays the same from frame to frame, and what
a branch carries is exact rather than a matter of chance.
"""

from __future__ import annotations

import numpy as np
import warp as wp

# Decisions that a mask, of 32 bits with a sign, has bits for; where a path has more, reflected branches are culled.
MOST_DECISIONS = wp.constant(31)


@wp.struct
class Branch:
    """What a path does at a dielectric.

    ``throughput`` is what it carries on, ``decided`` is 1 where there was a choice. ``reported`` has the bit of this
    decision where the other branch, which carries ``other``, is to be followed by another path; ``culled`` is that
    branch's share where it is too faint for that.
    """

    reflected: bool
    throughput: wp.vec3
    decided: int
    reported: int
    other: wp.vec3
    culled: wp.vec3


@wp.func
def first_open_decision(mask: int) -> int:
    """Number of the first decision after the last reflection in ``mask``.

    Branches at earlier decisions were reported, and counted, by the paths that this one stems from.
    """
    number = int(0)
    while (mask >> number) > 0:
        number += 1
    return number


@wp.func
def take_branch(
    mask: int, decision: int, first_open: int, reflectance: float, throughput: wp.vec3, cutoff: float
) -> Branch:
    """Follows ``mask`` at a dielectric: Fresnel's share R to the reflected branch, 1 − R to the refracted one.

    Args:
        decision: Number of this decision on the path, if it is one.
        first_open: As :func:`first_open_decision` gives it.
        reflectance: R; one under total internal reflection, where there is no other branch.
        cutoff: Reflected branches that carry less than this in every channel are culled.
    """
    out = Branch()
    out.reflected = True
    out.throughput = throughput
    if reflectance < 1.0:
        out.decided = 1
        out.reflected = decision < MOST_DECISIONS and (mask & (1 << decision)) != 0
        share = throughput * reflectance
        if out.reflected:
            out.throughput = share
        else:
            out.throughput = throughput - share
            if decision >= first_open:
                if wp.max(share) >= cutoff and decision < MOST_DECISIONS:
                    out.reported = 1 << decision
                    out.other = share
                else:
                    out.culled = share
    return out


@wp.func
def take_share(mask: int, decision: int, first_open: int, share: float, throughput: wp.vec3, cutoff: float) -> Branch:
    """Follows ``mask`` where a share of a surface acts, as :func:`take_branch` does; at 0 nothing is decided either."""
    if share > 0.0:
        return take_branch(mask, decision, first_open, share, throughput, cutoff)
    out = Branch()
    out.throughput = throughput
    return out


def reported_branches(reported: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Decision and row of every reported branch, in order of decision, then of row; shape [m] int32 and [m].

    Args:
        reported: Decisions of each path whose reflected branch is to be followed, as bits, shape [n] int32.
    """
    rows = np.flatnonzero(reported)
    found = reported[rows]
    bits = np.arange(int(found.max(initial=0)).bit_length(), dtype=np.int32)
    decision, at = np.nonzero(found & (np.int32(1) << bits[:, None]))
    return decision.astype(np.int32), rows[at]


def reported_paths(items: np.ndarray, masks: np.ndarray, reported: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The paths of the next pass: every reported branch becomes one, in order of decision, then of item.

    Args:
        items: What each path of this pass starts from (a lattice cell, a film position), shape [n] int32.
        masks: Mask of each path, shape [n] int32.
        reported: Decisions whose reflected branch is to be followed, as bits, shape [n] int32.

    Returns:
        Items and masks of the paths, shape [m] int32 each.
    """
    decision, rows = reported_branches(reported)
    return items[rows], masks[rows] | (np.int32(1) << decision)
