"""The work on one frame of baking: which receivers there are, and their textures."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from tpdwarp.clock import Clock
from tpdwarp.errors import InputError
from tpdwarp.io.images import write_frame
from tpdwarp.jobs.claims import Claims
from tpdwarp.jobs.energy_warnings import EnergyWatch
from tpdwarp.jobs.existing_frames import ExistingFrames, KeptFrame
from tpdwarp.jobs.frame_metadata import frame_metadata
from tpdwarp.jobs.frame_work import LazyContext, is_newer, skipped
from tpdwarp.jobs.opening import shutter_of
from tpdwarp.jobs.plan import SequencePlan
from tpdwarp.jobs.results import FrameOutcome
from tpdwarp.jobs.texture_names import TextureNames, Tile
from tpdwarp.rendering.albedo import albedo_at
from tpdwarp.rendering.baking import Atlas, Picture, bake_textures, mesh_of, pixel_of, scene_points
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import trace_frame
from tpdwarp.scene.description import Interaction, SceneAtShutter, Shutter
from tpdwarp.scene.device.loading import LoadedScene
from tpdwarp.usd.read.stage import StageScene
from tpdwarp.usd.read.uv import require_flat_enough

# More texels along a side than this take more memory than frames do: a texture of 16384 has 268 million.
MOST_TEXELS = 16384
# Charts that overlap by less than this share of their area share borders of texels only. Chosen, not derived.
LARGEST_OVERLAP = 1.02
# Albedos that differ by less than a step of eight bits are one.
SAME_ALBEDO = 1.0 / 255.0


@dataclass(frozen=True)
class BakeSettings:
    """What is baked.

    Attributes:
        receivers: Prims whose meshes receive; empty for those that photons land on in the first frame.
        uv: Primvar that holds texture coordinates.
        resolution: Texels along each side of a tile.
        what: ``irradiance`` [W/m²], ``caustic`` (radiance) or ``motion`` (flux-weighted mean of D_t x).
        gutter: How far beyond charts texels are filled.

    Raises:
        InputError: A number makes no sense.
    """

    receivers: tuple[str, ...] = ()
    uv: str = "st"
    resolution: int = 1024
    what: str = "irradiance"
    gutter: int = 8

    def __post_init__(self) -> None:
        for name, least in (("resolution", 1), ("gutter", 0)):
            value = getattr(self, name)
            if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= MOST_TEXELS:
                raise InputError(f"--{name} must be a whole number of {least} to {MOST_TEXELS} texels, not {value!r}")


@dataclass(frozen=True, eq=False)
class Receiver:
    """What is known of a receiver before its textures are made.

    Attributes:
        path: The mesh.
        tiles: Its tiles.
        albedo: Its mean albedo.
        projected: Coordinates of its own points, shape [v, 2], where it has no primvar of them; else None.
    """

    path: str
    tiles: tuple[Tile, ...]
    albedo: tuple[float, float, float]
    projected: np.ndarray | None


class AtlasStore:
    """The texels of receivers, made anew only where their coordinates change.

    Args:
        source: The stage.
        settings: What is baked.
    """

    def __init__(self, source: StageScene, settings: BakeSettings) -> None:
        self._source, self._settings = source, settings
        self._atlases: dict[str, Atlas] = {}
        self.projected: dict[str, np.ndarray | None] = {}

    def atlas(self, path: str, scenes: Sequence[LoadedScene], context: RenderContext) -> Atlas | None:
        """The texels of a receiver over a shutter; None where it is not there.

        Raises:
            InputError: It has no coordinates that can be used.
        """
        middle = scenes[len(scenes) // 2].scene
        mesh = mesh_of(middle, path)
        found = None if mesh is None else self._source.coordinates(path, self._settings.uv, middle.shutter)
        if found is None:
            return None
        known = self._atlases.get(path)
        if known is None or not np.array_equal(known.coordinates, found.values):
            require_flat_enough(found.values, path, self._source.file)
            settings = self._settings
            known = Atlas.of(path, found.values, settings.resolution, settings.gutter, context.launcher)
            if known.overlap > LARGEST_OVERLAP:
                self._source.warnings(
                    path, "has charts that lie on each other in its texture coordinates: they share the light of one "
                    "of them (give each a place of its own, or choose others with --uv)"
                )
            self._atlases[path] = known
            self.projected[path] = found.projected
        return known


def receivers_of(
    settings: BakeSettings, source: StageScene, context: RenderContext, atlases: AtlasStore, shutter: Shutter
) -> list[Receiver]:
    """The receivers that a shutter shows.

    Raises:
        InputError: There are none; one is no diffuse mesh; its coordinates cannot be used.
        FrameError: Photons cannot be traced.
    """
    scenes = context.segmentation.load(shutter, Clock())
    middle = scenes[len(scenes) // 2]
    if settings.receivers:
        paths = [path for asked in settings.receivers for path in _below(asked, middle.scene, source)]
    else:
        paths = _lit(context, shutter)
        if not paths:
            raise InputError("photons land on no mesh (name one with --receiver)", source.file)
        source.warnings("", f"photons land on {', '.join(paths)}, which is baked (choose with --receiver)")
    found = []
    for path in dict.fromkeys(paths):
        atlas = atlases.atlas(path, scenes, context)
        if atlas is None or not atlas.texels:
            raise InputError("no texel lies on it (see --uv and --resolution)", source.file, path)
        pixel = pixel_of(atlas, middle.scene, context)
        colors = albedo_at(context, middle, scene_points(atlas, middle.scene), pixel)
        if settings.what == "irradiance" and np.ptp(colors, axis=0).max() > SAME_ALBEDO:
            source.warnings(
                path, "has an albedo that differs over it: the layer that binds its texture takes the mean "
                "(bake --what caustic, which holds it)"
            )
        mean = tuple(map(float, colors.mean(axis=0, dtype=np.float64)))
        found.append(Receiver(path, tuple(atlas.texels), mean, atlases.projected[path]))
    return found


class BakeWork:
    """Bakes the textures of one frame after the other.

    Args:
        plan: The sequence.
        settings: What is baked.
        receivers: The receivers.
        names: Their files.
        atlases: Their texels.
        context: The animation.
        skip_existing, begun: As of :class:`tpdwarp.jobs.frame_work.RenderWork`.

    Attributes:
        existing: What became of files that were there.
    """

    def __init__(
        self,
        plan: SequencePlan,
        settings: BakeSettings,
        receivers: Sequence[Receiver],
        names: TextureNames,
        atlases: AtlasStore,
        context: LazyContext,
        skip_existing: bool,
        begun: float,
    ) -> None:
        self._plan, self._settings, self._receivers, self._names = plan, settings, receivers, names
        self._atlases, self._context, self._skips, self._begun = atlases, context, skip_existing, begun
        self.existing = ExistingFrames(plan.fingerprint)
        self._claims, self._watch = Claims(), EnergyWatch(plan.source)

    def __call__(self, frame: float) -> FrameOutcome:
        """Bakes a frame, or leaves it alone.

        Raises:
            ClaimedElsewhere: Another process bakes it.
            InputError: The stage cannot be used there.
            FrameError: It cannot be baked or written.
            OSError: Likewise.
        """
        plan, paths = self._plan, self._names.paths(frame)
        shutter = shutter_of(plan.source, frame, plan.settings)
        with self._claims.held(paths[0]):
            kept = [self._kept(path, frame) for path in paths]
            if None not in kept:
                return skipped(frame, paths[0], kept[0])
            with plan.files.unchanged(plan.strict):
                context = self._context(shutter)
                scenes = context.segmentation.load(shutter, Clock())
                shown = {r.path: self._atlases.atlas(r.path, scenes, context) for r in self._receivers}
                atlases = [atlas for atlas in shown.values() if atlas is not None]
                if atlases:
                    pictures, traced = bake_textures(context, shutter, scenes, atlases, self._settings.what)
                else:
                    pictures, traced = [], trace_frame(context, shutter)
            self._watch(frame, shutter, traced.energy)
            of = {atlas.path: found for atlas, found in zip(atlases, pictures, strict=True)}
            metadata = frame_metadata(plan.source, frame, shutter, plan.settings, traced, plan.fingerprint, plan.target)
            nothing = self._empty_picture(context)
            what = self._settings.what
            text = json.dumps({**plan.settings.as_dict(), "bake": asdict(self._settings)}, sort_keys=True)
            for receiver in self._receivers:
                for tile in receiver.tiles:
                    channels = of.get(receiver.path, {}).get(tile, nothing)
                    own = {"tpdwarp:receiver": receiver.path, "tpdwarp:what": what, "tpdwarp:settings": text}
                    depth = "float" if what == "motion" else None
                    write_frame(self._names.path(receiver.path, tile, frame), channels, metadata | own, depth)
        return FrameOutcome(
            frame, "written", paths[0], "", len(traced.landed), traced.energy, dict(traced.seconds)
        )

    def _empty_picture(self, context: RenderContext) -> Picture:
        what, size = self._settings.what, self._settings.resolution
        groups = () if what == "motion" else context.light_groups.names
        names = [*"RGBA", *(f"{what}_{group}.{channel}" for group in groups for channel in "RGB")]
        return dict.fromkeys(names, np.zeros((size, size), np.float32))

    def _kept(self, path: str, frame: float) -> KeptFrame | None:
        return self.existing.kept(path, frame) if self._skips or is_newer(path, self._begun) else None


def _below(asked: str, scene: SceneAtShutter, source: StageScene) -> list[str]:
    """The diffuse meshes at or below a path.

    Raises:
        InputError: There are none.
    """
    path = asked.rstrip("/")
    below = (f"{path}/", f"{path}[")
    meshes = [mesh for mesh in scene.objects() if mesh.path == path or mesh.path.startswith(below)]
    diffuse = [
        mesh.path
        for mesh in meshes
        if any(material.interaction == Interaction.DIFFUSE for material in mesh.materials)
    ]
    if not diffuse:
        why = "is specular: no light stays on it" if meshes else "no visible mesh is there"
        first = itertools.islice(scene.objects(), 8)
        known = ", ".join(
            mesh.path for mesh in first if any(m.interaction == Interaction.DIFFUSE for m in mesh.materials)
        )
        raise InputError(f"{why} (--receiver takes {known or 'diffuse meshes'})", source.file, asked)
    return diffuse


def _lit(context: RenderContext, shutter: Shutter) -> list[str]:
    """The meshes that photons land on, those with the most flux first."""
    photons = trace_frame(context, shutter).photons
    flux = np.bincount(
        photons.receivers, weights=photons.flux.sum(axis=1), minlength=len(photons.receiver_paths)
    )
    order = [int(k) for k in np.argsort(-flux, kind="stable") if flux[k] > 0 and math.isfinite(flux[k])]
    return [photons.receiver_paths[k] for k in order]
