"""Surfaces that are there in part: cut-outs, sheets that let a share of light pass, and what shadows they throw."""

import warp as wp

from tpdwarp.scene.device.geometry import Surfaces
from tpdwarp.scene.device.intersection import Hit, is_plane_left, occluded, plane_of
from tpdwarp.scene.device.ray_tree import first_met
from tpdwarp.scene.device.textures import LEAST_SHARE, TextureArrays, filtered

# Surfaces that a shadow ray passes at most. Chosen, not derived: trees of leaf cards have some dozens.
MOST_LAYERS = wp.constant(64)
# Beyond a surface that it passes a shadow ray begins so much farther on, in scenes of unit size: some roundings.
STEP = wp.constant(1.0e-5)


@wp.func
def presence_at(surfaces: Surfaces, textures: TextureArrays, face: int, beta: wp.vec3) -> float:
    """Share of the surface that is there at barycentric coordinates of triangle ``face``."""
    none = wp.vec2(0.0, 0.0)
    return _presence(surfaces, textures, face, beta, none, none)


@wp.func
def presence_over(surfaces: Surfaces, textures: TextureArrays, hit: Hit, across: wp.vec3, down: wp.vec3) -> float:
    """Share of the surface that is there over the parallelogram of ``across`` and ``down`` about ``hit``."""
    d_across = wp.vec2(0.0, 0.0)
    d_down = wp.vec2(0.0, 0.0)
    index = textures.coordinate_indices[hit.triangle]
    if textures.cutout_of[surfaces.material_of[hit.triangle]] >= 0 and index[0] >= 0:
        along1 = textures.coordinates[index[1]] - textures.coordinates[index[0]]
        along2 = textures.coordinates[index[2]] - textures.coordinates[index[0]]
        d_across = along1 * wp.dot(hit.g1, across) + along2 * wp.dot(hit.g2, across)
        d_down = along1 * wp.dot(hit.g1, down) + along2 * wp.dot(hit.g2, down)
    return _presence(surfaces, textures, hit.triangle, hit.beta, d_across, d_down)


@wp.func
def _presence(
    surfaces: Surfaces, textures: TextureArrays, face: int, beta: wp.vec3, across: wp.vec2, down: wp.vec2
) -> float:
    material = surfaces.material_of[face]
    share = float(textures.presences[material])
    cutout = textures.cutout_of[material]
    index = textures.coordinate_indices[face]
    if cutout >= 0 and index[0] >= 0:
        st = (
            beta[0] * textures.coordinates[index[0]]
            + beta[1] * textures.coordinates[index[1]]
            + beta[2] * textures.coordinates[index[2]]
        )
        share *= wp.clamp(filtered(textures, cutout, st, across, down, textures.thresholds[material])[0], 0.0, 1.0)
    if share < LEAST_SHARE:
        share = 0.0
    if share > 1.0 - LEAST_SHARE:
        share = 1.0
    return share


@wp.func
def share_that_passes(
    surfaces: Surfaces, textures: TextureArrays, x: wp.vec3, w: wp.vec3, offset: wp.vec3, distance: float
) -> float:
    """Share of light that gets from x + distance·ω to x: what is there of the surfaces in between hides the rest."""
    if not occluded(surfaces, x, w, offset, distance):
        return 1.0
    side = wp.normalize(offset)
    reach = wp.length(offset)
    share = float(1.0)
    start = float(0.0)
    for _layer in range(MOST_LAYERS):
        met = first_met(surfaces.tree, x + offset + start * w, w, distance - start)
        if met.triangle < 0:
            return share
        if not is_plane_left(plane_of(surfaces, met.triangle), x, side, reach):
            beta = wp.vec3(met.u, met.v, 1.0 - met.u - met.v)
            share *= 1.0 - presence_at(surfaces, textures, met.triangle, beta)
            if share < LEAST_SHARE:
                return 0.0
        start += met.distance + STEP
    return 0.0
