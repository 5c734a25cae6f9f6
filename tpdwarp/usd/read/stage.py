"""A USD stage as a source of scenes: opened and checked once, then asked for the scene over any shutter."""

from __future__ import annotations

import itertools
import math
import os
import weakref
from collections.abc import Callable, Iterable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdUtils

from tpdwarp.errors import InputError, WarnOnce
from tpdwarp.io.image_region import ImageRegion
from tpdwarp.scene.description import CameraAtShutter, LightAtShutter, MeshAtShutter, SceneAtShutter, Shutter
from tpdwarp.settings import StageSettings
from tpdwarp.usd.read.appearances import Appearances
from tpdwarp.usd.read.blobs import Blobs, is_blob
from tpdwarp.usd.read.cameras import LONGEST_SHUTTER, Camera
from tpdwarp.usd.read.composed_prims import composed_prims
from tpdwarp.usd.read.contents import Contents, Walker
from tpdwarp.usd.read.diagnostics import usd_diagnostics
from tpdwarp.usd.read.domes import Dome
from tpdwarp.usd.read.draw_modes import draws_models_otherwise, lay_cards
from tpdwarp.usd.read.emptiness import why_empty
from tpdwarp.usd.read.frame_specs import frames_between
from tpdwarp.usd.read.free_camera import CAMERA_LIGHT, CAMERA_LIGHT_IRRADIANCE, FREE_CAMERA, FreeCamera, camera_light
from tpdwarp.usd.read.instance_limits import check_native_instances, refuse_too_many_prims
from tpdwarp.usd.read.instanced_lights import InstancedLights, InstancedMeshLight
from tpdwarp.usd.read.instances import InstancedMeshes
from tpdwarp.usd.read.layer_limits import checked_layers
from tpdwarp.usd.read.layer_rates import check_rates, mend_rates, rate_or_default
from tpdwarp.usd.read.lights import Light
from tpdwarp.usd.read.materials import Materials
from tpdwarp.usd.read.materialx_files import bring_in, references_materialx
from tpdwarp.usd.read.mesh_lights import MeshLight, all_parts, is_mesh_light
from tpdwarp.usd.read.meshes import OnStage, PlacedMesh, Placement
from tpdwarp.usd.read.motion_breaks import motion_breaks_of
from tpdwarp.usd.read.numbered_files import changes_by_frame
from tpdwarp.usd.read.outliers import Outliers
from tpdwarp.usd.read.patches import Patch
from tpdwarp.usd.read.primitives import Primitive, is_primitive, segments_for
from tpdwarp.usd.read.render_settings import MOST_PIXELS, RenderRequest, read_request
from tpdwarp.usd.read.samples import sample_times
from tpdwarp.usd.read.shapes import Shape
from tpdwarp.usd.read.skinning import Deformation, Skeletons
from tpdwarp.usd.read.solids import Solid
from tpdwarp.usd.read.subdivision.surface import SCHEMES, levels_for
from tpdwarp.usd.read.transforms import Transforms, union
from tpdwarp.usd.read.used_files import content_digest, used_files, used_layers
from tpdwarp.usd.read.uv import CornerCoordinates
from tpdwarp.usd.read.values import ITS_DEFAULT, text_at
from tpdwarp.usd.read.visibilities import visibility_varies

# Of images of stages that say nothing else: usdrecord's width, and the height of the default aperture for it.
DEFAULT_WIDTH, DEFAULT_HEIGHT = 960, 700
REFERENCE_COUNT = 9
# What is made anew for each frame and is no points or curves.
SURFACES: dict[type, type[Blobs]] = {UsdGeom.NurbsPatch: Patch, UsdGeom.TetMesh: Solid}
DEFAULT_PURPOSES = StageSettings().purposes
# Of the power of each kind of light: irradiance at normal incidence, radiant intensity, radiance (times a picture's).
UNITS = {"distant": "W/m2", "point": "W/sr", "dome": "W/(m2 sr)", "mesh": "W/(m2 sr)"}

# What names a stage: its file, its root layer, or itself.
StageLike = str | os.PathLike[str] | Sdf.Layer | Usd.Stage


@dataclass(frozen=True)
class _Refused:
    """A mesh that cannot be used, and whether it may carry a caustic."""

    error: InputError
    specular: bool


