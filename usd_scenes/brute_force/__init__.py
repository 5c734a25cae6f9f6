"""Brute-force irradiance of moving triangle meshes in double precision; shares no code with the renderer.

A scene is written down as arrays (:mod:`.description`), traced by plain photons at many instants of the shutter
(:mod:`.mesh_tracer`) and counted in the pixels of an orthographic camera (:mod:`.photon_histogram`)::

    truth = irradiance(scene, photons=20_000_000, parts=64)
    truth.irradiance, truth.mask, truth.error, truth.energy
"""

from .description import Camera, Light, Mesh, Scene
from .photon_histogram import Truth, irradiance

__all__ = ["Camera", "Light", "Mesh", "Scene", "Truth", "irradiance"]
