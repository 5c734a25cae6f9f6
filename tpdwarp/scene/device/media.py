"""The media that a path is in: nested dielectrics by their priorities (Schmidt & Budge 2002).

A path carries a mask with a bit for each medium whose surface it has gone in through; the highest of them is where it
is. A surface beyond which that stays the same is none: there the path goes straight on.
"""

import warp as wp

from tpdwarp.scene.device.geometry import Surfaces
from tpdwarp.scene.device.intersection import Hit, plane_of
from tpdwarp.scene.device.ray_tree import first_met

# Surfaces looked at for what a path begins in.
MOST_SURFACES = wp.constant(64)
FAR = wp.constant(1.0e6)


@wp.struct
class Crossing:
    """What a path meets at a dielectric: η = η_i/η_t, the media it is in beyond it, and whether there is nothing."""

    eta: float
    beyond: int
    nothing: bool


@wp.func
def index_in(surfaces: Surfaces, inside: int) -> float:
    """Index of refraction where a path is that is in the media of the mask ``inside``; one in none."""
    index = float(1.0)
    for medium in range(surfaces.medium_index.shape[0]):
        if (inside & (1 << medium)) != 0:
            index = surfaces.medium_index[medium]
    return index


@wp.func
def crossing_at(surfaces: Surfaces, hit: Hit, w: wp.vec3, inside: int) -> Crossing:
    """The interface at ``hit`` for a path that is in the media of ``inside``.

    A path that leaves a medium has been in it, also where it began there.
    """
    out = Crossing()
    enters = wp.dot(hit.n_g, w) < 0.0
    medium = surfaces.medium_of[surfaces.object_of[hit.triangle]]
    if medium < 0:
        ior = surfaces.ior[surfaces.material_of[hit.triangle]]
        out.eta = ior
        if enters:
            out.eta = 1.0 / ior
        out.beyond = inside
        out.nothing = False
        return out
    bit = 1 << medium
    before = inside
    out.beyond = inside | bit
    if not enters:
        before = inside | bit
        out.beyond = inside & ~bit
    index = index_in(surfaces, before)
    beyond = index_in(surfaces, out.beyond)
    out.eta = index / beyond
    out.nothing = index == beyond
    return out


@wp.func
def media_at(surfaces: Surfaces, x: wp.vec3, w: wp.vec3) -> int:
    """The media that a path begins in at x: those whose surface is first met from its back, ahead or behind."""
    inside = int(0)
    known = int(0)
    if wp.min(wp.min(x - surfaces.media_low), wp.min(surfaces.media_high - x)) < 0.0:
        return inside
    for side in range(2):
        direction = w
        if side == 1:
            direction = -w
        place = x
        looking = bool(True)
        for _surface in range(MOST_SURFACES):
            if looking:
                met = first_met(surfaces.tree, place, direction, FAR)
                looking = met.triangle >= 0
                if met.triangle >= 0:
                    medium = surfaces.medium_of[surfaces.object_of[met.triangle]]
                    if medium >= 0:
                        bit = 1 << medium
                        if (known & bit) == 0 and wp.dot(plane_of(surfaces, met.triangle).n_g, direction) > 0.0:
                            inside = inside | bit
                        known = known | bit
                    # Past it by some roundings of a scene of unit size.
                    place = place + (met.distance * (1.0 + 1.0e-6) + 2.0e-6) * direction
    return inside
