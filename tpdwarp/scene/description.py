"""What a stage holds over one shutter, as plain arrays in world space.

These dataclasses are all that the rest of the program knows of a stage: readers make them, the renderer consumes
them, tests write them by hand. Lengths are scene units, times are time codes, arrays are float64 (precision is spent
before the scene is recentred). A *motion* is a displacement over the whole shutter, from its opening to its closing.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import cached_property
from typing import Protocol

import numpy as np

from tpdwarp.errors import InputError


@dataclass(frozen=True)
class Shutter:
    """The interval in which the film of one frame is exposed, in time codes (absolute).

    Attributes:
        frame: Time code of the frame.
        open: Time code at which the shutter opens.
        close: Time code at which it closes; equal to ``open`` for a still.
    """

    frame: float
    open: float
    close: float

    @classmethod
    def still(cls, time: float) -> Shutter:
        """A shutter of no duration at ``time``."""
        return cls(time, time, time)

    @property
    def middle(self) -> float:
        return 0.5 * (self.open + self.close)

    @property
    def exposure(self) -> float:
        return self.close - self.open

    def segments(self, count: int) -> list[Shutter]:
        """The shutter cut into ``count`` equal sub-intervals, in order of time."""
        edges = [self.open + self.exposure * k / count for k in range(count + 1)]
        return [Shutter(self.frame, a, b) for a, b in itertools.pairwise(edges)]


class Interaction(IntEnum):
    """What happens to light at a surface."""

    DIFFUSE = 0
    DIELECTRIC = 1
    MIRROR = 2


class Wrap(IntEnum):
    """How a texture goes on beyond its edges."""

    REPEAT = 0
    CLAMP = 1
    MIRROR = 2
    BORDER = 3


@dataclass(frozen=True, eq=False)
class Texture:
    """A colour that differs over a surface, by texture coordinates (s, t).

    Attributes:
        tiles: Linear Rec.709 by unit square of (s, t), rows from t = 1 down, each shape [h, w, 3]; most textures have
            the square (0, 0) alone.
        wrap: How it goes on along s and t; where there are several tiles, there is the border between and around them.
        border: The colour beyond edges that neither repeat nor hold.
    """

    tiles: dict[tuple[int, int], np.ndarray]
    wrap: tuple[Wrap, Wrap] = (Wrap.REPEAT, Wrap.REPEAT)
    border: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Material:
    """A surface's optical behaviour.

    Attributes:
        interaction: Diffuse, smooth dielectric interface or mirror.
        color: Albedo (diffuse) or tint (mirror), linear Rec.709; unused for dielectrics.
        ior: Index of refraction inside, relative to outside (front side is outside).
        path: Prim path of the material, or empty where none is bound.
        texture: What ``color`` is over the surface, in its place where the mesh has texture coordinates; None for the
            same everywhere.
        presence: Share of the surface that is there; light passes straight through the rest.
        cutout: Presence over the surface, which multiplies ``presence`` where the mesh has texture coordinates; None
            for the same everywhere.
        threshold: Where ``cutout`` is at least this, above 0, all of the surface is there, and elsewhere nothing.
        diffuse_share: Share of a dielectric or mirror that is diffuse, of albedo ``color``.
        diffuse_map: That share over the surface, in its place where the mesh has texture coordinates; None for the same
            everywhere. So have ``transmittance_map``, ``roughness_map`` and ``emission_map`` the place of what they are
            named after.
        transmittance: What a dielectric lets through of what it refracts, each time.
        normal_map: Normals over a diffuse surface in the frame of its texture coordinates (along s, along t, out of the
            surface), where the mesh has these; None for those of the mesh.
        emission: Radiance that a diffuse surface gives off, to both sides; it is seen, and lights nothing.
        absorption: Of light inside a dielectric, exp(−absorption · distance) is left (Beer's law) [1/scene unit].
        thin_walled: Whether a dielectric is a sheet with the same medium on both of its sides: it reflects, and what
            it does not reflect goes straight on.
        roughness: Width α of the microfacet distribution (GGX) of a dielectric or mirror, 0 for smooth, and of what is
            ``metal`` of a diffuse surface.
        abbe: Abbe number (n_d − 1)/(n_F − n_C) of a dielectric that disperses, whose ``ior`` is n_d; 0 for none.
        metal: Share of what is diffuse that is metal instead, too rough for a mirror: to the camera it reflects in a
            lobe of GGX, ``color`` at normal incidence. Photons find it diffuse.
        metal_map: That share over the surface, as ``diffuse_map`` is.
        lamp: Whether its emission is that of lights of their own, which stand for it: rough metal finds them.
    """

    interaction: Interaction = Interaction.DIFFUSE
    color: tuple[float, float, float] = (0.18, 0.18, 0.18)
    ior: float = 1.5
    path: str = ""
    texture: Texture | None = None
    presence: float = 1.0
    cutout: Texture | None = None
    threshold: float = 0.0
    diffuse_share: float = 0.0
    diffuse_map: Texture | None = None
    transmittance: tuple[float, float, float] = (1.0, 1.0, 1.0)
    absorption: tuple[float, float, float] = (0.0, 0.0, 0.0)
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)
    thin_walled: bool = False
    roughness: float = 0.0
    abbe: float = 0.0
    normal_map: Texture | None = None
    transmittance_map: Texture | None = None
    roughness_map: Texture | None = None
    emission_map: Texture | None = None
    metal: float = 0.0
    metal_map: Texture | None = None
    lamp: bool = False

    @property
    def partial(self) -> bool:
        """Whether only a part of it is there, or does what its interaction says."""
        if self.presence < 1.0 or self.cutout is not None:
            return True
        return self.diffuse_share > 0.0 or self.diffuse_map is not None

    @property
    def tinted(self) -> bool:
        """Whether a dielectric takes from the light that it refracts."""
        if any(self.absorption) or self.transmittance_map is not None:
            return True
        return any(channel != 1.0 for channel in self.transmittance)

    @property
    def rough(self) -> bool:
        """Whether what is specular is rough anywhere."""
        if self.interaction == Interaction.DIFFUSE:
            return False
        return self.roughness > 0.0 or self.roughness_map is not None

    @property
    def metallic(self) -> bool:
        """Whether there is rough metal anywhere."""
        return self.metal > 0.0 or self.metal_map is not None

    @property
    def shines(self) -> bool:
        """Whether it gives off light anywhere."""
        return any(self.emission) or self.emission_map is not None

    @property
    def has_maps(self) -> bool:
        """Whether anything but its colour, its normal and its presence differs over the surface."""
        if self.metal_map is not None or self.roughness_map is not None or self.emission_map is not None:
            return True
        return self.specular_maps

    @property
    def specular_maps(self) -> bool:
        """Whether what it reflects or refracts differs over the surface."""
        if self.interaction == Interaction.MIRROR and self.texture is not None:
            return True
        if self.diffuse_map is not None or self.transmittance_map is not None:
            return True
        return self.interaction != Interaction.DIFFUSE and self.roughness_map is not None


@dataclass(frozen=True, eq=False)
class MeshAtShutter:
    """One triangulated mesh (or one instance of it) over a shutter.

    Attributes:
        path: Prim path; instances carry their proxy path, point instances ``/Instancer[3]/Mesh``.
        points: Positions at mid shutter, shape [v, 3].
        triangles: Vertex indices, counter-clockwise seen from the front, shape [m, 3] int32.
        motions: Displacement of each point over the shutter, shape [v, 3]; None where nothing moves.
        normals: Shading normals at mid shutter (unit length), shape [k, 3]; None for flat shading.
        normal_motions: Change of each normal over the shutter, shape [k, 3]; None where nothing moves.
        normal_indices: Normal of each triangle corner, shape [m, 3] int32; None for flat shading.
        materials: The materials used.
        triangle_materials: Index into ``materials`` for each triangle, shape [m] int32.
        colors: Display colours that override the diffuse albedo, shape [c, 3]; None where there are none.
        color_indices: Colour of each triangle corner, shape [m, 3] int32; −1 keeps the material's own colour.
        coordinates: Texture coordinates, shape [s, 2]; None where there are none.
        coordinate_indices: Those of each triangle corner, shape [m, 3] int32; −1 for a triangle without.
        priority: Where dielectric solids overlap, those of higher priority hold; see :mod:`tpdwarp.scene.nesting`.
        copies: Paths of the instances that it is made of, one after the other, each of as many points and triangles as
            the others; empty where it is one mesh. None of them is specular.
    """

    path: str
    points: np.ndarray
    triangles: np.ndarray
    motions: np.ndarray | None = None
    normals: np.ndarray | None = None
    normal_motions: np.ndarray | None = None
    normal_indices: np.ndarray | None = None
    materials: tuple[Material, ...] = (Material(),)
    triangle_materials: np.ndarray | None = None
    colors: np.ndarray | None = None
    color_indices: np.ndarray | None = None
    coordinates: np.ndarray | None = None
    coordinate_indices: np.ndarray | None = None
    priority: int = 0
    copies: tuple[str, ...] = ()

    @property
    def moves(self) -> bool:
        return self.motions is not None

    @property
    def objects(self) -> tuple[str, ...]:
        """Paths of what counts as objects of their own: its copies, or itself."""
        return self.copies or (self.path,)

    def apart(self) -> Iterator[MeshAtShutter]:
        """Each of its copies on its own, or itself; arrays are parts of its own."""
        if not self.copies:
            yield self
            return
        vertices, faces = len(self.points) // len(self.copies), len(self.triangles) // len(self.copies)
        by_triangle = ("normal_indices", "triangle_materials", "color_indices", "coordinate_indices")
        for number, path in enumerate(self.copies):
            own, rows = (slice(number * count, (number + 1) * count) for count in (vertices, faces))
            yield replace(
                self,
                path=path,
                points=self.points[own],
                motions=None if self.motions is None else self.motions[own],
                triangles=self.triangles[rows] - number * vertices,
                copies=(),
                **{name: None if (part := getattr(self, name)) is None else part[rows] for name in by_triangle},
            )

    @cached_property
    def boxes(self) -> np.ndarray:
        """Least and greatest corner of each of :attr:`objects` at mid shutter, shape [o, 2, 3]."""
        # Coordinate by coordinate, which is ten times as fast.
        by_object = self.points.reshape(len(self.objects), -1, 3).transpose(2, 0, 1)
        by_coordinate = np.ascontiguousarray(by_object)
        return np.stack([by_coordinate.min(axis=2), by_coordinate.max(axis=2)]).transpose(2, 0, 1)

    @property
    def specular(self) -> bool:
        return any(material.interaction != Interaction.DIFFUSE for material in self.materials)


class LightKind(IntEnum):
    DISTANT = 0
    POINT = 1


class EmissionProfile(IntEnum):
    """How the radiant intensity of a light differs by direction, apart from its shaping.

    A surface of one radiance looks smaller from aside: flat ones shine by the cosine of the angle to −z of their frame,
    and to one side only; the side of a cylinder by the sine of the angle to its axis, x of its frame; ellipsoids by the
    area that they show (``LightAtShutter.shown``).
    """

    UNIFORM = 0
    COSINE = 1
    SINE = 2
    SHOWN = 3


class ExtentShape(IntEnum):
    """What a light with extent is, as seen from a point.

    ``ROUND`` is a disc from everywhere: a sphere, or the disc of directions that parallel light comes from.
    """

    ROUND = 0
    DISK = 1
    RECT = 2
    CYLINDER = 3
    ELLIPSOID = 4


@dataclass(frozen=True, eq=False)
class Extent:
    """The extent of a light about its position or direction; its radiance is the same all over.

    Attributes:
        shape: What it is.
        radius: Of what is round, and of a cylinder: scene units; of an ellipsoid: that of the sphere of its area; of
            parallel light: half the angle of its disc [rad]; at mid shutter.
        spans: Half of a disk or rectangle along its x and y axes, half of a cylinder along its axis (and zero), in the
            world at mid shutter, shape [2, 3]; of a part of the sun's disc, sines; of an ellipsoid, what a sphere's
            radii along x, y and z are, shape [3, 3].
        spans_motion: Change of ``spans`` over the shutter, of its shape.
        radius_motion: Change of ``radius`` over the shutter.
    """

    shape: ExtentShape
    radius: float = 0.0
    spans: np.ndarray = field(default_factory=lambda: np.zeros((2, 3)))
    spans_motion: np.ndarray = field(default_factory=lambda: np.zeros((2, 3)))
    radius_motion: float = 0.0

    def radius_at(self, part: float) -> float:
        """``radius`` at the part −½ … ½ of the shutter."""
        return self.radius + part * self.radius_motion

    @property
    def over_the_shutter(self) -> tuple[float, np.ndarray]:
        """Radius and spans whose squares are the means of theirs: what it blurs by goes with these."""
        squares = (self.spans**2).sum(axis=1, keepdims=True)
        growth = (self.spans * self.spans_motion).sum(axis=1, keepdims=True)
        growth = np.divide(growth, squares, out=np.zeros_like(growth), where=squares > 0.0)
        if not (self.radius_motion or growth.any()):
            return self.radius, self.spans
        radius = math.sqrt(self.radius**2 + self.radius_motion**2 / 12.0)
        return radius, np.sqrt(1.0 + growth**2 / 12.0) * self.spans

    @property
    def sizes(self) -> np.ndarray:
        """How large it is along a and b, up to factors that stay the same, shape [2]; of an ellipsoid as a whole."""
        radius, spans = self.over_the_shutter
        along = np.linalg.norm(spans, axis=1)
        if self.shape in (ExtentShape.DISK, ExtentShape.RECT):
            return along
        return np.array([along[0] if self.shape == ExtentShape.CYLINDER else radius, radius])

    @property
    def reach(self) -> float:
        """No place on it is farther from its middle than this, scene units."""
        along = float(np.linalg.norm(self.spans))
        return along if self.shape == ExtentShape.ELLIPSOID else self.radius + along


@dataclass(frozen=True, eq=False)
class Ball:
    """The sphere or ellipsoid that a light is a place in, or a part of: its light begins where it leaves that.

    Attributes:
        place: From the middle of the sphere to the light's position, world units, shape [3].
        radius: Of the sphere, scene units; 0 of an ellipsoid.
        spans: Of an ellipsoid, as in :class:`Extent`, shape [3, 3]; None of a sphere.
    """

    place: np.ndarray
    radius: float
    spans: np.ndarray | None = None


# Two degrees apart. Chosen, not derived: profiles of luminaires are given every 2.5 or 5 degrees.
PROFILE_COUNT = 91


@dataclass(frozen=True)
class Shaping:
    """How a point light shines around its axis, −z of its frame.

    At an angle θ from the axis its intensity is that on the axis times cosᶠθ (f the focus; nothing behind, where f is
    above 0) times 1 − smoothstep(angle · (1 − softness), angle, θ), times its profile at θ.

    Attributes:
        angle: Half the opening of its cone [rad]; nothing shines outside.
        softness: Share of the cone, from its rim inwards, over which light fades.
        focus: Exponent of the cosine.
        profile: Factors at :data:`PROFILE_COUNT` angles θ spread evenly over 0 … π, between which it is linear; empty
            for a factor of 1 everywhere.
        widest: The largest ``angle`` that it has in the animation, if that is larger: emission lattices are laid out
            for it, of which a narrower cone takes a part.
    """

    angle: float
    softness: float = 0.0
    focus: float = 0.0
    profile: tuple[float, ...] = ()
    widest: float = 0.0


@dataclass(frozen=True, eq=False)
class LightAtShutter:
    """A light over a shutter.

    Attributes:
        path: Prim path.
        kind: Distant (along −z of its frame) or at a point.
        power: Distant: irradiance at normal incidence [W/m²]. Point: radiant intensity [W/sr], of a light whose profile
            is not uniform the largest, or the mean over all directions where it goes by the area shown. Linear Rec.709.
        position: Position (of its middle) at mid shutter, shape [3] (unused for distant lights).
        axes: Rows are the light's unit x, y, z axes in the world at mid shutter, shape [3, 3].
        position_motion: Displacement over the shutter, shape [3].
        axes_motion: Change of the axes over the shutter, shape [3, 3].
        shaping: How a point light differs by direction beside its profile; None where it does not.
        profile: How the intensity of a point light differs by direction because of its shape.
        extent: Its extent; None for parallel rays, or a point.
        ball: The sphere that it is a part or a place of; None of a whole light.
        unlit: Paths of meshes that it does not shine on; they hide it all the same.
        passed: Paths of meshes that its light goes through as if they were not there.
        shaped_about: The axis of its shaping and the change of that over the shutter, shape [2, 3], where it is not −z
            of the frame.
        meshed: Whether a mesh that shines stands in its place for who looks at it in a mirror.
        shown: Of a light that shines by the area it shows: along a unit ω, by the length of shown · ω, shape [3, 3].
        reshaped: Whether its shaping, which is that of mid shutter, changes over the shutter.
    """

    path: str
    kind: LightKind
    power: tuple[float, float, float]
    position: np.ndarray = field(default_factory=lambda: np.zeros(3))
    axes: np.ndarray = field(default_factory=lambda: np.eye(3))
    position_motion: np.ndarray = field(default_factory=lambda: np.zeros(3))
    axes_motion: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    shaping: Shaping | None = None
    profile: EmissionProfile = EmissionProfile.UNIFORM
    extent: Extent | None = None
    ball: Ball | None = None
    unlit: frozenset[str] = frozenset()
    passed: frozenset[str] = frozenset()
    shaped_about: np.ndarray | None = None
    meshed: bool = False
    shown: np.ndarray | None = None
    reshaped: bool = False

    @property
    def cone_axis(self) -> np.ndarray:
        """The unit axis of its shaping at mid shutter, and the change of that over the shutter, shape [2, 3]."""
        if self.shaped_about is not None:
            return self.shaped_about
        return -np.stack([self.axes[2], self.axes_motion[2]])

    @property
    def linked(self) -> bool:
        """Whether not all meshes are the same to it."""
        return bool(self.unlit or self.passed)

    @property
    def moves(self) -> bool:
        """Whether its light moves, or goes elsewhere; what shines alike in all directions may turn in its place."""
        turns = np.any(self.axes_motion) and (
            self.kind == LightKind.DISTANT or self.shaping is not None or self.profile != EmissionProfile.UNIFORM
        )
        grows = self.extent is not None and (self.extent.radius_motion or np.any(self.extent.spans_motion))
        return bool(np.any(self.position_motion) or turns or grows or self.reshaped)


@dataclass(frozen=True, eq=False)
class DomeAtShutter:
    """Light from all around, at an infinite distance, as it stands at mid shutter.

    It is seen where nothing else is, and lights diffuse surfaces directly; it sends no photons.

    Attributes:
        path: Prim path.
        radiance: By latitude (rows, from +y down) and longitude (columns, from +180° down, where +z is at 0° and +x at
            90°), shape [h, w, 3], linear Rec.709.
        axes: Rows are the dome's unit x, y, z axes in the world, shape [3, 3].
    """

    path: str
    radiance: np.ndarray
    axes: np.ndarray = field(default_factory=lambda: np.eye(3))


@dataclass(frozen=True, eq=False)
class CameraAtShutter:
    """A perspective (pinhole or thin lens) or orthographic camera over a shutter; looks along −z of its frame, y up.

    Attributes:
        path: Prim path.
        orthographic: Whether rays are parallel.
        position: Eye at mid shutter, shape [3].
        axes: Rows are the unit x (right), y (up), z (backward) axes in the world at mid shutter, shape [3, 3].
        window: Left, right, bottom, top of the image in the plane at distance 1 (perspective) or in scene units.
        near, far: Clipping distances along the view axis, scene units.
        position_motion, axes_motion: Change over the shutter, shapes [3] and [3, 3].
        exposure_scale: Factor on radiance from the camera's exposure attributes.
        world_to_camera: Row-vector matrix at mid shutter, shape [4, 4] (as USD stores it).
        world_to_ndc: Row-vector matrix at mid shutter, shape [4, 4].
        lens_radius: Radius of a perspective camera's lens, scene units; 0 for a pinhole.
        focus_distance: Distance along the view axis of what is sharp, scene units.
        clipping_planes: Rows (a, b, c, d) cut off what has a x + b y + c z + d < 0 in the camera's frame, shape [k, 4].
    """

    path: str
    orthographic: bool
    position: np.ndarray
    axes: np.ndarray
    window: tuple[float, float, float, float]
    near: float = 0.0
    far: float = 1e30
    position_motion: np.ndarray = field(default_factory=lambda: np.zeros(3))
    axes_motion: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    exposure_scale: float = 1.0
    world_to_camera: np.ndarray | None = None
    world_to_ndc: np.ndarray | None = None
    lens_radius: float = 0.0
    focus_distance: float = 1.0
    clipping_planes: np.ndarray = field(default_factory=lambda: np.zeros((0, 4)))

    @property
    def moves(self) -> bool:
        return bool(np.any(self.position_motion) or np.any(self.axes_motion))


@dataclass(frozen=True, eq=False)
class SceneAtShutter:
    """Everything that is lit, lights or looks, over one shutter. ``camera`` is None where only photons are traced."""

    shutter: Shutter
    meshes: tuple[MeshAtShutter, ...]
    lights: tuple[LightAtShutter, ...]
    camera: CameraAtShutter | None = None
    domes: tuple[DomeAtShutter, ...] = ()

    def objects(self) -> Iterator[MeshAtShutter]:
        """The meshes, copies each on their own."""
        return itertools.chain.from_iterable(mesh.apart() for mesh in self.meshes)


class SceneSource(Protocol):
    """What can be asked for its scene over any shutter: a USD stage, or a scene written down in code."""

    file: str

    def at(self, shutter: Shutter) -> SceneAtShutter:
        """The scene over ``shutter``. Meshes that do not move between two calls may be the same objects."""
        ...

    def reference_shutters(self) -> Sequence[Shutter]:
        """A few stills spread over the whole animation (one where nothing moves), the first at its start.

        Emission lattices are laid out over these, so that photons keep their identity from frame to frame.
        """
        ...

    def motion_breaks(self, shutter: Shutter) -> Sequence[float]:
        """Times within ``shutter`` at which motion may change abruptly."""
        ...

    def light_groups(self) -> Mapping[str, str]:
        """The group that each light which may send photons names itself, by its path; empty where it names none."""
        ...


def reference_scenes(
    source: SceneSource,
    check: Callable[[SceneAtShutter], None] = lambda scene: None,
    known: Sequence[SceneAtShutter] | None = None,
) -> list[SceneAtShutter]:
    """The scenes over the reference shutters of ``source``, but for those that cannot be used.

    Args:
        source: Where they come from.
        check: Called with each; raises where it cannot be used.
        known: These scenes, where they have been read before.

    Raises:
        InputError: None of them can be.
    """
    scenes: list[SceneAtShutter] = []
    refused: InputError | None = None
    for still in source.reference_shutters() if known is None else known:
        try:
            scene = source.at(still) if isinstance(still, Shutter) else still
            check(scene)
            scenes.append(scene)
        except InputError as error:
            refused = refused or error
    if refused and not scenes:
        raise refused
    return scenes
