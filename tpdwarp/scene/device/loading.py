"""Scenes of an animation on the device: read over a shutter, checked, packed, and kept in the same units."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

from tpdwarp.clock import Clock
from tpdwarp.device import Launcher
from tpdwarp.errors import InputError
from tpdwarp.scene.coordinate_range import require_within_range
from tpdwarp.scene.description import (
    CameraAtShutter,
    LightAtShutter,
    SceneAtShutter,
    SceneSource,
    Shutter,
    reference_scenes,
)
from tpdwarp.scene.device.faces import Faces
from tpdwarp.scene.device.geometry import Geometry, geometry_of
from tpdwarp.scene.device.textures import TextureArrays, TextureStore
from tpdwarp.scene.device.wide_tree import WideTree
from tpdwarp.scene.nesting import nesting_of
from tpdwarp.scene.normalization import Normalization
from tpdwarp.scene.opening import scene_at_opening
from tpdwarp.scene.requirements import Requirements, requirements_of


@dataclass
class LoadedScene:
    """One shutter, or a segment of one: the scene's description, its device arrays, and what it requires."""

    scene: SceneAtShutter
    geometry: Geometry
    requirements: Requirements
    textures: TextureArrays

    @property
    def moves(self) -> bool:
        """Whether photons or the view move over the shutter."""
        return self.requirements.photon_motion or self.requirements.view_motion


class SceneLoader:
    """Loads the scenes of one animation, all in the same units.

    Args:
        source: Where scenes come from.
        launcher: The device.
        bounces: Specular interactions followed along a path; None for as many as light takes.

    Attributes:
        normalization: The tracer's units, the same for every frame.
        extended_lights: Whether the stills show lights with extent.
        dispersive: Whether they show glass that refracts by wavelength.

    Raises:
        InputError: None of the reference scenes can be used.
    """

    def __init__(self, source: SceneSource, launcher: Launcher, bounces: int | None = None) -> None:
        self.source, self.launcher, self._bounces = source, launcher, bounces
        self._textures = TextureStore(launcher)
        self._made: tuple[Faces | None, WideTree | None] = None, None
        stills = reference_scenes(source)
        self.extended_lights = any(light.extent is not None for still in stills for light in still.lights)
        self.dispersive = any(m.abbe > 0 for still in stills for mesh in still.meshes for m in mesh.materials)
        self.normalization = _normalization(stills, source.file)
        self._stills: Sequence[SceneAtShutter] | None = stills

    def stills_once(self) -> Sequence[SceneAtShutter] | None:
        """The reference scenes for the first who asks; None later, for they are not kept longer than that."""
        stills, self._stills = self._stills, None
        return stills

    def load(
        self,
        shutter: Shutter,
        clock: Clock | None = None,
        instead_of: LoadedScene | None = None,
        beside: LoadedScene | None = None,
    ) -> LoadedScene:
        """The scene over ``shutter``, at its middle with motions over the whole of it.

        Args:
            shutter: The shutter.
            clock: Measures the stages.
            instead_of: The scene a little earlier, which is good no longer then: what was built for it is used again.
            beside: The scene at another time of the same frame, which stays good: a large BVH is built once for both.

        Raises:
            InputError: The stage cannot be used there.
        """
        clock = clock or Clock()
        with clock.stage("read"):
            scene = self.source.at(shutter)
        return self._packed(scene, clock, instead_of, beside)

    def load_opening(self, shutter: Shutter, clock: Clock) -> LoadedScene:
        """The scene as it stands when ``shutter`` opens, with its forward difference; without a camera."""
        with clock.stage("read"):
            scene = scene_at_opening(self.source, shutter)
        return self._packed(scene, clock)

    def seen_by(self, loaded: LoadedScene, camera: CameraAtShutter) -> LoadedScene:
        """A scene as another camera sees it over the same shutter; what is on the device stays there.

        Raises:
            InputError: The camera cannot be used there.
        """
        return self._otherwise(loaded, replace(loaded.scene, camera=camera))

    def lit_by(self, loaded: LoadedScene, lights: Sequence[LightAtShutter]) -> LoadedScene:
        """A scene in the light of other lights over the same shutter; what is on the device stays there.

        Raises:
            InputError: The lights cannot be used there.
        """
        return self._otherwise(loaded, replace(loaded.scene, lights=tuple(lights)))

    def _otherwise(self, loaded: LoadedScene, scene: SceneAtShutter) -> LoadedScene:
        """A scene with the meshes of ``loaded``."""
        require_within_range(scene, self.normalization, self.source.file)
        needs = requirements_of(scene, self._bounces)
        geometry = loaded.geometry
        if (needs.view_motion or needs.photon_motion) and not loaded.moves:
            geometry = geometry_of(scene, self.normalization, self.launcher, with_motions=True)
        return LoadedScene(scene, geometry, needs, loaded.textures)

    def _packed(
        self,
        scene: SceneAtShutter,
        clock: Clock,
        instead_of: LoadedScene | None = None,
        beside: LoadedScene | None = None,
    ) -> LoadedScene:
        with clock.stage("build"):
            require_within_range(scene, self.normalization, self.source.file)
            needs = requirements_of(scene, self._bounces)
            with_motions = needs.photon_motion or needs.view_motion
            # Those of a scene that is gone may be good still: from what segments were planned from to the frame, and
            # from frame to frame.
            (like, trees), self._made = self._made, (None, None)
            if like is not None and not like.of(scene.meshes):
                like = trees = None
            geometry = geometry_of(
                scene,
                self.normalization,
                self.launcher,
                with_motions=with_motions,
                instead_of=None if instead_of is None else instead_of.geometry,
                beside=None if beside is None else beside.geometry,
                like=like,
                trees=trees,
            )
            self._made = geometry.faces, geometry.trees
            textures = TextureArrays()
            if needs.material_arrays:
                norm, nesting = self.normalization, nesting_of(scene)
                media = () if nesting is None else nesting.materials
                textures = self._textures.arrays(scene.meshes, geometry.materials, norm.scale, norm.power, media)
        return LoadedScene(scene, geometry, needs, textures)


def _normalization(stills: list[SceneAtShutter], file: str) -> Normalization:
    """Units that suit all ``stills`` but those with something out of range, which must not spoil the others."""
    shown = [still for still in stills if still.meshes]
    if not shown:
        return Normalization.of(*stills)
    smallest = max((Normalization.of(still) for still in shown), key=lambda found: found.scale)
    usable = []
    for still in shown:
        with suppress(InputError):
            require_within_range(still, smallest, file)
            usable.append(still)
    return Normalization.of(*usable)
