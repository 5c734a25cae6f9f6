"""Scenes of the renderer's description as surfaces of the oracle, moving linearly through the shutter."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tpdwarp.scene.description import MeshAtShutter, SceneAtShutter, Shutter

from .surfaces import TriangleMesh


def linear_motion(
    values: np.ndarray, motions: np.ndarray | None, shutter: Shutter
) -> np.ndarray | Callable[[float], np.ndarray]:
    """values + (t − t_mid)/e · motions as a function of time; the values themselves where nothing moves."""
    values = np.asarray(values, dtype=np.float64)
    if motions is None or shutter.exposure == 0:
        return values
    motions = np.asarray(motions, dtype=np.float64)
    return lambda t: values + (t - shutter.middle) / shutter.exposure * motions


def meshes_of(mesh: MeshAtShutter, shutter: Shutter) -> list[TriangleMesh]:
    """The mesh, cut into one oracle mesh a material, all named by its path."""
    points = linear_motion(mesh.points, mesh.motions, shutter)
    normals = None if mesh.normals is None else linear_motion(mesh.normals, mesh.normal_motions, shutter)
    materials = mesh.triangle_materials
    if materials is None:
        materials = np.zeros(len(mesh.triangles), dtype=int)
    parts = []
    for index, material in enumerate(mesh.materials):
        chosen = np.asarray(materials) == index
        if chosen.any():
            parts.append(
                TriangleMesh(
                    name=mesh.path,
                    points=points,
                    triangles=mesh.triangles[chosen],
                    normals=normals,
                    normal_indices=None if mesh.normal_indices is None else mesh.normal_indices[chosen],
                    interaction=material.interaction,
                    ior=material.ior,
                )
            )
    return parts


def surfaces_of(scene: SceneAtShutter) -> list[TriangleMesh]:
    """All meshes of a scene as surfaces for :func:`.tracer.trace`."""
    return [part for mesh in scene.meshes for part in meshes_of(mesh, scene.shutter)]
