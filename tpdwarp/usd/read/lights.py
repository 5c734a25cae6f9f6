"""UsdLux lights: parallel light and points, with the extent that they have."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from functools import cached_property

import numpy as np
from pxr import Usd, UsdGeom, UsdLux

from tpdwarp.errors import InputError, WarnOnce
from tpdwarp.io.ies import read_profile
from tpdwarp.scene.description import (
    PROFILE_COUNT,
    EmissionProfile,
    Extent,
    ExtentShape,
    LightAtShutter,
    LightKind,
    Shaping,
    Shutter,
)
from tpdwarp.scene.light_places import tiles_of
from tpdwarp.scene.stretched_lights import (
    SPHERE_NORMALS,
    TUBE_NORMALS,
    area_stretched,
    ellipsoid_of,
    faces_of,
    is_stretched,
)
from tpdwarp.usd.read.coordinate_frames import about_x, along_normal, as_they_are, frame_over, rows_over
from tpdwarp.usd.read.hosts import BLENDER_ANGLE, BLENDER_SUN, BLENDER_WHITE, is_of_blender
from tpdwarp.usd.read.light_filters import LightFilters
from tpdwarp.usd.read.light_inputs import PREFIX, light_input, old_inputs
from tpdwarp.usd.read.links import LightLinks
from tpdwarp.usd.read.materials.textures import picture_of
from tpdwarp.usd.read.numbered_files import file_at
from tpdwarp.usd.read.samples import sample_times
from tpdwarp.usd.read.transforms import Transforms
from tpdwarp.usd.read.values import (
    FROM_0,
    ITS_DEFAULT,
    not_negative,
    number_or_fallback,
    text_at,
    usable_number,
    value_or_fallback,
)
from tpdwarp.usd.read.visibilities import may_be_visible

# Kinds that are rendered, with the area in their own space of those that have one, by the names of their sizes.
AREAS: dict[type, tuple[tuple[str, ...], Callable[..., float]]] = {
    UsdLux.SphereLight: (("radius",), lambda radius: 4.0 * math.pi * radius**2),
    UsdLux.RectLight: (("width", "height"), lambda width, height: width * height),
    UsdLux.DiskLight: (("radius",), lambda radius: math.pi * radius**2),
    UsdLux.CylinderLight: (("radius", "length"), lambda radius, length: 2.0 * math.pi * radius * length),
}
# How they shine, by how much more along the axis of their profile than on average over all directions: a surface of
# radiance L and area A sends π L A, flat ones L A along their normal, cylinders L A/π across their axis.
PROFILES: dict[type, tuple[EmissionProfile, float]] = {
    UsdLux.SphereLight: (EmissionProfile.UNIFORM, 0.25),
    UsdLux.RectLight: (EmissionProfile.COSINE, 1.0),
    UsdLux.DiskLight: (EmissionProfile.COSINE, 1.0),
    UsdLux.CylinderLight: (EmissionProfile.SINE, 1.0 / math.pi),
}
# Which directions a sheared transform keeps: what is flat shines along its normal, a tube by the sine to its axis.
UNSHEARED = {UsdLux.RectLight: along_normal, UsdLux.DiskLight: along_normal, UsdLux.CylinderLight: about_x}
# What is shaped by profiles of luminaires.
PROFILED = (UsdLux.SphereLight, UsdLux.RectLight, UsdLux.DiskLight)
# Nodes and weights on −1 … 1 that integrate polynomials up to the fifth degree exactly.
GAUSS_NODES, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(3)

# Pictures of rectangles are brought down to so many rows: each pixel is a light. Chosen, not derived.
PICTURE_ROWS = 4
# Where lights name their groups for other renderers: ours, then RenderMan's, Karma's and Arnold's.
GROUP_ATTRIBUTES = (
    "tpdwarp:lightGroup",
    "primvars:ri:attributes:identifier:lpegroup",
    "inputs:ri:light:lightGroup",
    "ri:light:lightGroup",
    "inputs:karma:light:lpetag",
    "karma:light:lpetag",
    "primvars:arnold:aov",
    "inputs:arnold:aov",
)

EARLIEST = Usd.TimeCode.EarliestTime().GetValue()

# What photographs of suns and what the account of energy hold; squares of it stay numbers.
LARGEST = 1e60


class Light:
    """A light that is rendered.

    With L = intensity × 2^exposure × color (× the blackbody colour, × ``diffuse``):

    - DistantLight, angle 0: L is the irradiance at normal incidence. With an angle, a disc of directions of radiance L,
      whose irradiance is L π sin²(angle/2), or L with ``normalize``.
    - Sphere, rectangle, disk or cylinder (its side) of area A in the world: a surface of radiance L, whose radiant
      intensity is at most L A / 4, L A, L A and L A / π; with ``normalize`` without A. Rectangles and disks shine to
      one side, by the cosine (see :class:`EmissionProfile`).
    - SphereLight of radius 0: L is the radiant intensity itself, because there is no area to carry a radiance. With
      ``treatAsPoint`` it is a point of the same radiant intensity.

    Over a shutter the light has its mean power, and shines for the part of it in which it is visible.
    """

    def __init__(
        self,
        prim: Usd.Prim,
        transforms: Transforms,
        animation: tuple[float, float],
        warnings: WarnOnce,
        path: str = "",
    ) -> None:
        self.prim, self.path = prim, path or str(prim.GetPath())
        self._transforms, self._animation, self._warnings = transforms, animation, warnings
        self._api = UsdLux.LightAPI(prim)
        self.links = LightLinks(self._api, warnings)
        self._of_blender = is_of_blender(prim)
        self.kind = LightKind.DISTANT if prim.IsA(UsdLux.DistantLight) else LightKind.POINT
        self._shape = next((kind for kind in AREAS if prim.IsA(kind)), None)
        self.varies = transforms.span(prim) is not None
        old = old_inputs(prim)
        if old:
            warnings(
                f"{self.path}.{old[0]}", "is named as before USD 21.02, and read as what is inputs:… now", "old names"
            )
        self._inputs = [
            a for a in prim.GetAttributes() if a.GetName().startswith(PREFIX) or a.GetName() in ("treatAsPoint", *old)
        ]
        self._filters = LightFilters(self._api, self.path, warnings)
        self._inputs += self._filters.attributes
        self.power_varies = any(attribute.ValueMightBeTimeVarying() for attribute in self._inputs)
        self._visibilities = changing_visibilities(prim)
        self._pictures: dict[str, np.ndarray | None] = {}
        self._profiles: dict[tuple[str, float, bool], tuple[float, tuple[float, ...]] | None] = {}
        self._warn_unsupported()

    @property
    def kind_name(self) -> str:
        """What it is rendered as."""
        return self.kind.name.lower()

    @property
    def group(self) -> str:
        """The light group that it names for this or another renderer; empty for none."""
        attributes = (self.prim.GetAttribute(name) for name in GROUP_ATTRIBUTES)
        named = (str(text_at(found, EARLIEST) or "") for found in attributes if found and found.HasAuthoredValue())
        return next((name for name in named if name and name != "default"), "")

    def extent_in_words(self, frame: float) -> str:
        """What it is in its own space, if it has an extent; else empty."""
        if self.kind == LightKind.DISTANT:
            angle = self._angle(frame)
            return f"a disc of {angle:g} degrees" if angle else ""
        sizes = [] if self._shape is None else self._sizes(frame)
        if not sizes or not all(sizes) or self._asks_to_be_a_point(frame):
            return ""
        names, _ = AREAS[self._shape]
        given = ", ".join(f"{name} {size:g}" for name, size in zip(names, sizes, strict=True))
        return f"a {self.prim.GetTypeName().removesuffix('Light').lower()} of {given}"

    @property
    def ever_visible(self) -> bool:
        """Whether it is visible at some time."""
        return may_be_visible(self.prim)

    def visible(self, frame: float) -> bool:
        return UsdGeom.Imageable(self.prim).ComputeVisibility(frame) != UsdGeom.Tokens.invisible

    def over(self, shutter: Shutter) -> LightAtShutter | None:
        """The light over ``shutter``; None where it is invisible, gives no light or, which is said, is nowhere."""
        power = self._mean_power(shutter)
        if not any(power):
            return None
        try:
            return self._placed(power, shutter)
        except InputError as error:
            self._leave_out(error)
            return None

    def _placed(self, power: tuple[float, float, float], shutter: Shutter) -> LightAtShutter:
        """A light of this power where it stands over ``shutter``.

        Raises:
            InputError: Its transform cannot be used.
        """
        unsheared = UNSHEARED.get(self._shape, as_they_are)
        position, axes, position_motion, axes_motion = frame_over(
            self.prim, shutter, self._transforms, self._animation, self._warnings, unsheared
        )
        shaping, profile, reshaped = None, EmissionProfile.UNIFORM, False
        if self.kind == LightKind.POINT:
            profile, _ = PROFILES[self._shape]
            shaping = self._shaping(shutter.middle)
            times = self._ends_and_samples(shutter) if self.power_varies else []
            reshaped = any(self._shaping(time) != shaping for time in times)
        extent = self._extent(shutter)
        place = position, axes, position_motion, axes_motion
        return LightAtShutter(self.path, self.kind, power, *place, shaping, profile, extent, reshaped=reshaped)

    def all_over(self, shutter: Shutter) -> list[LightAtShutter]:
        """The lights that it is over ``shutter``: none, itself, or one for each part of a rectangle's picture."""
        light = self.over(shutter)
        if light is None:
            return []
        if light.extent is None or light.kind == LightKind.DISTANT or light.extent.shape == ExtentShape.DISK:
            return [light]
        if light.extent.shape != ExtentShape.RECT:
            return self._stretched(light, shutter)
        colors = self._picture(shutter.frame)
        return [light] if colors is None else tiles_of(light, colors)

    def _stretched(self, light: LightAtShutter, shutter: Shutter) -> list[LightAtShutter]:
        """A sphere or cylinder as it is, or what stands in its place where its transform makes it another shape."""
        rows, motion = rows_over(self.prim, shutter, self._transforms, self._animation, self._warnings)
        if not is_stretched(light.extent.shape, rows):
            return [light]
        sizes, motions = self._sizes_over(shutter, self._sizes)
        if light.extent.shape == ExtentShape.ROUND:
            return [ellipsoid_of(light, sizes[0], rows, motion, motions[0])]
        return faces_of(light, *sizes, rows, motion, motions)

    def _picture(self, frame: float) -> np.ndarray | None:
        """A rectangle's picture, brought down to a few pixels, shape [h, w, 3]; None where it has none."""
        attribute = self._input("texture:file")
        path = file_at(attribute, frame)
        if not path:
            return None
        if path not in self._pictures:
            self._pictures = {path: picture_of(path, PICTURE_ROWS)}
        if self._pictures[path] is None:
            self._warnings(str(attribute.GetPath()), "cannot be read: the rectangle is of its colour all over")
        return self._pictures[path]

    def _extent(self, shutter: Shutter) -> Extent | None:
        """Its extent over a shutter, where it stands in its middle; None where it has none, its transform leaves none,
        or it asks to be a point."""
        if self.kind == LightKind.DISTANT:
            (angle,), (motion,) = self._sizes_over(shutter, lambda at: [min(self._angle(at), 180.0)])
            half, change = math.radians(0.5 * angle), math.radians(0.5 * motion)
            return Extent(ExtentShape.ROUND, half, radius_motion=change) if angle > 0 else None
        sizes, motions = self._sizes_over(shutter, self._sizes)
        if not all(sizes) or self._asks_to_be_a_point(shutter.middle):
            return None
        rows, rows_motion = rows_over(self.prim, shutter, self._transforms, self._animation, self._warnings)
        opened, there, closed = ((sizes + part * motions, rows + part * rows_motion) for part in (-0.5, 0.0, 0.5))
        if self._shape is UsdLux.SphereLight:
            before, radius, after = (
                float(size[0]) * float(abs(np.linalg.det(at))) ** (1.0 / 3.0) for size, at in (opened, there, closed)
            )
            return Extent(ExtentShape.ROUND, radius, radius_motion=after - before)
        if self._shape is UsdLux.CylinderLight:
            if not rows[0].any():
                return None
            before, radius, after = (
                float(size[0]) * math.sqrt(np.linalg.norm(np.cross(*at[1:]))) for size, at in (opened, there, closed)
            )
            first, middle, last = (
                np.array([0.5 * size[1] * at[0], np.zeros(3)]) for size, at in (opened, there, closed)
            )
            return Extent(ExtentShape.CYLINDER, radius, middle, last - first, after - before)
        if not np.cross(*rows[:2]).any():
            return None
        is_disc = self._shape is UsdLux.DiskLight
        part = 1.0 if is_disc else 0.5
        first, middle, last = (part * size[:, None] * at[:2] for size, at in (opened, there, closed))
        return Extent(ExtentShape.DISK if is_disc else ExtentShape.RECT, 0.0, middle, last - first)

    def _asks_to_be_a_point(self, frame: float) -> bool:
        sphere = UsdLux.SphereLight(self.prim) if self._shape is UsdLux.SphereLight else None
        return sphere is not None and bool(number_or_fallback(sphere.GetTreatAsPointAttr(), frame, self._warnings))

    def _sizes(self, frame: float) -> list[float]:
        """The sizes in its own space of a light that has an area there."""
        names, _ = AREAS[self._shape]
        return [self._size(self._input(name), frame) for name in names]

    def _shaping(self, frame: float) -> Shaping | None:
        """Cone and focus where they are authored, and narrow the light."""
        given = {}
        for name, attribute, neutral in (
            ("angle", self._input("shaping:cone:angle"), 180.0),
            ("softness", self._input("shaping:cone:softness"), 0.0),
            ("focus", self._input("shaping:focus"), 0.0),
        ):
            authored = attribute and attribute.HasAuthoredValue()
            given[name] = self._size(attribute, frame) if authored else neutral
        profile = self._profile(frame)
        if given["angle"] >= 180.0 and given["focus"] == 0.0 and profile is None:
            return None
        # A rim of 180° is no rim, however soft.
        softness = min(given["softness"], 1.0) if given["angle"] < 180.0 else 0.0
        factors = () if profile is None else profile[1]
        return Shaping(_cone(given["angle"]), softness, given["focus"], factors, self._widest_cone)

    @cached_property
    def _widest_cone(self) -> float:
        """The largest opening that its cone ever has [rad], as it stands in :class:`Shaping`."""
        attribute = self._input("shaping:cone:angle")
        if not attribute or not attribute.ValueMightBeTimeVarying():
            return 0.0
        return max((_cone(self._size(attribute, time)) for time in sample_times(attribute)), default=0.0)

    def _profile(self, frame: float) -> tuple[float, tuple[float, ...]] | None:
        """The largest intensity of the light's IES profile, and the profile by that; None where it has none."""
        attribute = self._input("shaping:ies:file")
        path = file_at(attribute, frame) if self._shape in PROFILED else ""
        if not path:
            return None
        scale, normalize = (
            number_or_fallback(found, frame, self._warnings) if (found := self._input(f"shaping:ies:{name}")) else 0.0
            for name in ("angleScale", "normalize")
        )
        asked = path, scale, bool(normalize)
        if asked not in self._profiles:
            self._profiles[asked] = self._read_profile(*asked)
        return self._profiles[asked]

    def _read_profile(self, path: str, scale: float, normalize: bool) -> tuple[float, tuple[float, ...]] | None:
        found = read_profile(path)
        name = f"{self.path}.inputs:shaping:ies:file"
        if found is None:
            self._warnings(name, "cannot be read: the light shines without it (name a file of photometric type C)")
            return None
        if not found.is_round:
            self._warnings(name, "differs around the light's axis: its mean around it is rendered")
        theta = np.linspace(0.0, math.pi, PROFILE_COUNT)
        if scale > 0:
            theta = theta / scale
        elif scale < 0:
            theta = (theta - math.pi) / -scale + math.pi
        values = found.at(theta)
        largest = float(values.max())
        if not largest > 0:
            return 0.0, (0.0,) * PROFILE_COUNT
        factors = tuple(map(float, values / largest))
        return largest / (found.mean() if normalize else 1.0), factors

    def _mean_power(self, shutter: Shutter) -> tuple[float, float, float]:
        """The mean of :meth:`power` over ``shutter``, with nothing where the light is invisible."""
        if not (self.power_varies or self.varies or self._visibilities) or shutter.exposure <= 0:
            return self.power(shutter.middle) if self.visible(shutter.middle) else (0.0, 0.0, 0.0)
        total = sum((weight * np.array(self.power(time)) for time, weight in self._nodes(shutter)), np.zeros(3))
        return tuple(map(float, total / shutter.exposure))

    def _ends_and_samples(self, shutter: Shutter) -> list[float]:
        """When a shutter opens and closes, and the times of samples of what varies in between, in order."""
        varying = [attribute for attribute in self._inputs if attribute.ValueMightBeTimeVarying()]
        times = {time for attribute in (*varying, *self._visibilities) for time in sample_times(attribute)}
        return [shutter.open, *sorted(t for t in times if shutter.open < t < shutter.close), shutter.close]

    def _nodes(self, shutter: Shutter) -> list[tuple[float, float]]:
        """Times at which it is visible while a shutter is open, and the time [frames] that each of them stands for."""
        nodes = []
        # Between samples everything is smooth or held, so that these nodes see what there is.
        for first, last in itertools.pairwise(self._ends_and_samples(shutter)):
            for node, weight in zip(GAUSS_NODES, GAUSS_WEIGHTS, strict=True):
                nodes.append((0.5 * (first + last) + 0.5 * node * (last - first), 0.5 * weight * (last - first)))
        return [(time, weight) for time, weight in nodes if self.visible(time)]

    def _sizes_over(self, shutter: Shutter, sizes_at: Callable[[float], list[float]]) -> tuple[np.ndarray, np.ndarray]:
        """Sizes at mid shutter and their change over it, shape [n] each: lines by least squares over its light.

        A light that is small shines little. What its shadows and caustics are blurred by goes with the square of its
        size; so the mean square that lines leave out is added to that at mid shutter.
        """
        now = np.array(sizes_at(shutter.middle), np.float64)
        if shutter.exposure <= 0 or not self.power_varies:
            return now, np.zeros_like(now)
        nodes = [(time, weight * max(self.power(time)), sizes_at(time)) for time, weight in self._nodes(shutter)]
        weights = np.array([part for _, part, _ in nodes])
        sizes = np.array([values for _, _, values in nodes]).reshape(-1, len(now))
        if not weights.sum() > 0.0 or np.all(sizes == now):
            return now, np.zeros_like(now)
        weights /= weights.sum()
        times = np.array([(time - shutter.middle) / shutter.exposure for time, _, _ in nodes])
        middle, mean = weights @ times, weights @ sizes
        spread = weights @ (times - middle) ** 2
        slopes = weights * (times - middle) @ (sizes - mean) / spread if spread > 0.0 else np.zeros_like(now)
        at_middle = mean - middle * slopes
        rest = weights @ (sizes - at_middle - times[:, None] * slopes) ** 2
        at_middle = np.sqrt(np.maximum(at_middle, 0.0) ** 2 + rest)
        return at_middle, np.clip(slopes, -2.0 * at_middle, 2.0 * at_middle)

    def power(self, frame: float) -> tuple[float, float, float]:
        """Irradiance at normal incidence [W/m²] (distant) or radiant intensity [W/sr] (point) at a time code.

        Inputs that mean nothing have their defaults, which is said; a light beyond all measure, or nowhere, has none.
        """
        try:
            return self._power(frame)
        except InputError as error:
            self._leave_out(error)
            return 0.0, 0.0, 0.0

    def _power(self, frame: float) -> tuple[float, float, float]:
        intensity = self._from_0(self._input("intensity"), frame)
        diffuse = self._from_0(self._input("diffuse"), frame)
        exposure = usable_number(self._input("exposure"), frame, self._warnings)
        color = self._color(frame)
        asks = number_or_fallback(self._input("enableColorTemperature"), frame, self._warnings)
        kelvin = self._size(self._input("colorTemperature"), frame) if asks else None
        white = self._of_blender and kelvin == BLENDER_WHITE
        if kelvin is not None and not white:
            color = color * np.array(UsdLux.BlackbodyTemperatureAsRgb(kelvin), dtype=np.float64)
        if intensity == 0 or diffuse == 0:
            return 0.0, 0.0, 0.0
        with np.errstate(over="ignore"):
            scale = intensity * np.exp2(exposure) * diffuse
        profile = self._profile(frame)
        scale *= self._factor(frame) * (1.0 if profile is None else profile[0])
        with np.errstate(over="ignore", invalid="ignore"):
            power = scale * color * self._filters.scale(frame)
        if not power.max() <= LARGEST:
            raise InputError(
                f"its intensity, exposure and colour come to {power.max():g} together (author less than {LARGEST:g})",
                self._warnings.file,
                self.path,
            )
        return tuple(map(float, power))

    def _color(self, frame: float) -> np.ndarray:
        """Its colour [3]; channels below 0, which colours outside a gamut have, count as 0."""
        attribute = self._input("color")
        color = value_or_fallback(attribute, frame, self._warnings, (3,))
        if color is None:
            return np.ones(3)
        holds = f"holds {tuple(map(float, color))}"
        if not np.isfinite(color).all():
            self._warnings(str(attribute.GetPath()), f"{holds}; {ITS_DEFAULT} (author {FROM_0})", "colour is unusable")
            return np.ones(3)
        if color.min() < 0:
            self._warnings(str(attribute.GetPath()), f"{holds}: what is below 0 counts as 0", "colour below 0")
        return np.maximum(color, 0.0)

    def _factor(self, frame: float) -> float:
        """By what the radiance is to be multiplied for :meth:`power`."""
        return self._distant_factor(frame) if self.kind == LightKind.DISTANT else self._area_factor(frame)

    def _angle(self, frame: float) -> float:
        """Angle of a distant light's disc [degrees]."""
        angle = self._size(self._input("angle"), frame)
        return angle * BLENDER_ANGLE if self._of_blender else angle

    def _distant_factor(self, frame: float) -> float:
        angle = self._angle(frame)
        host = BLENDER_SUN if self._of_blender else 1.0
        if angle == 0 or self._of_blender:
            return host
        if number_or_fallback(self._input("normalize"), frame, self._warnings):
            return 1.0
        return math.pi * math.sin(math.radians(0.5 * min(angle, 180.0))) ** 2

    def _area_factor(self, frame: float) -> float:
        sizes, (_, area_of) = self._sizes(frame), AREAS[self._shape]
        if self._shape is UsdLux.SphereLight and sizes == [0.0]:
            return 1.0
        _, by_area = PROFILES[self._shape]
        if number_or_fallback(self._input("normalize"), frame, self._warnings):
            return by_area
        return by_area * area_of(*sizes) * self._area_scale(frame)

    def _area_scale(self, frame: float) -> float:
        """By how much the light's transform enlarges its area."""
        rows = self._transforms.world(self.prim, frame)[:3, :3]
        if self._shape is UsdLux.SphereLight:
            return area_stretched(*SPHERE_NORMALS, rows)
        if self._shape is UsdLux.CylinderLight:
            return area_stretched(*TUBE_NORMALS, rows)
        return float(np.linalg.norm(np.cross(rows[0], rows[1])))

    def _input(self, name: str) -> Usd.Attribute:
        return light_input(self.prim, name)

    def _size(self, attribute: Usd.Attribute, frame: float) -> float:
        return usable_number(attribute, frame, self._warnings, FROM_0, not_negative)

    def _from_0(self, attribute: Usd.Attribute, frame: float) -> float:
        """A factor of its power, which is 0 where it is below."""
        value = usable_number(attribute, frame, self._warnings, FROM_0)
        if value < 0:
            kind = f"{attribute.GetName()} below 0"
            self._warnings(str(attribute.GetPath()), f"holds {value:g}, which counts as 0 (author {FROM_0})", kind)
        return max(value, 0.0)

    def _leave_out(self, error: InputError) -> None:
        # It is asked for at many times, which its transform's message names.
        self._warnings(error.prim or self.path, f"{error.message}; until then the light is left out", "light left out")

    def _warn_unsupported(self) -> None:
        tint = self._input("shaping:focusTint")
        if tint and tint.HasAuthoredValue() and np.any(value_or_fallback(tint, EARLIEST, self._warnings, (3,))):
            self._warnings(self.path, "the light's focusTint is not rendered")
        angle, focus = self._input("shaping:cone:angle"), self._input("shaping:focus")
        asks_for_cone = _authored(angle, 180.0, self._warnings, below=True) or _authored(focus, 0.0, self._warnings)
        if self._of_blender and self.kind == LightKind.DISTANT:
            self._warnings(
                self.path, "is as bright and wide as in Blender, which wrote it: four times and twice what USD says"
            )
        if asks_for_cone and self.kind == LightKind.DISTANT:
            self._warnings(self.path, "parallel light has no cone: its shaping is not rendered")
        ies = self._input("shaping:ies:file")
        if ies and ies.HasAuthoredValue() and self._shape not in PROFILED:
            self._warnings(self.path, "the light's IES profile is not rendered")
        if _authored(self._input("specular"), 1.0, self._warnings):
            self._warnings(f"{self.path}.inputs:specular", "is not taken into account")
        distance = self._input("shadow:distance")
        if distance and distance.HasAuthoredValue() and number_or_fallback(distance, EARLIEST, self._warnings) >= 0:
            self._warnings(self.path, "shadow:distance is not taken into account")
        color = self._input("shadow:color")
        if color and color.HasAuthoredValue() and np.any(value_or_fallback(color, EARLIEST, self._warnings, (3,))):
            self._warnings(self.path, "the light's shadows are black, whatever their colour")


