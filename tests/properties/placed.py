"""Scenes moved as a whole: turned, shifted, scaled, run backwards, told in another order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tpdwarp.scene.description import CameraAtShutter, LightAtShutter, LightKind, MeshAtShutter, SceneAtShutter

Rows = np.ndarray | None


def placed(
    scene: SceneAtShutter, turn: np.ndarray | None = None, shift: Sequence[float] = (0, 0, 0), scale: float = 1.0
) -> SceneAtShutter:
    """The scene with every point p at scale · turn p + shift; the same light falls on the same surfaces.

    Irradiance stays: that of distant lights is theirs to keep, the radiant intensity of points goes with scale².
    """
    turn = np.eye(3) if turn is None else turn

    def vectors(rows: Rows) -> Rows:
        return None if rows is None else scale * rows @ turn.T

    def directions(rows: Rows) -> Rows:
        return None if rows is None else rows @ turn.T

    def mesh(of: MeshAtShutter) -> MeshAtShutter:
        return replace(
            of,
            points=vectors(of.points) + shift,
            motions=vectors(of.motions),
            normals=directions(of.normals),
            normal_motions=directions(of.normal_motions),
        )

    def light(of: LightAtShutter) -> LightAtShutter:
        stronger = scale**2 if of.kind == LightKind.POINT else 1.0
        return replace(
            of,
            power=tuple(stronger * channel for channel in of.power),
            position=vectors(of.position) + shift,
            axes=directions(of.axes),
            position_motion=vectors(of.position_motion),
            axes_motion=directions(of.axes_motion),
        )

    def camera(of: CameraAtShutter | None) -> CameraAtShutter | None:
        if of is None:
            return None
        return replace(
            of,
            position=vectors(of.position) + shift,
            axes=directions(of.axes),
            window=tuple(scale * edge for edge in of.window) if of.orthographic else of.window,
            near=scale * of.near,
            position_motion=vectors(of.position_motion),
            axes_motion=directions(of.axes_motion),
        )

    return replace(
        scene,
        meshes=tuple(map(mesh, scene.meshes)),
        lights=tuple(map(light, scene.lights)),
        camera=camera(scene.camera),
    )


def backwards(scene: SceneAtShutter) -> SceneAtShutter:
    """The same shutter with time running the other way: all motions change sign."""

    def reversed_(thing, *names: str):
        return replace(thing, **{name: -getattr(thing, name) for name in names if getattr(thing, name) is not None})

    return replace(
        scene,
        meshes=tuple(reversed_(mesh, "motions", "normal_motions") for mesh in scene.meshes),
        lights=tuple(reversed_(light, "position_motion", "axes_motion") for light in scene.lights),
    )


def brighter(scene: SceneAtShutter, factor: float) -> SceneAtShutter:
    """The scene with every light ``factor`` times as strong."""
    lights = (replace(one, power=tuple(factor * channel for channel in one.power)) for one in scene.lights)
    return replace(scene, lights=tuple(lights))
