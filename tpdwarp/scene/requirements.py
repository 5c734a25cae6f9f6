"""What a scene requires of the tracer, decided once: kernels carry this and nothing else."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from tpdwarp.scene.description import Interaction, SceneAtShutter

# Specular interactions followed at most: light that is totally reflected so often keeps its flux, and never gets out.
MOST_BOUNCES = 64


@dataclass(frozen=True)
class Requirements:
    """What one shutter of a scene needs.

    Attributes:
        moving_meshes: Paths of meshes that move within the shutter.
        moving_lights: Paths of lights that do.
        moving_camera: Whether the camera does.
        refraction: Whether there is a dielectric.
        reflection: Whether there is a mirror (dielectrics reflect too, as part of refraction).
        bounces: Specular interactions followed along a path.
    """

    moving_meshes: tuple[str, ...]
    moving_lights: tuple[str, ...]
    moving_camera: bool
    refraction: bool
    reflection: bool
    bounces: int

    @property
    def caustics(self) -> bool:
        """Whether there is anything specular, and so anything for photons to do."""
        return self.refraction or self.reflection

    @property
    def photon_motion(self) -> bool:
        """Whether photons carry the time column."""
        return bool(self.moving_meshes or self.moving_lights)

    @property
    def view_motion(self) -> bool:
        """Whether what the camera sees moves across the image."""
        return bool(self.moving_meshes or self.moving_camera)

    def as_dict(self) -> dict[str, object]:
        """The requirements as plain JSON values."""
        return {**asdict(self), "differentials": ["u", "v", "t"] if self.photon_motion else ["u", "v"]}


def requirements_of(scene: SceneAtShutter, bounces: int | None = None) -> Requirements:
    """Decides what ``scene`` requires; ``bounces`` limits the interactions followed along a path."""
    interactions = [{material.interaction for material in mesh.materials} for mesh in scene.meshes]
    dielectrics = any(Interaction.DIELECTRIC in kinds for kinds in interactions)
    mirrors = any(Interaction.MIRROR in kinds for kinds in interactions)
    return Requirements(
        moving_meshes=tuple(mesh.path for mesh in scene.meshes if mesh.moves),
        moving_lights=tuple(light.path for light in scene.lights if light.moves),
        moving_camera=scene.camera is not None and scene.camera.moves,
        refraction=dielectrics,
        reflection=mirrors,
        bounces=(bounces or MOST_BOUNCES) if dielectrics or mirrors else 0,
    )