def is_light(prim: Usd.Prim) -> bool:
    """Whether a prim is a light that is rendered."""
    return prim.IsA(UsdLux.DistantLight) or any(prim.IsA(kind) for kind in AREAS)


def _cone(angle: float) -> float:
    """Half the opening [rad] of a cone that is authored as ``angle`` [degrees]: from 180° on it has no rim."""
    return math.radians(angle) if angle < 180.0 else 2.0 * math.pi


def changing_visibilities(prim: Usd.Prim) -> list[Usd.Attribute]:
    """The visibility attributes of a prim and of what it lies below that change with time."""
    found = []
    while prim and not prim.IsPseudoRoot():
        attribute = UsdGeom.Imageable(prim).GetVisibilityAttr() if prim.IsA(UsdGeom.Imageable) else None
        if attribute and attribute.ValueMightBeTimeVarying():
            found.append(attribute)
        prim = prim.GetParent()
    return found


def _authored(attribute: Usd.Attribute, neutral: float, warnings: WarnOnce, below: bool = False) -> bool:
    """Whether an attribute is authored with something else than its neutral value (or, ``below``, less than that)."""
    if not attribute or not attribute.HasAuthoredValue():
        return False
    value = number_or_fallback(attribute, EARLIEST, warnings)
    return value < neutral if below else value != neutral
