"""The scene when the shutter opens, and how it moves on from there: the paper's forward difference."""

from __future__ import annotations

from dataclasses import replace

from tpdwarp.scene.description import LightAtShutter, MeshAtShutter, SceneAtShutter, SceneSource, Shutter


def scene_at_opening(source: SceneSource, shutter: Shutter) -> SceneAtShutter:
    """The scene as it stands at shutter open, where others hold it at mid shutter; without a camera.

    Motions are the forward difference from the opening over one frame, or over the exposure where that is shorter,
    times the exposure (Eq. 5 folds it into D_t q). A mesh whose points are others at the opening than half a step on
    stands as it does there.
    """
    step = min(shutter.exposure, 1.0)
    scale = shutter.exposure / step if step > 0 else 1.0
    now = source.at(Shutter(shutter.frame, shutter.open, shutter.open))
    onward = source.at(Shutter(shutter.frame, shutter.open, shutter.open + step))
    meshes, lights = {mesh.path: mesh for mesh in now.meshes}, {light.path: light for light in now.lights}
    return SceneAtShutter(
        shutter,
        tuple(_mesh(meshes.get(mesh.path, mesh), mesh, scale) for mesh in onward.meshes),
        tuple(_light(lights.get(light.path, light), light, scale) for light in onward.lights),
    )


def _mesh(now: MeshAtShutter, onward: MeshAtShutter, scale: float) -> MeshAtShutter:
    same_points = now.points.shape == onward.points.shape and now.triangles.shape == onward.triangles.shape
    same_normals = (now.normals is None) == (onward.normals is None) and (
        now.normals is None or now.normals.shape == onward.normals.shape
    )
    standing = now if same_points and same_normals else onward
    return replace(
        standing,
        motions=None if onward.motions is None else scale * onward.motions,
        normal_motions=None if onward.normal_motions is None else scale * onward.normal_motions,
    )


def _light(now: LightAtShutter, onward: LightAtShutter, scale: float) -> LightAtShutter:
    extent = now.extent
    if extent is not None and onward.extent is not None:
        extent = replace(extent, spans_motion=scale * onward.extent.spans_motion)
    return replace(
        now,
        position_motion=scale * onward.position_motion,
        axes_motion=scale * onward.axes_motion,
        extent=extent,
    )
