"""What a scene requires of the tracer, decided once: kernels carry this and nothing else."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from tpdwarp.scene.description import Interaction, MeshAtShutter, SceneAtShutter
from tpdwarp.scene.nesting import nesting_of

# Specular interactions followed at most: light that is totally reflected so often keeps its flux, and never gets out.
# Chosen, not derived.
MOST_BOUNCES = 64
# Normals within this cosine of their triangle's (0.4°) shade it as flat: irradiance differs by less than 1 % of sin θ.
FLAT_COSINE = 0.99997


@dataclass(frozen=True)
class Requirements:
    """What one shutter of a scene needs.

    Attributes:
        moving_meshes: Paths of meshes that move within the shutter.
        moving_lights: Paths of lights that do.
        moving_camera: Whether the camera does.
        refraction: Whether there is a dielectric.
        reflection: Whether there is a mirror (dielectrics reflect too, as part of refraction).
        nested: Whether dielectric solids lie in each other or touch.
        smooth_receivers: Whether a diffuse surface is shaded by normals that are not those of its triangles.
        bounces: Specular interactions followed along a path.
        textures: Whether an albedo, a normal or what a surface gives off differs over it by a texture.
        normal_maps: Whether a normal does.
        specular_maps: Whether what a surface reflects or refracts does: its share, its tint or its roughness.
        metals: Whether there is metal too rough for a mirror.
        glints: Whether there is a mirror that is rough, or seen in what is, and a light that it shows by its lobe.
        mirrored_lights: Whether there is a smooth mirror, and a light with extent that it shows as it is.
        partial: Whether light passes through a part of a surface, or meets one that is both clear and diffuse.
        tinted: Whether dielectrics take from the light that they refract.
        emission: Whether a surface gives off light.
        lens: Whether the camera has a lens, in front of and behind whose focus things are blurred.
        domes: Whether light comes from all around.
        extended_lights: Paths of lights with extent, for which photons carry the columns a and b.
        linked: Whether a light shines on some meshes only, or through some.
        thin_walls: Whether there are dielectric sheets.
        rough: Whether something specular is rough, for which photons carry the columns a and b as well.
        dispersive: Whether a dielectric refracts by wavelength.
        clipped: Whether the camera has clipping planes.
    """

    moving_meshes: tuple[str, ...]
    moving_lights: tuple[str, ...]
    moving_camera: bool
    refraction: bool
    reflection: bool
    nested: bool
    smooth_receivers: bool
    bounces: int
    textures: bool = False
    partial: bool = False
    tinted: bool = False
    emission: bool = False
    lens: bool = False
    domes: bool = False
    extended_lights: tuple[str, ...] = ()
    linked: bool = False
    thin_walls: bool = False
    rough: bool = False
    dispersive: bool = False
    clipped: bool = False
    normal_maps: bool = False
    specular_maps: bool = False
    metals: bool = False
    glints: bool = False
    mirrored_lights: bool = False

    @property
    def material_arrays(self) -> bool:
        """Whether kernels look up more of a material than its interaction, colour and index."""
        shown = self.textures, self.partial, self.tinted, self.emission, self.thin_walls, self.rough, self.metals
        return any(shown) or self.specular_maps

    @property
    def light_columns(self) -> bool:
        """Whether photons carry the columns a and b."""
        return bool(self.extended_lights) or self.rough

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
        columns = [*"uv", *("t" if self.photon_motion else ""), *("ab" if self.light_columns else "")]
        return {**asdict(self), "differentials": columns}


def is_smooth_receiver(mesh: MeshAtShutter) -> bool:
    """Whether a mesh has diffuse triangles whose shading normals differ from their geometric ones."""
    diffuse = np.array([material.interaction == Interaction.DIFFUSE for material in mesh.materials])
    if mesh.normals is None or mesh.normal_indices is None or not diffuse.any():
        return False
    rows = slice(None) if diffuse.all() or mesh.triangle_materials is None else diffuse[mesh.triangle_materials]
    corners, indices = mesh.points[mesh.triangles[rows]], mesh.normal_indices[rows]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(area, axis=1, keepdims=True)
    flat = area / np.maximum(length, np.finfo(float).tiny)
    cosines = np.abs(np.einsum("mkc,mc->mk", mesh.normals[indices], flat))
    return bool(np.any((cosines < FLAT_COSINE) & (indices >= 0) & (length > 0)))


def requirements_of(scene: SceneAtShutter, bounces: int | None = None) -> Requirements:
    """Decides what ``scene`` requires; ``bounces`` limits the interactions followed along a path."""
    interactions = [{material.interaction for material in mesh.materials} for mesh in scene.meshes]
    dielectrics = any(Interaction.DIELECTRIC in kinds for kinds in interactions)
    mirrors = any(Interaction.MIRROR in kinds for kinds in interactions)
    # Instances share theirs.
    shared = {id(mesh.materials): mesh.materials for mesh in scene.meshes}
    materials = {material for group in shared.values() for material in group}
    partial = any(material.partial for material in materials)
    metals = any(material.metallic for material in materials)
    roughnesses = {material.rough for material in materials if material.interaction == Interaction.MIRROR}
    mapped_mirrors = any(material.roughness_map is not None for material in materials)
    shown = [light for light in scene.lights if not light.meshed]
    placed = {material for mesh in scene.meshes if mesh.coordinates is not None for material in mesh.materials}
    normal_maps = any(material.normal_map is not None for material in placed)
    return Requirements(
        moving_meshes=tuple(mesh.path for mesh in scene.meshes if mesh.moves),
        moving_lights=tuple(light.path for light in scene.lights if light.moves),
        moving_camera=scene.camera is not None and scene.camera.moves,
        refraction=dielectrics,
        reflection=mirrors,
        nested=nesting_of(scene) is not None,
        smooth_receivers=(dielectrics or mirrors) and (normal_maps or any(map(is_smooth_receiver, scene.meshes))),
        bounces=(bounces or MOST_BOUNCES) if dielectrics or mirrors or partial or metals else 0,
        textures=normal_maps
        or any(material.texture is not None or material.emission_map is not None for material in placed),
        partial=partial,
        tinted=any(material.tinted for material in materials),
        emission=any(material.shines for material in materials),
        lens=scene.camera is not None and scene.camera.lens_radius > 0,
        domes=bool(scene.domes),
        extended_lights=tuple(light.path for light in scene.lights if light.extent is not None),
        linked=any(light.linked for light in scene.lights),
        thin_walls=any(material.thin_walled for material in materials),
        rough=any(material.rough for material in materials),
        dispersive=any(material.abbe > 0 for material in materials),
        clipped=scene.camera is not None and len(scene.camera.clipping_planes) > 0,
        normal_maps=normal_maps,
        specular_maps=any(material.specular_maps for material in placed),
        metals=metals,
        glints=bool(shown) and (True in roughnesses or (metals and mirrors)),
        mirrored_lights=(False in roughnesses or mapped_mirrors) and any(light.extent is not None for light in shown),
    )
