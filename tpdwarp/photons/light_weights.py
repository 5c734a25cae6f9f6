"""Light weights: how several lights share the photons, by what the light of each adds to the error.

Errors of a light's caustic are parts of it, and are seen as parts of all light where it falls: where a brighter one
falls too they hardly count, and where none does they count in full, however faint the light is. So with E_l the
irradiance of the photons of a light in the cubes where they land, and E that of all lights there, its light errs by
A_l = √(mean of (E_l/E)²) over its flux, times what its own photons leave. Where h_l of its cells meet something
specular whose light lands, and errors fall with the root of those, the sum of the squares of all errors is least if
lights have photons as

    A_l h_l^−½

Both are found from a coarse trace of a few stills.

Beyond the paper, which has one light.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tpdwarp.photons.lattices import EmissionPlan
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.scene.description import SceneAtShutter
from tpdwarp.scene.light_places import prim_of

# Photons of each light in the trace from which weights are found. Chosen, not derived.
PILOT_PHOTONS_PER_LIGHT = 1024
# Stills looked at, spread over the animation. Chosen, not derived.
MOST_STILLS = 2
# Cubes are so many footprints wide, so that a dozen photons lie in each.
CUBE_WIDTH = 4.0
# A light of which hardly a cell lands anywhere counts as if this part did: more cells than that would have others
# starve for one that looks past what is specular. Chosen, not derived.
LEAST_LANDED = 1.0 / 16.0


def light_weights(photons: PhotonMap, plan: EmissionPlan, scene: SceneAtShutter) -> dict[str, float]:
    """The weight of each light of ``plan`` that shines in ``scene``, by its prim path; 0 where its light lands nowhere.

    Args:
        photons: Those of ``plan`` that landed there.
    """
    sent: dict[str, int] = {}
    for lattice, patch in plan.patches(scene):
        name = prim_of(lattice.light)
        sent[name] = sent.get(name, 0) + patch.count_u * patch.count_v
    names = list(sent)
    number = {name: k for k, name in enumerate(names)}
    of_path = np.array([number.get(prim_of(path), -1) for path in photons.light_paths], np.int64)
    light = of_path[photons.light] if len(photons) else np.zeros(0, np.int64)
    flux = photons.flux.sum(axis=1, dtype=np.float64)
    weights = dict.fromkeys(names, 0.0)
    for name, k in number.items():
        mine = light == k
        if not flux[mine].sum() > 0.0:
            continue
        part = _part_of_all(photons, flux, mine)
        landed = len(np.unique(photons.ids[mine] % plan.id_count)) / sent[name]
        alone = np.sqrt(np.average(part**2, weights=flux[mine]))
        weights[name] = float(alone / np.sqrt(min(max(landed, LEAST_LANDED), 1.0)))
    return weights


def greatest(weights: Sequence[dict[str, float]]) -> dict[str, float]:
    """The greatest weight that each light has in any of several stills."""
    names = {name for one in weights for name in one}
    return {name: max(one.get(name, 0.0) for one in weights) for name in names}


def _part_of_all(photons: PhotonMap, flux: np.ndarray, mine: np.ndarray) -> np.ndarray:
    """E_l/E where each of the photons ``mine`` of a light lies."""
    columns = photons.dxdu[mine].astype(np.float64), photons.dxdv[mine].astype(np.float64)
    areas = np.linalg.norm(np.cross(*columns), axis=1)
    order = np.argsort(areas)
    middle = np.searchsorted(np.cumsum(flux[mine][order]), 0.5 * flux[mine].sum())
    side = max(CUBE_WIDTH * np.sqrt(areas[order][min(middle, len(order) - 1)]), np.finfo(np.float32).eps)
    cubes = np.floor(photons.position.astype(np.float64) / side).clip(-(2**62), 2**62).astype(np.int64)
    cube = np.unique(cubes, axis=0, return_inverse=True)[1].reshape(-1)
    own = np.bincount(cube[mine], flux[mine], len(flux))
    return (own / np.maximum(np.bincount(cube, flux, len(flux)), np.finfo(np.float64).tiny))[cube[mine]]
