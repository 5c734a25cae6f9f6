"""Spheres, cubes, cylinders, cones, capsules and planes as fine meshes with the exact normals of their surfaces.

Round shapes are surfaces of revolution: each *strip* of their profile is a smooth piece, and strips meet in edges.
Points lie on the surface, so that a circle of n segments misses the share 2π²/(3n²) of its area (.0002 of 192).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pxr import Usd, UsdGeom

from tpdwarp.errors import InputError, WarnOnce
from tpdwarp.scene.description import Shutter
from tpdwarp.usd.read.samples import SampledArray, of_attribute, sample_times
from tpdwarp.usd.read.shapes import ShapeAtShutter
from tpdwarp.usd.read.topology import Topology, triangulate
from tpdwarp.usd.read.transforms import union
from tpdwarp.usd.read.values import NUMBER, number_or_fallback, text_at

# Segments of a circle: the chord of 64 leaves it by .0012 of its radius, half a pixel where it fills the image; light
# that 192 refract errs by the square of the segment's angle.
SEGMENTS, SPECULAR_SEGMENTS, FEWEST_SEGMENTS = 64, 192, 16
# All primitives of a stage together stay about below this number of triangles, that is 2 GB while they are rendered.
MOST_TRIANGLES = 2_000_000

Sizes = dict[str, float]


@dataclass(frozen=True, eq=False)
class Strip:
    """A smooth piece of a profile, from low to high seen from outside; all arrays have shape [k].

    Attributes:
        radii, heights: Its points.
        radial, axial: Its unit normals.
        begins, ends: Whether it begins or ends in a point on the axis.
    """

    radii: np.ndarray
    heights: np.ndarray
    radial: np.ndarray
    axial: np.ndarray
    begins: bool = False
    ends: bool = False


def is_primitive(prim: Usd.Prim) -> bool:
    """Whether a prim is one of the shapes read here."""
    return any(prim.IsA(kind) for kind in KINDS)


def segments_for(specular: bool, count: int) -> int:
    """Segments of a circle where a stage has ``count`` primitives in all, instances counted each."""
    wanted = SPECULAR_SEGMENTS if specular else SEGMENTS
    affordable = int(math.sqrt(MOST_TRIANGLES / max(count, 1)))
    return max(min(wanted, affordable), FEWEST_SEGMENTS)


class Primitive:
    """A shape of UsdGeom over time, as :class:`tpdwarp.usd.read.shapes.Shape`.

    Args:
        prim: The prim.
        segments: Gives the segments of a circle; asked when the shape is first evaluated.
        cubic: Whether its sizes are interpolated by the cubic Hermite through their samples.
        warnings: Takes what is left out, and names the file in errors.
    """

    def __init__(self, prim: Usd.Prim, segments: Callable[[], int], cubic: bool, warnings: WarnOnce) -> None:
        self.path, self._warnings, self._segments = str(prim.GetPath()), warnings, segments
        self._kind = next(kind for kind in KINDS if prim.IsA(kind))
        self._axis = text_at(prim.GetAttribute("axis")) if prim.HasAttribute("axis") else "Z"
        self._sizes: dict[str, tuple[Usd.Attribute, SampledArray | None]] = {}
        self.span: tuple[float, float] | None = None
        for name in KINDS[self._kind]:
            attribute = prim.GetAttribute(name)
            of_samples = not attribute.HasSpline() and attribute.GetNumTimeSamples() > 1
            smooth = of_attribute(attribute, cubic, shape=NUMBER) if of_samples else None
            self._sizes[name] = attribute, smooth
            times = sample_times(attribute)
            if len(times) > 1:
                self.span = union(self.span, (times[0], times[-1]))
        self._still: ShapeAtShutter | None = None
        self._topology: Topology | None = None

    @property
    def varies(self) -> bool:
        return self.span is not None

    def at(self, shutter: Shutter, span: tuple[float, float]) -> ShapeAtShutter | None:
        """The shape over ``shutter``; None (and a warning) where it has no size.

        Raises:
            InputError: A size that is not finite.
        """
        if self._still is not None:
            return self._still
        sizes = self._at(min(max(shutter.middle, span[0]), span[1]))
        if not all(size > 0 for name, size in sizes.items() if name not in MAY_BE_ZERO):
            self._warnings(self.path, "has a size of 0 or less and is left out")
            return None
        shape = self._flat(sizes) if self._kind in FLAT else self._round(sizes)
        if not self.varies:
            self._still = shape
        return shape

    def _at(self, time: float) -> Sizes:
        sizes: Sizes = {}
        for name, (attribute, smooth) in self._sizes.items():
            value = number_or_fallback(attribute, time, self._warnings) if smooth is None else float(smooth.at(time))
            if not math.isfinite(value):
                raise InputError(
                    f"holds {value:g} (author a finite value)", self._warnings.file, str(attribute.GetPath())
                )
            sizes[name] = value
        return sizes

    def _flat(self, sizes: Sizes) -> ShapeAtShutter:
        """A cube or a plane."""
        corners, counts, indices = FLAT[self._kind](self._axis)
        topology = triangulate(counts, indices, np.zeros(0), False)

        def points(time: float) -> np.ndarray:
            now = self._at(time)
            extent = [now["size"]] * 3 if "size" in now else _plane_extent(now, self._axis)
            return 0.5 * corners * extent

        return ShapeAtShutter(topology, len(corners), self._kept(points, sizes), None, None)

    def _round(self, sizes: Sizes) -> ShapeAtShutter:
        segments = self._segments()
        profile = PROFILES[self._kind]
        strips = profile(sizes, segments)
        if self._topology is None:
            self._topology = _revolved_topology(strips, segments)
        topology = self._topology

        def points(time: float) -> np.ndarray:
            return _around([(s.radii, s.heights, False, False) for s in profile(self._at(time), segments)], segments)

        def normals(time: float) -> np.ndarray:
            now = profile(self._at(time), segments)
            return _around([(s.radial, s.axial, s.begins, s.ends) for s in now], segments)

        count = segments * sum(len(strip.radii) for strip in strips)
        order = AXES.index(self._axis) if self._axis in AXES else 0
        turn = [np.roll([0, 1, 2], order)]
        return ShapeAtShutter(
            topology,
            count,
            self._kept(lambda time: points(time)[:, turn[0]], sizes),
            self._kept(lambda time: normals(time)[:, turn[0]], sizes),
            lambda faces: faces.triangles,
        )

    def _kept(self, evaluate: Callable[[float], np.ndarray], sizes: Sizes) -> Callable[[float], np.ndarray]:
        """``evaluate`` as it is, or its only value where nothing varies."""
        if self.varies:
            return evaluate
        value = evaluate(0.0)
        return lambda time: value


def _around(profiles: list[tuple[np.ndarray, np.ndarray, bool, bool]], segments: int) -> np.ndarray:
    """Vectors [k n, 3] of profiles turned about z: radial and axial parts [k], and whether their ends turn half on.

    A point on the axis belongs to a triangle of each segment, and has the normal of that segment's middle.
    """
    angles = 2.0 * math.pi * np.arange(segments) / segments
    parts = []
    for radial, axial, begins, ends in profiles:
        turned = np.tile(angles, (len(radial), 1))
        turned[0] += begins * math.pi / segments
        turned[-1] += ends * math.pi / segments
        part = np.stack(
            [radial[:, None] * np.cos(turned), radial[:, None] * np.sin(turned), np.tile(axial[:, None], segments)],
            axis=-1,
        )
        parts.append(part.reshape(-1, 3))
    return np.concatenate(parts)


def _revolved_topology(strips: list[Strip], segments: int) -> Topology:
    """Triangles between the rings of each strip; one face each, since nothing is authored by face."""
    triangles, offset = [], 0
    here = np.arange(segments)
    after = (here + 1) % segments
    for strip in strips:
        rings = len(strip.radii)
        for ring in range(rings - 1):
            low, high = offset + ring * segments, offset + (ring + 1) * segments
            if not (strip.begins and ring == 0):
                triangles.append(
                    np.stack(
                        [low + here, low + after, high + (here if strip.ends and ring == rings - 2 else after)], axis=1
                    )
                )
            if not (strip.ends and ring == rings - 2):
                triangles.append(np.stack([low + here, high + after, high + here], axis=1))
        offset += rings * segments
    indices = np.concatenate(triangles).ravel()
    return triangulate(np.full(len(indices) // 3, 3), indices, np.zeros(0), False)


def _arc(radius: float, height: float, first: float, last: float, count: int, **ends: bool) -> Strip:
    angles = np.linspace(first, last, count + 1)
    cosines = np.where(np.isclose(abs(angles), 0.5 * math.pi), 0.0, np.cos(angles))
    sines = np.sin(angles)
    return Strip(radius * cosines, height + radius * sines, cosines, sines, **ends)


def _line(first: tuple[float, float], last: tuple[float, float], **ends: bool) -> Strip:
    """A straight piece between two (radius, height); its normal lies to the right of its direction."""
    (r0, z0), (r1, z1) = first, last
    length = math.hypot(r1 - r0, z1 - z0)
    radial, axial = ((z1 - z0) / length, (r0 - r1) / length) if length > 0 else (1.0, 0.0)
    return Strip(np.array([r0, r1]), np.array([z0, z1]), np.full(2, radial), np.full(2, axial), **ends)


def _sphere(sizes: Sizes, segments: int) -> list[Strip]:
    quarter = 0.5 * math.pi
    return [_arc(sizes["radius"], 0.0, -quarter, quarter, segments // 2, begins=True, ends=True)]


def _cylinder(sizes: Sizes, segments: int) -> list[Strip]:
    low, high, half = _radius(sizes, "Bottom"), _radius(sizes, "Top"), 0.5 * sizes["height"]
    return [
        _line((0.0, -half), (low, -half), begins=True),
        _line((low, -half), (high, half)),
        _line((high, half), (0.0, half), ends=True),
    ]


def _cone(sizes: Sizes, segments: int) -> list[Strip]:
    radius, half = sizes["radius"], 0.5 * sizes["height"]
    return [_line((0.0, -half), (radius, -half), begins=True), _line((radius, -half), (0.0, half), ends=True)]


def _capsule(sizes: Sizes, segments: int) -> list[Strip]:
    low, high, half, quarter = _radius(sizes, "Bottom"), _radius(sizes, "Top"), 0.5 * sizes["height"], 0.5 * math.pi
    return [
        _arc(low, -half, -quarter, 0.0, segments // 4, begins=True),
        _line((low, -half), (high, half)),
        _arc(high, half, 0.0, quarter, segments // 4, ends=True),
    ]


def _radius(sizes: Sizes, end: str) -> float:
    return sizes.get("radius", sizes.get(f"radius{end}", 0.0))


def _cube(axis: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    corners = np.array([[x, y, z] for z in (-1.0, 1.0) for y in (-1.0, 1.0) for x in (-1.0, 1.0)])
    faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    return corners, np.full(6, 4), np.ravel(faces)


def _plane(axis: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    square = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    turned = square[:, np.roll([0, 1, 2], AXES.index(axis) if axis in AXES else 0)]
    return turned, np.array([4]), np.arange(4)


def _plane_extent(sizes: Sizes, axis: str) -> list[float]:
    """Size along x, y and z: the width is that along x, or along z where x is the axis."""
    width, length = sizes["width"], sizes["length"]
    return {"X": [0.0, length, width], "Y": [width, 0.0, length]}.get(axis, [width, length, 0.0])


# A rotation of the axes by so many places takes z to each of these.
AXES = ("Z", "X", "Y")
KINDS: dict[type, tuple[str, ...]] = {
    UsdGeom.Sphere: ("radius",),
    UsdGeom.Cube: ("size",),
    UsdGeom.Cylinder: ("radius", "height"),
    UsdGeom.Cylinder_1: ("radiusBottom", "radiusTop", "height"),
    UsdGeom.Cone: ("radius", "height"),
    UsdGeom.Capsule: ("radius", "height"),
    UsdGeom.Capsule_1: ("radiusBottom", "radiusTop", "height"),
    UsdGeom.Plane: ("width", "length"),
}
MAY_BE_ZERO = frozenset({"radiusBottom", "radiusTop"})
FLAT = {UsdGeom.Cube: _cube, UsdGeom.Plane: _plane}
PROFILES = {
    UsdGeom.Sphere: _sphere,
    UsdGeom.Cylinder: _cylinder,
    UsdGeom.Cylinder_1: _cylinder,
    UsdGeom.Cone: _cone,
    UsdGeom.Capsule: _capsule,
    UsdGeom.Capsule_1: _capsule,
}