class StageScene:
    """A stage on disk, as :class:`tpdwarp.scene.description.SceneSource`. Made by :meth:`open`.

    Numbers stay in the stage's own world space and units; ``up_axis`` and ``meters_per_unit`` are reported only.
    Meshes of points that are not finite or of faces that do not fit are left out when a frame that needs them is asked
    for, also where nothing is left; the frame is refused where they may carry a caustic and nothing else does.

    Attributes:
        file: The stage's file.
        start, end: First and last time code, as authored on the stage, else the range of its authored samples.
        time_codes_per_second, frames_per_second: Rates of the stage.
        up_axis: ``Y`` or ``Z``.
        meters_per_unit: Metres in one scene unit.
        camera_path: The camera looked through; None where the stage has none and a free camera frames it.
        warnings: What was found that is not supported, a line a kind.
    """

    # Whether the stage's session layer is written to.
    EDITS_SESSION = False

    def __init__(self, file: str, stage: Usd.Stage, settings: StageSettings, warnings: WarnOnce) -> None:
        self.file, self.warnings = file, warnings
        self._stage, self._settings = stage, settings
        self._original: StageScene | None = None
        # Layers in memory that the stage is composed of.
        self._kept: list[Sdf.Layer] = []
        rates = {"timeCodesPerSecond": stage.GetTimeCodesPerSecond(), "framesPerSecond": stage.GetFramesPerSecond()}
        self.time_codes_per_second, self.frames_per_second = (
            rate_or_default(f"the stage's {name}", value, warnings) for name, value in rates.items()
        )
        self.up_axis = str(UsdGeom.GetStageUpAxis(stage))
        if self.up_axis not in ("Y", "Z"):
            warnings("the stage's upAxis", f"holds {self.up_axis!r}; {ITS_DEFAULT}, Y (author Y or Z)")
            self.up_axis = "Y"
        self.meters_per_unit = UsdGeom.GetStageMetersPerUnit(stage)
        self.start, self.end = _time_range(stage, warnings)
        self._request = read_request(stage, settings.render_settings, warnings, settings.product)
        self._cubic = settings.motion == "cubic"
        self._transforms = Transforms(self._cubic, warnings)
        self._materials = Materials(warnings, self._request.material_purpose)
        self._appearances = Appearances(self._materials, warnings)
        self._skeletons = Skeletons(self._transforms)
        self._outliers = Outliers(warnings)
        self._shapes: dict[str, Shape | Primitive | Blobs] = {}
        purposes = _purposes(settings, self._request)
        contents = Walker(purposes, self._transforms, warnings).walk(stage)
        if not contents.shows_anything and self._request.purposes is None and settings.purposes == DEFAULT_PURPOSES:
            purposes, contents = self._with_proxies(purposes, contents)
        self._bounded = not contents.circular
        if not contents.shows_anything:
            raise InputError(why_empty(stage, purposes), file)
        self._meshes = [
            self._place(str(prim.GetPath()), prim, OnStage(prim, self._transforms)) for prim in contents.meshes
        ]
        self._instancers = [
            InstancedMeshes(
                instancer,
                OnStage(instancer.instancer.GetPrim(), self._transforms),
                _weakly(self._place),
                _weakly(self._stays_apart),
                self._transforms,
            )
            for instancer in contents.instancers
        ]
        self._instanced_lights = [
            InstancedLights(
                instancer,
                OnStage(instancer.instancer.GetPrim(), self._transforms),
                self._transforms,
                self._animation,
                warnings,
            )
            for instancer in contents.instancers
            if instancer.holds_lights
        ]
        self._mesh_lights = {
            str(prim.GetPath()): MeshLight(prim, self._transforms, self._animation, warnings)
            for prim in contents.meshes
            if is_mesh_light(prim)
        }
        self._prototypes_shine = any(of.holds(is_mesh_light) for of in contents.instancers)
        self._instanced_mesh_lights: dict[str, MeshLight] = {}
        self._lights = [Light(prim, self._transforms, self._animation, warnings) for prim in contents.lights]
        self._domes = [Dome(prim, self._transforms, self._animation, warnings) for prim in contents.domes]
        self._cameras = [str(prim.GetPath()) for prim in contents.cameras]
        self._purposes = purposes
        self.camera_path = self._choose_camera()
        self._camera = self._camera_at(self.camera_path)
        self._camera_light = not self._lit()
        if self._camera_light:
            warnings("", "no light shines: a light at the camera stands in (add a UsdLux light)")

    @classmethod
    def open(cls, stage: StageLike, settings: StageSettings, max_memory: float = math.inf) -> StageScene:
        """Opens a stage and checks that it can be rendered.

        Args:
            stage: A USD file, a root layer, or a stage that is open already (of which nothing is changed).
            settings: ``motion``, ``purposes``, ``mask``, ``camera``, ``render_settings``, ``product``,
                ``image_width``, ``shutter`` and ``exposure`` are used.
            max_memory: Bytes that its largest array may need.

        Raises:
            InputError: The file cannot be read, or stands for more than can be rendered; no visible mesh; no such
                camera, mask or render settings.
        """
        if isinstance(stage, Usd.Stage):
            name = stage.GetRootLayer().identifier
            stage = _with_session_of_its_own(stage) if cls.EDITS_SESSION else stage
        elif isinstance(stage, Sdf.Layer):
            name = stage.identifier
        else:
            if not isinstance(stage, str | os.PathLike):
                raise InputError(f"the scene must be a file, an Sdf.Layer or a Usd.Stage, not {stage!r}")
            name = stage = os.fspath(stage)
            if not os.path.exists(name):
                raise InputError("no such file", name)
            if os.path.isdir(name):
                raise InputError("is a folder (name a USD file)", name)
        warnings = WarnOnce(name)
        with usd_diagnostics(warnings):
            # Kept until the stage is open, so that USD does not read them again.
            layers = checked_layers(name, max_memory) if isinstance(stage, str) else []
            refuse_too_many_prims(composed_prims(layers))
            mend_rates(layers, warnings)
            opened = _open_stage(stage, name, settings)
            check_rates(opened, name)
            if isinstance(stage, Usd.Stage) and (references_materialx(opened) or draws_models_otherwise(opened)):
                opened = _with_session_of_its_own(opened)
            kept = bring_in(opened, warnings)
            lay_cards(opened, warnings)
            del layers
            check_native_instances(opened)
            source = cls(name, opened, settings, warnings)
            source._kept = kept
            return source

    def with_product(self, product: str) -> StageScene:
        """The same stage as another product of its render settings shows it, by its path; what was read is shared.

        Raises:
            InputError: No such product, or it asks for what cannot be used.
        """
        other = copy(self)
        # What was read asks it.
        other._original = self
        # Whether anything changes depends on the camera where a light stands at it.
        other.__dict__.pop("_changes", None)
        other._settings = replace(self._settings, product=product)
        with usd_diagnostics(self.warnings):
            other._request = read_request(self._stage, self._settings.render_settings, self.warnings, product)
            other.camera_path = other._choose_camera()
            if other.camera_path != self.camera_path:
                other._camera = other._camera_at(other.camera_path)
        return other

    @property
    def lit_by_camera(self) -> bool:
        """Whether a light at the camera stands in for the stage's own."""
        return self._camera_light

    def camera_over(self, shutter: Shutter, meshes: Sequence[MeshAtShutter] = ()) -> CameraAtShutter:
        """The camera of :meth:`at`; a free one where its transform cannot be used, which is said.

        Args:
            shutter: The shutter.
            meshes: What it sees: a camera beyond all measure is brought nearer.

        Raises:
            InputError: Nothing is there that a free camera could frame.
        """
        with usd_diagnostics(self.warnings):
            width, height = self._resolution()
            image = width * self._request.pixel_aspect / height, self._request.policy
            try:
                found = self._camera.over(shutter, *image)
            except InputError as error:
                if self.camera_path is None:
                    raise
                message = f"{error.message}; until then a free camera frames the stage"
                self.warnings(error.prim, message, "camera nowhere")
                return self._free_camera.over(shutter, *image)
            return self._outliers.seen_from(found, meshes)

    def at(self, shutter: Shutter) -> SceneAtShutter:
        """The scene over ``shutter``; what does not move is the same object on every call.

        Raises:
            InputError: Geometry, materials, lights or a camera that cannot be used.
        """
        with usd_diagnostics(self.warnings):
            self._warn_outside(shutter)
            meshes = self._meshes_over(shutter)
            lights = tuple(found for light in self._lights_at(shutter.frame) for found in light.all_over(shutter))
            camera = self.camera_over(shutter, meshes)
            if self._mesh_lights_at(shutter.frame):
                meshes, more = self._shining(meshes, shutter)
                lights += more
            lights = self._outliers.lit(self._linked(lights, shutter), meshes)
            if self._camera_light:
                lights = (camera_light(camera, meshes),)
            domes = tuple(found for dome in self._domes if (found := dome.at(shutter)) is not None)
            if domes and any(mesh.specular for mesh in meshes):
                self.warnings(domes[0].path, "light of a dome shines through glass straight, and makes no caustics")
            return SceneAtShutter(shutter, meshes, lights, camera, domes)

    def _shining(
        self, meshes: tuple[MeshAtShutter, ...], shutter: Shutter
    ) -> tuple[tuple[MeshAtShutter, ...], tuple[LightAtShutter, ...]]:
        """The meshes, those that shine as they are seen, and the lights that these are."""
        seen: list[MeshAtShutter] = []
        lights: list[LightAtShutter] = []
        shining = self._mesh_lights_at(shutter.frame)
        for mesh in meshes:
            light = shining.get(mesh.path)
            parts = [] if light is None else light.parts(mesh, shutter)
            own = frozenset((mesh.path,))
            lights += [replace(part, unlit=own, passed=own) for part in parts]
            seen.append(light.shining(mesh, shutter) if parts else mesh)
        return tuple(seen), tuple(lights)

    def _linked(self, lights: tuple[LightAtShutter, ...], shutter: Shutter) -> tuple[LightAtShutter, ...]:
        """The lights with what their collections say of meshes."""
        sources = (*self._lights_at(shutter.frame), *self._mesh_lights_at(shutter.frame).values())
        links = {light.path: light.links for light in sources}
        limited = {path: found for path, found in links.items() if found.limited}
        if not limited:
            return lights
        meshes = [
            (label, collected_as(label, placed.prim))
            for placed in self._placed(shutter.frame)
            for label in placed.copies or (placed.label,)
        ]
        found = []
        for light in lights:
            own = limited.get(light.path) or limited.get(light.path.rpartition("/light")[0])
            unlit, passed = own.of(meshes) if own else (frozenset(), frozenset())
            found.append(replace(light, unlit=light.unlit | unlit, passed=light.passed | passed))
        return tuple(found)

    def _meshes_over(self, shutter: Shutter) -> tuple[MeshAtShutter, ...]:
        """The meshes over ``shutter``, without those that cannot be used.

        Raises:
            InputError: None of those that may carry a caustic can be used.
        """
        refused: list[_Refused] = []
        meshes = [mesh for placed in self._placed(shutter.frame) for mesh in self._usable(placed, shutter, refused)]
        carriers = [found.error for found in refused if found.specular]
        if carriers and not any(mesh.specular for mesh in meshes):
            raise carriers[0]
        self._say(refused)
        return tuple(self._outliers.without(meshes))

    def _usable(self, placed: PlacedMesh, shutter: Shutter, refused: list[_Refused]) -> list[MeshAtShutter]:
        """What there is of a mesh, or of many copies of one; what cannot be used is added to ``refused``."""
        try:
            mesh = placed.over(shutter)
        except InputError as error:
            if placed.copies:
                copies = set(placed.copies)
                alone = [one for of in self._instancers for one in of.apart(shutter.frame) if one.label in copies]
                return [mesh for one in alone for mesh in self._usable(one, shutter, refused)]
            # With its frames it would be part of a circle, see `_weakly`.
            specular = self._materials.may_be_specular(placed.prim, shutter.frame)
            refused.append(_Refused(error.with_traceback(None), specular))
            return []
        return [] if mesh is None else [mesh]

    def _say(self, refused: list[_Refused]) -> None:
        for error in (found.error for found in refused):
            # Of one kind are those whose attribute of the same name is to blame.
            kind = f"left out for {error.prim.rsplit('/', 1)[-1].partition('.')[2]}"
            self.warnings(error.prim, f"{error.message}; until then the mesh is left out", kind)

    def coordinates(self, path: str, name: str, shutter: Shutter) -> CornerCoordinates | None:
        """Texture coordinates of the triangles of one of the meshes of :meth:`at`; None where it is not there.

        Args:
            path: Of the mesh, as in ``MeshAtShutter``.
            name: Primvar that holds them; a mesh without it is projected along its thinnest axis.
            shutter: The shutter.

        Raises:
            InputError: Coordinates that cannot be used.
        """
        with usd_diagnostics(self.warnings):
            alone = (one for of in self._instancers for one in of.apart(shutter.frame))
            for placed in itertools.chain(self._meshes, alone):
                if placed.label == path:
                    return placed.coordinates(name, shutter)
        return None

    @property
    def products(self) -> tuple[tuple[str, str], ...]:
        """Path and name of each product of the render settings."""
        return self._request.products

    @property
    def render_settings_path(self) -> str:
        """Path of the render settings; empty where the stage has none."""
        return self._request.path

    @property
    def render_vars(self) -> tuple[str, ...]:
        """What the RenderVars of the product are called, but the beauty."""
        return self._request.render_vars

    @property
    def stage(self) -> Usd.Stage:
        """The stage itself, to be read only."""
        return self._stage

    def frames(self) -> tuple[float, ...]:
        """The frames of the stage's range; its first alone where nothing changes.

        Raises:
            InputError: There are more than a million.
        """
        with usd_diagnostics(self.warnings):
            if not self._changes and not self._any_attribute_varies():
                return frames_between(self.start, self.start)
        return frames_between(self.start, self.end)

    def reference_shutters(self) -> list[Shutter]:
        """Up to nine stills spread evenly over the animation, the first at its start; one where nothing moves."""
        with usd_diagnostics(self.warnings):
            if self.end <= self.start or not self._changes:
                return [Shutter.still(self.start)]
        step = (self.end - self.start) / (REFERENCE_COUNT - 1)
        return [Shutter.still(self.start + step * k) for k in range(REFERENCE_COUNT)]

    def motion_breaks(self, shutter: Shutter) -> list[float]:
        """Times within ``shutter`` at which motion may change abruptly: those of time samples, unless it is cubic."""
        if self._cubic:
            return []
        with usd_diagnostics(self.warnings):
            prims = [mesh.prim for mesh in self._placed(shutter.frame)]
            prims += [of.instancer.instancer.GetPrim() for of in self._instancers]
            prims += [light.prim for light in self._lights_at(shutter.frame)]
            deformed = (shape for shape in self._shapes.values() if not isinstance(shape, Primitive))
            skinned = {t for shape in deformed for t in shape.deformed_at}
            found = motion_breaks_of(prims, shutter.open, shutter.close)
            return sorted({*found, *(t for t in skinned if shutter.open < t < shutter.close)})

    def light_groups(self) -> dict[str, str]:
        """The group that each light but domes names itself, by its path; empty where it names none."""
        if self._camera_light:
            return {CAMERA_LIGHT: ""}
        own = {light.path: light.group for light in self._lights_at(self.start)}
        shining = self._mesh_lights_at(self.start)
        if shining:
            parts = self.at(Shutter.still(self.start)).lights
            bending = {placed.label for placed in self._placed(self.start) if placed.shape.span is not None}
            for part in parts:
                if (whole := part.path.rpartition("/light")[0]) in shining:
                    # What bends may be more lights later.
                    paths = all_parts(whole) if whole in bending else [part.path]
                    own |= dict.fromkeys(paths, shining[whole].group or whole.rpartition("/")[2])
        return own

    def resolution(self) -> tuple[int, int]:
        """Width and height of the image in pixels.

        ``settings.resolution`` comes first; then ``settings.image_width``, its height from the camera's aspect (rounded
        down, as usdrecord does); then the render settings' resolution; then a width of 960.

        Raises:
            InputError: The camera's aperture has no size.
        """
        if self.camera_path is None:
            self.warnings("", "the stage has no camera: a free camera frames it (add a Camera prim to choose the view)")
        return self._resolution()

    def region(self) -> ImageRegion:
        """The part of the image that is rendered: by ``settings.crop``, else by the render settings.

        Raises:
            InputError: As :meth:`resolution`; the crop lies outside of the image.
        """
        whole, crop = ImageRegion.whole(*self.resolution()), self._settings.crop
        if crop is None:
            return whole.of_ndc(self._request.data_window)
        if max(crop) <= 1.0:
            return whole.of_ndc(crop)
        first, above, end, below = map(int, crop)
        if first >= whole.width or above >= whole.height:
            size = f"{whole.width} × {whole.height}"
            raise InputError(f"--crop {first} {above} {end} {below} lies outside of the image of {size}", self.file)
        return whole.of_pixels(first, above, end, below)

    def _resolution(self) -> tuple[int, int]:
        if self._settings.resolution is not None:
            return self._checked(*self._settings.resolution)
        if self._settings.image_width is None and self._request.resolution is not None:
            return self._checked(*self._request.resolution)
        width = self._settings.image_width or DEFAULT_WIDTH
        with usd_diagnostics(self.warnings):
            height = width * self._request.pixel_aspect / self._camera.aspect(self.start)
            if not width * height <= MOST_PIXELS:
                usual = max(1, width * DEFAULT_HEIGHT // DEFAULT_WIDTH)
                self.warnings(
                    self.camera_path or "",
                    f"its aperture makes an image of {width} × {height:.6g} pixels: it is {width} × {usual} "
                    "(author other apertures)",
                )
                return self._checked(width, usual)
        # Apertures are stored in single precision, whose rounding must not cost a row.
        return self._checked(width, height * (1 + 1e-6))

    @property
    def pixel_aspect(self) -> float:
        """Width of a pixel over its height, as the image shows the camera's window."""
        if self._request.policy == "adjustPixelAspectRatio":
            width, height = self._resolution()
            return self._camera.aspect(self.start) * height / width
        return self._request.pixel_aspect

    def _checked(self, width: int, height: float) -> tuple[int, int]:
        if not width * max(1.0, height) <= MOST_PIXELS:
            raise InputError(
                f"an image of {width} × {height:.6g} pixels is more than {MOST_PIXELS} (correct the resolution or "
                "--imageWidth)",
                self.file,
                self._request.path or self.camera_path or "",
            )
        return width, max(1, math.floor(height))

    def shutter(self, frame: float, settings: StageSettings) -> Shutter:
        """The shutter of a frame.

        ``settings.shutter`` or ``settings.exposure`` come first; then a still where the render settings disable motion
        blur; then the camera's ``shutter:open`` and ``shutter:close``; a still without a camera.

        Args:
            frame: Time code of the frame.
            settings: The settings.

        Raises:
            InputError: The camera's shutter closes before it opens, or the shutter is absurdly long.
        """
        if settings.shutter is not None:
            opening, closing = settings.shutter
        elif settings.exposure is not None:
            opening, closing = 0.0, settings.exposure
        elif self._request.still:
            opening, closing = 0.0, 0.0
        else:
            with usd_diagnostics(self.warnings):
                opening, closing = self._camera.shutter_interval(frame)
        if max(abs(opening), abs(closing)) > LONGEST_SHUTTER:
            raise InputError(
                f"a shutter from {opening:g} to {closing:g} frames is too long (author or ask for less than "
                f"{LONGEST_SHUTTER:g})",
                self.file,
                self._camera.path,
            )
        return Shutter(frame, frame + opening, frame + closing)

    def describe(self) -> dict[str, Any]:
        """What the stage holds, as plain JSON values: evaluated at its start.

        Raises:
            InputError: As :meth:`at`.
        """
        with usd_diagnostics(self.warnings):
            return {
                "file": self.file,
                "frames": {"start": self.start, "end": self.end},
                "time_codes_per_second": self.time_codes_per_second,
                "frames_per_second": self.frames_per_second,
                "up_axis": self.up_axis,
                "meters_per_unit": self.meters_per_unit,
                "meshes": self._described_meshes(),
                "lights": self._described_lights(),
                "cameras": self._described_cameras(),
                "render_settings": self._request.path,
                "warnings": list(self.warnings.messages),
            }

    def used_files(self) -> list[str]:
        """Files that the stage reads now or may read for some frame; see :func:`used_files.used_files`."""
        return used_files(self._stage)

    def used_layers(self) -> dict[str, Sdf.Layer]:
        """The layers on disk that are open, by their files."""
        return used_layers(self._stage)

    def content_digest(self, file_digests: Iterable[str]) -> str:
        """Hash of what the stage's files, by their own digests, and its layers in memory hold."""
        return content_digest(self._stage, file_digests)

    @property
    def _animation(self) -> tuple[float, float]:
        return self.start, self.end

    def _described_meshes(self) -> list[dict[str, Any]]:
        described: dict[str, dict[str, Any]] = {}
        refused: list[_Refused] = []
        for placed in self._placed(self.start):
            mesh = next(iter(self._usable(placed, Shutter.still(self.start), refused)), None)
            entry = described.setdefault(
                str(placed.prim.GetPath()),
                {
                    "path": str(placed.prim.GetPath()),
                    "triangles": 0 if mesh is None else len(mesh.triangles) // placed.count,
                    "instances": 0,
                    "moves": False,
                    "interactions": _interactions(mesh),
                },
            )
            entry["instances"] += placed.count
            entry["moves"] |= placed.varies
        self._say(refused)
        return list(described.values())

    def _described_cameras(self) -> list[dict[str, Any]]:
        cameras = [{"path": path, "used": path == self.camera_path} for path in self._cameras]
        return cameras if self.camera_path is not None else [{"path": FREE_CAMERA, "used": True}]

    def _described_lights(self) -> list[dict[str, Any]]:
        lights = [self._described_light(light) for light in self._sources_at(self.start)]
        if self._camera_light:
            power = [CAMERA_LIGHT_IRRADIANCE] * 3
            unit = UNITS["distant"]
            moves = self._camera.moves
            lights.append({"path": CAMERA_LIGHT, "kind": "distant", "power": power, "unit": unit, "moves": moves})
        return lights

    def _described_light(self, light: Light) -> dict[str, Any]:
        extent = light.extent_in_words(self.start)
        return {
            "path": light.path,
            "kind": light.kind_name,
            "power": list(light.power(self.start)),
            "unit": UNITS[light.kind_name],
            "moves": light.varies,
            **({"extent": extent} if extent else {}),
        }

    def _place(self, label: str, prim: Usd.Prim, placement: Placement, copies: tuple[str, ...] = ()) -> PlacedMesh:
        deformation = self._skeletons.deformation(prim) if prim.IsA(UsdGeom.PointBased) else None
        # Instances share their shape, unless each has a skeleton of its own.
        shared = prim.IsInstanceProxy() and deformation is None
        key = str((prim.GetPrimInPrototype() if shared else prim).GetPath())
        if key not in self._shapes:
            self._shapes[key] = self._shape(prim, deformation)
        return PlacedMesh(
            label,
            prim,
            self._shapes[key],
            placement,
            self._animation,
            self._cubic,
            self._appearances,
            self.warnings,
            copies,
        )

    def _shape(self, prim: Usd.Prim, deformation: Deformation | None) -> Shape | Primitive | Blobs:
        segments, levels = _weakly(self._segments), _weakly(self._levels)
        if is_primitive(prim):
            return Primitive(prim, lambda: segments(prim), self._cubic, self.warnings)
        if is_blob(prim):
            kind = next((kind for schema, kind in SURFACES.items() if prim.IsA(schema)), Blobs)
            return kind(prim, self.warnings, deformation)
        return Shape(
            UsdGeom.Mesh(prim),
            self.time_codes_per_second,
            self._cubic,
            lambda faces: levels(prim, faces),
            self.warnings,
            deformation,
        )

    def _levels(self, prim: Usd.Prim, faces: int) -> int:
        """How often the cage of a subdivision surface is refined."""
        specular = self._materials.may_be_specular(prim, self.start)
        return levels_for(faces, specular, self._subdivision_count, self._settings.complexity)

    @cached_property
    def _subdivision_count(self) -> int:
        return sum(placed.count for placed in self._placed(self.start) if _is_subdivided(placed.prim))

    def _segments(self, prim: Usd.Prim) -> int:
        """Segments of a circle of a primitive."""
        return segments_for(self._materials.may_be_specular(prim, self.start), self._primitive_count)

    @cached_property
    def _primitive_count(self) -> int:
        return sum(placed.count for placed in self._placed(self.start) if is_primitive(placed.prim))

    def _placed(self, frame: float) -> Iterator[PlacedMesh]:
        yield from self._meshes
        for instancer in self._instancers:
            yield from instancer.meshes(frame)

    def _stays_apart(self, prim: Usd.Prim, frame: float) -> bool:
        """Whether instances of a mesh are not read together: they may be specular, or shine."""
        return is_mesh_light(prim) or self._materials.may_be_specular(prim, frame)

    def _lights_at(self, frame: float) -> Iterator[Light]:
        """The lights but meshes and domes, those of instances at a time code included."""
        yield from self._lights
        for of in self._instanced_lights:
            yield from of.at(frame)

    def _mesh_lights_at(self, frame: float) -> dict[str, MeshLight]:
        """The meshes that shine by their paths, those of instances at a time code included."""
        if not self._prototypes_shine:
            return self._mesh_lights
        placed = (one for of in self._instancers for one in of.meshes(frame) if is_mesh_light(one.prim))
        for one in placed:
            if one.label not in self._instanced_mesh_lights:
                arguments = one.prim, self._transforms, self._animation, self.warnings, one.label
                self._instanced_mesh_lights[one.label] = InstancedMeshLight(*arguments)
        return self._mesh_lights | self._instanced_mesh_lights

    def _sources_at(self, frame: float) -> list[Light | Dome]:
        """All that may shine at a time code."""
        return [*self._lights_at(frame), *self._domes, *self._mesh_lights_at(frame).values()]

    @cached_property
    def _changes(self) -> bool:
        """Whether any mesh or light (or the camera, whose light stands in for one) ever moves, appears or changes."""
        if self._camera_light and self._camera.moves:
            return True
        if any(mesh.varies or visibility_varies(mesh.prim) for mesh in self._placed(self.start)):
            return True
        for instancer in self._instancers:
            if instancer.instancer.span is not None or visibility_varies(instancer.instancer.instancer.GetPrim()):
                return True
        lights = self._sources_at(self.start)
        return any(light.varies or light.power_varies or visibility_varies(light.prim) for light in lights)

    def _any_attribute_varies(self) -> bool:
        roots = [self._stage.GetPseudoRoot(), *self._stage.GetPrototypes()]
        prims = (prim for root in roots for prim in Usd.PrimRange(root))
        attributes = (attribute for prim in prims for attribute in prim.GetAuthoredAttributes())
        return any(
            attribute.ValueMightBeTimeVarying() or changes_by_frame(attribute, self.start) for attribute in attributes
        )

    def _points_at(self, frame: float) -> Iterator[np.ndarray]:
        for mesh in self._meshes_over(Shutter.still(frame)):
            yield mesh.points

    def _warn_outside(self, shutter: Shutter) -> None:
        span = self._animation
        for placed in self._meshes:
            span = union(span, placed.span)
        for instancer in self._instancers:
            span = union(span, instancer.instancer.span)
        for prim in (*(light.prim for light in self._lights), *map(self._stage.GetPrimAtPath, self._cameras)):
            span = union(span, self._transforms.span(prim))
        if not span[0] <= shutter.frame <= span[1] and self._changes:
            self.warnings("", f"frames outside the animation, {span[0]:g} … {span[1]:g}, show its first or last moment")

    def _camera_at(self, path: str | None) -> Camera | FreeCamera:
        """The camera at a path; one that frames the stage without."""
        if path is None:
            return self._free_camera
        return Camera(self._stage.GetPrimAtPath(path), self._transforms, self._animation, self.warnings)

    @cached_property
    def _free_camera(self) -> FreeCamera:
        points = _weakly(self._points_at)
        return FreeCamera(self._stage, self.start, self.up_axis, self._purposes, points, self._bounded)

    def _choose_camera(self) -> str | None:
        wanted = self._settings.camera
        there_are = f"there are {', '.join(self._cameras)}" if self._cameras else "the stage has none"
        if wanted and not wanted.startswith("/"):
            named = [path for path in self._cameras if path.rsplit("/", 1)[-1] == wanted]
            if not named:
                raise InputError(f"no camera is named so ({there_are})", self.file, wanted)
            if len(named) > 1:
                self.warnings(named[0], f"is used; other cameras are named {wanted} too")
            return named[0]
        path = wanted or self._request.camera
        if path:
            if path not in self._cameras:
                exists = Sdf.Path.IsValidPathString(path) and bool(self._stage.GetPrimAtPath(path))
                what = "is no camera" if exists else "no such camera"
                raise InputError(f"{what} ({there_are})", self.file, path)
            return path
        primary = str(UsdUtils.GetPrimaryCameraName())
        first = next((path for path in self._cameras if path.rsplit("/", 1)[-1] == primary), "")
        if len(self._cameras) > 1 and not first:
            self.warnings(
                self._cameras[0], f"is used, the first of {len(self._cameras)} cameras (choose with --camera)"
            )
        return first or (self._cameras[0] if self._cameras else None)

    def _with_proxies(self, purposes: frozenset[str], contents: Contents) -> tuple[frozenset[str], Contents]:
        """The purposes and contents of a stage that shows nothing for ``purposes``: its proxies, if it has any."""
        more = purposes | {str(UsdGeom.Tokens.proxy)}
        found = Walker(more, self._transforms, WarnOnce(self.file, silent=True)).walk(self._stage)
        if not found.shows_anything:
            return purposes, contents
        self.warnings("", "nothing is of purpose default or render: what is of purpose proxy is rendered")
        return more, Walker(more, self._transforms, self.warnings).walk(self._stage)

    def _lit(self) -> bool:
        """Whether any light shines at any time."""
        return any(
            light.ever_visible and (light.power_varies or any(light.power(self.start)))
            for light in self._sources_at(self.start)
        )


def _weakly(method: Callable[..., Any]) -> Callable[..., Any]:
    """A method for what its object holds itself.

    A circle of references would keep the layers of a stage open, and as they were, after a render: until Python next
    looks for circles, whoever writes their files anew renders what they held before.
    """
    weak = weakref.WeakMethod(method)
    return lambda *arguments: weak()(*arguments)


def collected_as(label: str, prim: Usd.Prim) -> Sdf.Path:
    """The path that collections know a mesh of this label by: its own, or its instancer's."""
    instancer, instanced, _ = label.partition("[")
    return Sdf.Path(instancer) if instanced else prim.GetPath()


def _is_subdivided(prim: Usd.Prim) -> bool:
    """Whether a prim is a subdivision surface."""
    return prim.IsA(UsdGeom.Mesh) and text_at(UsdGeom.Mesh(prim).GetSubdivisionSchemeAttr()) in SCHEMES


def _interactions(mesh: MeshAtShutter | None) -> list[str]:
    return [] if mesh is None else sorted({material.interaction.name.lower() for material in mesh.materials})


def _open_stage(given: str | Sdf.Layer | Usd.Stage, file: str, settings: StageSettings) -> Usd.Stage:
    opened = (given.GetRootLayer(), given.GetSessionLayer()) if isinstance(given, Usd.Stage) else (given,)
    if not settings.mask:
        return given if isinstance(given, Usd.Stage) else Usd.Stage.Open(given)
    mask = Usd.StagePopulationMask()
    for path in settings.mask:
        if not Sdf.Path.IsValidPathString(path) or not Sdf.Path(path).IsAbsoluteRootOrPrimPath():
            raise InputError("is no prim path (correct --mask)", file, path)
        mask.Add(path)
    # What is asked for by name is wanted whatever the mask says.
    for path in (settings.camera, settings.render_settings):
        if path.startswith("/") and Sdf.Path.IsValidPathString(path):
            mask.Add(path)
    stage = Usd.Stage.OpenMasked(*opened, mask)
    for path in settings.mask:
        if not stage.GetPrimAtPath(path):
            raise InputError("no such prim (correct --mask)", file, path)
    stage.ExpandPopulationMask()
    return stage


def _with_session_of_its_own(stage: Usd.Stage) -> Usd.Stage:
    """The same stage again, with a copy of its session layer, so that edits do not reach its owner."""
    session = Sdf.Layer.CreateAnonymous()
    session.TransferContent(stage.GetSessionLayer())
    copy = Usd.Stage.Open(stage.GetRootLayer(), session, stage.GetPathResolverContext(), Usd.Stage.LoadNone)
    copy.SetLoadRules(stage.GetLoadRules())
    copy.MuteAndUnmuteLayers(stage.GetMutedLayers(), [])
    return copy


def _time_range(stage: Usd.Stage, warnings: WarnOnce) -> tuple[float, float]:
    if stage.HasAuthoredTimeCodeRange():
        start, end = stage.GetStartTimeCode(), stage.GetEndTimeCode()
        if math.isfinite(start) and math.isfinite(end) and start <= end:
            return start, end
        warnings("the stage's range of time codes", f"holds {start:g} … {end:g}: that of its samples is taken")
    span = None
    for prim in Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)):
        for attribute in prim.GetAuthoredAttributes():
            times = sample_times(attribute)
            if times:
                span = union(span, (times[0], times[-1]))
    return span or (0.0, 0.0)


def _purposes(settings: StageSettings, request: RenderRequest) -> frozenset[str]:
    """The purposes rendered: those of the render settings unless the user asked for others."""
    if request.purposes is not None and settings.purposes == DEFAULT_PURPOSES:
        return frozenset(request.purposes)
    return frozenset({"default", *settings.purposes})
