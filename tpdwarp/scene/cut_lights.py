"""Lights that something specular passes through: a lamp half in the water, a tube through a pane.

Beyond the paper, whose lights are points or parallel.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tpdwarp.scene.crossings import is_crossed, specular_triangles
from tpdwarp.scene.description import LightAtShutter, LightKind, SceneAtShutter
from tpdwarp.scene.light_places import place_lights

# Places on a light between which and its middle a surface is looked for. Chosen, not derived.
PLACES = 64


def cut_lights(scene: SceneAtShutter) -> list[LightAtShutter]:
    """The lights with extent of which some places lie beyond something specular, seen from their middle."""
    extended = [light for light in scene.lights if light.extent is not None and light.kind != LightKind.DISTANT]
    if not extended or not any(mesh.specular for mesh in scene.meshes):
        return []
    at_places = [place_lights(replace(scene, lights=tuple(extended)), number, PLACES) for number in range(PLACES)]
    places = np.array([[light.position for light in placed.lights] for placed in at_places])
    triangles = specular_triangles(scene, places.min(axis=(0, 1)), places.max(axis=(0, 1)))
    return [light for k, light in enumerate(extended) if is_crossed(light.position, places[:, k], triangles)]
