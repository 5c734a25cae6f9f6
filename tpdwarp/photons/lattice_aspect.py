"""Lattice aspect ratio: how much finer the lattice of a distant light should be along its u than along its v.

Where specular surfaces deflect light in one direction only, as a swell or a rod does, the light on the receiver varies
in that direction alone, and photons side by side in the other carry the same light. The blur of footprints goes with
h_u² G_u + h_v² G_v, where h are lattice steps and G the mean squares of how normals turn along u and v; at equal cells
of h_u h_v it is least at h_v/h_u = √(G_u/G_v). That holds for a sheet, such as water, that is all the light sees: at
the ends of a rod, say, light stops whatever normals do, and long cells would blur them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from tpdwarp.scene.description import Interaction, LightAtShutter, MeshAtShutter, SceneAtShutter

# Ratios beyond this gain nothing more: light varies along the other direction, too. Chosen, not derived.
LARGEST_ASPECT = 16.0
# Where light grazes, normals turn without bound along its plane; triangles under a smaller cosine are left out. Chosen,
# not derived.
LEAST_COSINE = 0.25
# How much a sheet's area in the plane of the light may differ from that of the rectangle around it, as a part of it.
# Chosen, not derived.
SHEET = 0.05
# Where normals turn by less than this over the whole sheet [rad] its light is nearly even, and cells stay square.
# Chosen, not derived.
FLAT = 0.1


def specular_faces(mesh: MeshAtShutter) -> np.ndarray:
    """Which triangles of ``mesh`` reflect or refract, shape [m] bool."""
    special = np.array([m.interaction != Interaction.DIFFUSE for m in mesh.materials])
    if mesh.triangle_materials is None:
        return np.full(len(mesh.triangles), special[0])
    return special[mesh.triangle_materials]


def lattice_aspect(views: Iterable[tuple[LightAtShutter, SceneAtShutter]]) -> float:
    """h_v/h_u over all stills, a power of two from 1/16 to 16; one where no direction stands out."""
    along_u = along_v = 0.0
    for light, scene in views:
        meshes = [mesh for mesh in scene.meshes if mesh.specular]
        if not meshes or not _is_sheet(meshes, light.axes):
            return 1.0
        for mesh in meshes:
            if mesh.normals is not None:
                u, v = _turning(mesh, light.axes)
                along_u, along_v = along_u + u, along_v + v
    if along_u + along_v < FLAT**2:
        return 1.0
    least = (along_u + along_v) / LARGEST_ASPECT**4
    ratio = math.sqrt(max(along_u, least) / max(along_v, least))
    return 2.0 ** round(math.log2(min(max(ratio, 1.0 / LARGEST_ASPECT), LARGEST_ASPECT)))


def _is_sheet(meshes: list[MeshAtShutter], axes: np.ndarray) -> bool:
    """Whether the specular faces fill a rectangle in the plane of a light with ``axes`` and face one way."""
    corners = np.concatenate([mesh.points[mesh.triangles[specular_faces(mesh)]] for mesh in meshes]) @ axes[:2].T
    (u1, v1), (u2, v2) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    areas = 0.5 * (u1 * v2 - u2 * v1)
    filled, whole = float(np.abs(areas).sum()), float(np.ptp(corners.reshape(-1, 2), axis=0).prod())
    # Faces may be there more than once, but all look the same way: so a body, with a near and a far side, is no sheet.
    layers = max(1, round(filled / whole)) if whole > 0.0 else 1
    limit = SHEET * layers * whole
    return filled - abs(float(areas.sum())) <= limit and abs(filled - layers * whole) <= limit


def _turning(mesh: MeshAtShutter, axes: np.ndarray) -> tuple[float, float]:
    """∫ |∂N/∂u|² and ∫ |∂N/∂v|² over the plane of a light with ``axes``, both without a unit."""
    faces = specular_faces(mesh)
    corners = mesh.points[mesh.triangles[faces]]
    normals = mesh.normals[mesh.normal_indices[faces]]
    edges = (corners[:, 1:] - corners[:, :1]) @ axes.T
    turns = normals[:, 1:] - normals[:, :1]
    (u1, v1), (u2, v2) = edges[:, 0, :2].T, edges[:, 1, :2].T
    area = u1 * v2 - u2 * v1
    true_area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    seen = np.abs(area) > LEAST_COSINE * true_area
    along_u = (v2[:, None] * turns[:, 0] - v1[:, None] * turns[:, 1])[seen]
    along_v = (u1[:, None] * turns[:, 1] - u2[:, None] * turns[:, 0])[seen]
    whole = np.abs(area[seen])
    return tuple(float(np.sum(np.sum(g**2, axis=1) / whole)) for g in (along_u, along_v))
