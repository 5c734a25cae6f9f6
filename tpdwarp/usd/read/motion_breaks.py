"""Motion breaks: times at which velocities may jump, since USD interpolates linearly between time samples."""

from __future__ import annotations

from collections.abc import Iterable

from pxr import Gf, Usd

# Beside xformOps, what points, primitives and instances move by.
MOVING = frozenset(
    {
        "points",
        "normals",
        "primvars:normals",
        "velocities",
        "positions",
        "orientations",
        "orientationsf",
        "scales",
        "angularVelocities",
        "radius",
        "radiusBottom",
        "radiusTop",
        "height",
        "size",
        "width",
        "length",
    }
)


def motion_breaks_of(prims: Iterable[Usd.Prim], first: float, last: float) -> list[float]:
    """Times of the samples between ``first`` and ``last``, without these, that ``prims`` and what they lie below have.

    Splines are smooth, or have knots for a purpose; they count as having no breaks.
    """
    seen: set[str] = set()
    attributes: list[Usd.Attribute] = []
    for prim in prims:
        while prim and not prim.IsPseudoRoot() and str(prim.GetPath()) not in seen:
            seen.add(str(prim.GetPath()))
            attributes += filter(moves, prim.GetAuthoredAttributes())
            prim = prim.GetParent()
    return list(Usd.Attribute.GetUnionedTimeSamplesInInterval(attributes, Gf.Interval(first, last, False, False)))


def moves(attribute: Usd.Attribute) -> bool:
    """Whether an attribute may move what it belongs to, from sample to sample."""
    name = attribute.GetName()
    if name not in MOVING and not name.startswith("xformOp:"):
        return False
    return attribute.ValueMightBeTimeVarying() and not attribute.HasSpline()
