"""Points as spheres and curves as tubes: meshes made anew for each frame, with normals of the round things they are."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from pxr import Usd, UsdGeom

from tpdwarp.errors import InputError, WarnOnce
from tpdwarp.scene.description import Shutter
from tpdwarp.usd.read.normals import unit
from tpdwarp.usd.read.nurbs import fitting_knots, rational, spans
from tpdwarp.usd.read.primvars import require_finite
from tpdwarp.usd.read.samples import SampledArray, sample_times
from tpdwarp.usd.read.shapes import ShapeAtShutter
from tpdwarp.usd.read.skinning import Deformation
from tpdwarp.usd.read.topology import Topology
from tpdwarp.usd.read.transforms import union
from tpdwarp.usd.read.values import LIST, ROWS, indices_at, raw_at, text_at, value_at

# Triangles that all points, or all curves, of one prim come to at most.
MOST_TRIANGLES = 1_000_000
# An icosahedron split twice leaves its sphere by .02 of the radius; things that are small need no more.
FINEST_SPLIT = 2
# Sides of a tube, and pieces of a cubic segment, where there are few.
SIDES, PIECES = 12, 8

BASES = {
    "bezier": (np.array([[-1, 3, -3, 1], [3, -6, 3, 0], [-3, 3, 0, 0], [1, 0, 0, 0]], dtype=float), 3),
    "bspline": (np.array([[-1, 3, -3, 1], [3, -6, 3, 0], [-3, 0, 3, 0], [1, 4, 1, 0]], dtype=float) / 6.0, 1),
    "catmullRom": (np.array([[-1, 3, -3, 1], [2, -5, 4, -1], [-1, 0, 1, 0], [0, 2, 0, 0]], dtype=float) / 2.0, 1),
}
# Those that pinned curves reach their ends in by phantom points.
PINNED = ("bspline", "catmullRom")
KINDS = (
    UsdGeom.Points,
    UsdGeom.BasisCurves,
    UsdGeom.HermiteCurves,
    UsdGeom.NurbsCurves,
    UsdGeom.NurbsPatch,
    UsdGeom.TetMesh,
)
# What of them changes with time, beside transforms.
VARYING = (
    "points",
    "widths",
    "curveVertexCounts",
    "velocities",
    "tangents",
    "pointWeights",
    "tetVertexIndices",
    "surfaceFaceVertexIndices",
)
# The order of NURBS curves that do not say theirs.
CUBIC = 4
KNOTS = "does not fit the control vertices: evenly spread knots take its place"


def is_blob(prim: Usd.Prim) -> bool:
    """Whether a prim is rendered by a mesh that is made anew for each frame: spheres, tubes, a patch, a solid."""
    return any(prim.IsA(kind) for kind in KINDS)


@dataclass(frozen=True, eq=False)
class BlobTopology(Topology):
    """Triangles of spheres, tubes and patches; primvars are those of what they stand for.

    Attributes:
        owners: Size of a primvar, and its element at each triangle corner [m, 3], by interpolation.
    """

    owners: dict[str, tuple[int, np.ndarray]] = field(default_factory=dict)

    def elements(self, interpolation: str, size: int, point_count: int) -> np.ndarray | None:
        """As :meth:`Topology.elements`."""
        if interpolation == "constant" and size == 1:
            return np.zeros_like(self.triangles)
        count, owners = self.owners.get(interpolation, (-1, self.triangles))
        return owners if count == size else None

    @cached_property
    def mirrored(self) -> BlobTopology:
        """The same triangles wound the other way round."""
        order = [0, 2, 1]
        return replace(
            self,
            triangles=np.ascontiguousarray(self.triangles[:, order]),
            corners=np.ascontiguousarray(self.corners[:, order]),
            owners={name: (count, of[:, order]) for name, (count, of) in self.owners.items()},
        )


class Blobs:
    """Points or curves over time, as :class:`tpdwarp.usd.read.shapes.Shape`; they move as USD says points do.

    Args:
        prim: A Points, BasisCurves, HermiteCurves or NurbsCurves prim.
        warnings: Takes what is left out, and names the file in errors.
        deformation: The skeleton and blend shapes that deform it; its velocities are not read then.
    """

    def __init__(self, prim: Usd.Prim, warnings: WarnOnce, deformation: Deformation | None = None) -> None:
        self.path, self._prim, self._warnings = str(prim.GetPath()), prim, warnings
        self._deformation = deformation
        self._deformed = None if deformation is None else SampledArray(deformation.times, self._deformed_at)
        self._base = UsdGeom.PointBased(prim)
        self.span: tuple[float, float] | None = None
        moving = self._base.GetVelocitiesAttr().HasAuthoredValue()
        if self.deformed_at:
            self.span = self.deformed_at[0], self.deformed_at[-1]
        for name in VARYING:
            attribute = prim.GetAttribute(name)
            times = sample_times(attribute) if attribute else []
            if len(times) > 1 or (times and moving):
                self.span = union(self.span, (times[0], times[-1]))

    @property
    def varies(self) -> bool:
        return self.span is not None

    @property
    def deformed_at(self) -> list[float]:
        """Sample times of the skeleton and blend shapes that deform it."""
        return [] if self._deformation is None else self._deformation.times

    def at(self, shutter: Shutter, span: tuple[float, float]) -> ShapeAtShutter | None:
        """The spheres or tubes over ``shutter``; None (and a warning) where there are none.

        Raises:
            InputError: Points or widths that are not finite, or counts that do not fit the points.
        """
        frame = min(max(shutter.frame, span[0]), span[1])
        first = self._points(frame, frame)
        if not len(first):
            self._warnings(self.path, "has no points and is left out")
            return None

        def points(time: float) -> np.ndarray:
            found = self._points(time, frame)
            return found if len(found) == len(first) else first

        return self._made(points, first, frame)

    def _made(self, points: Callable[[float], np.ndarray], first: np.ndarray, frame: float) -> ShapeAtShutter | None:
        """The shape for points at a time code, those of the frame ``first``; None where there is none."""
        if self._prim.IsA(UsdGeom.Points):
            return _spheres(points, self._widths(frame, len(first), {"vertex": None, "varying": None}), len(first))
        return self._tubes(points, first, frame)

    def _points(self, time: float, frame: float) -> np.ndarray:
        if self._deformed is not None:
            deformed = self._deformed.at(time)
            found = np.zeros((0, 3)) if deformed is None else deformed
        else:
            # USD complains of points without positions.
            there = raw_at(self._base.GetPointsAttr(), frame) is not None
            computed = self._base.ComputePointsAtTimes([time], frame) if there else ()
            found = np.array(computed[0] if len(computed) else [], dtype=np.float64).reshape(-1, 3)
        require_finite(found, self._warnings.file, f"{self.path}.points", time)
        return found

    def _deformed_at(self, time: float | None) -> np.ndarray | None:
        """The points as skeleton and blend shapes leave them at one of their sample times."""
        # What has one sample or none is the same at any time.
        time = time or 0.0
        stored = value_at(self._base.GetPointsAttr(), time, ROWS)
        return None if stored is None else self._deformation.points(stored, time)

    def _widths(self, frame: float, count: int, spread: dict[str, np.ndarray | None]) -> np.ndarray:
        """Width of each element; ``spread`` has those of a primvar's interpolations, None for one each."""
        primvar = UsdGeom.PrimvarsAPI(self._prim).GetPrimvar("widths")
        attribute = primvar.GetAttr() if primvar and primvar.HasValue() else self._prim.GetAttribute("widths")
        interpolation = str(primvar.GetInterpolation()) if primvar and primvar.HasValue() else ""
        interpolation = interpolation or str(attribute.GetMetadata("interpolation") or "vertex")
        widths = value_at(attribute, frame, LIST)
        if widths is None or not len(widths):
            self._warnings(self.path, "has no widths: it is rendered one scene unit wide")
            return np.ones(count)
        require_finite(widths, self._warnings.file, str(attribute.GetPath()), frame)
        widths = abs(widths)
        if len(widths) == 1:
            return np.repeat(widths, count)
        elements = spread.get(interpolation)
        if elements is not None and elements.max(initial=-1) < len(widths):
            return widths[elements]
        if len(widths) == count:
            return widths
        self._warnings(str(attribute.GetPath()), "does not fit its interpolation: its first width is used")
        return np.repeat(widths[:1], count)

    def _tangents(self, frame: float, count: int) -> np.ndarray:
        """Tangents of a Hermite curve's points, shape [n, 3]; without, it goes straight."""
        tangents = value_at(self._prim.GetAttribute("tangents"), frame, ROWS)
        if tangents is not None and len(tangents) == count and np.isfinite(tangents).all():
            return tangents
        self._warnings(f"{self.path}.tangents", "does not fit the points: the curve is rendered as straight pieces")
        return np.zeros((count, 3))

    def _tubes(self, points: Callable[[float], np.ndarray], first: np.ndarray, frame: float) -> ShapeAtShutter | None:
        counts = indices_at(UsdGeom.Curves(self._prim).GetCurveVertexCountsAttr(), frame)
        if (len(counts) and counts.min() < 0) or counts.sum() != len(first):
            raise InputError(
                f"counts {counts.sum()} vertices where there are {len(first)} points (correct the counts)",
                self._warnings.file,
                f"{self.path}.curveVertexCounts",
            )
        nurbs = self._prim.IsA(UsdGeom.NurbsCurves)
        found = (self._nurbs_centres if nurbs else self._centres)(points, counts, frame)
        if found is None:
            self._warnings(self.path, "has no curve of enough vertices and is left out")
            return None
        rings = np.arange(found.nearest.size).reshape(found.nearest.shape)
        pieces, sides = rings.shape[1] - 1, found.sides
        nearest, of_curve = found.nearest.ravel(), np.repeat(found.of_curve, pieces + 1)
        widths = self._widths(frame, rings.size, {"vertex": nearest, "varying": nearest, "uniform": of_curve})

        def frames(time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            vertices = found.vertices(time)
            centres = (found.weights @ vertices).reshape(-1, 3)
            tangents = unit((found.slopes @ vertices).reshape(-1, 3))
            # Any direction across will do that changes little along a segment: that of the axis most across its chord.
            chords = unit(vertices[:, -1] - vertices[:, 0])
            axes = np.repeat(np.eye(3)[np.argmin(abs(chords), axis=1)], pieces + 1, axis=0)
            u = unit(np.cross(tangents, axes))
            return centres, u, np.cross(tangents, u)

        angles = 2.0 * math.pi * np.arange(sides) / sides
        waves = np.cos(angles)[:, None], np.sin(angles)[:, None]

        def normals(time: float) -> np.ndarray:
            _, u, v = frames(time)
            return (waves[0] * u[:, None] + waves[1] * v[:, None]).reshape(-1, 3)

        def surface(time: float) -> np.ndarray:
            centres, u, v = frames(time)
            round_it = waves[0] * u[:, None] + waves[1] * v[:, None]
            return (centres[:, None] + 0.5 * widths[:, None, None] * round_it).reshape(-1, 3)

        triangles, ring_of = _tube_triangles(rings, sides)
        vertex_of = nearest[ring_of]
        owners = {
            "vertex": (len(first), vertex_of),
            "varying": (len(first), vertex_of),
            "uniform": (len(counts), of_curve[ring_of]),
        }
        topology = blob_topology(triangles, owners)
        return ShapeAtShutter(topology, len(first), surface, normals, lambda faces: faces.triangles)

    def _centres(self, points: Callable[[float], np.ndarray], counts: np.ndarray, frame: float) -> _Centres | None:
        """The middle lines of basis and Hermite curves."""
        curves, hermite = UsdGeom.BasisCurves(self._prim), self._prim.IsA(UsdGeom.HermiteCurves)
        cubic = hermite or text_at(curves.GetTypeAttr()) != UsdGeom.Tokens.linear
        basis, wrap = text_at(curves.GetBasisAttr()), text_at(curves.GetWrapAttr())
        if hermite:
            # By points and tangents; their Bezier control vertices follow from these.
            basis, wrap = "bezier", UsdGeom.Tokens.nonperiodic
            leaving = self._tangents(frame, int(counts.sum()))
        if cubic and basis not in BASES:
            self._warnings(self.path, f"curves of basis {basis} are rendered as straight pieces")
            cubic = False
        segments, of_curve = _segments(counts, "" if hermite or not cubic else basis, wrap)
        if not len(segments):
            return None
        is_pinned = cubic and wrap == UsdGeom.Tokens.pinned and basis in PINNED
        begins, ends = (is_pinned & (segments[:, a] == segments[:, a + 1]) for a in (0, segments.shape[1] - 2))
        fewest = MOST_TRIANGLES / len(segments)
        sides = int(np.clip(fewest / (4 if cubic else 2), 3, SIDES))
        pieces = int(np.clip(fewest / (2 * sides), 1, PIECES)) if cubic else 1
        weights, slopes = _weights(basis if cubic else "", pieces)
        strongest = np.argmax(weights, axis=1)

        def vertices(time: float) -> np.ndarray:
            placed = points(time)[segments]
            # Phantom points (UsdGeomBasisCurves): the curve goes from its first point to its last.
            if is_pinned:
                placed[begins, 0] = 2.0 * placed[begins, 1] - placed[begins, 2]
                placed[ends, 3] = 2.0 * placed[ends, 2] - placed[ends, 1]
            if not hermite:
                return placed
            third = leaving[segments] / 3.0
            (start, end), (leaves, arrives) = placed.swapaxes(0, 1), third.swapaxes(0, 1)
            return np.stack([start, start + leaves, end - arrives, end], axis=1)

        nearest = segments[:, strongest // 2 if hermite else strongest]
        return _Centres(vertices, weights[None], slopes[None], nearest, of_curve, sides)

    def _nurbs_centres(
        self, points: Callable[[float], np.ndarray], counts: np.ndarray, frame: float
    ) -> _Centres | None:
        """The middle lines of NURBS curves."""
        curves = UsdGeom.NurbsCurves(self._prim)
        knots, given = self.numbers(curves.GetKnotsAttr(), frame), indices_at(curves.GetOrderAttr(), frame)
        orders = np.full(len(counts), CUBIC)
        orders[: len(given)] = given[: len(counts)]
        ranges = self.numbers(curves.GetRangesAttr(), frame).reshape(-1)
        own = self.own_weights(frame, int(counts.sum()))
        pieces = int(np.clip(MOST_TRIANGLES / (6 * max(int(counts.sum()), 1)), 1, PIECES))
        segments, weights, slopes, of_curve = [], [], [], []
        start = at = 0
        most = max(int(orders.max(initial=2)), 2)
        for curve, (count, order) in enumerate(zip(counts.tolist(), orders.tolist(), strict=True)):
            own_knots = knots[at : at + count + order]
            start, at = start + count, at + count + order
            if not 2 <= order <= count:
                continue
            along, limits, fits = fitting_knots(order, count, own_knots, ranges[2 * curve : 2 * curve + 2])
            if not fits:
                self._warnings(f"{self.path}.knots", KNOTS)
            for span in spans(order, along, limits, pieces):
                held = np.minimum(np.arange(most), order - 1) + (start - count + span.first)
                values, near, changes = (
                    np.pad(rows, ((0, 0), (0, most - order))) for rows in (span.values, span.near, span.slopes)
                )
                segments.append(held)
                weights.append(rational(values, changes, own[held])[0])
                slopes.append(rational(near, changes, own[held])[1])
                of_curve.append(curve)
        if not segments:
            return None
        held, values = np.array(segments), np.array(weights)
        nearest = np.take_along_axis(held, np.argmax(values, axis=2), axis=1)
        sides = int(np.clip(MOST_TRIANGLES / (2 * pieces * len(held)), 3, SIDES))
        of_each = np.array(of_curve)
        return _Centres(lambda time: points(time)[held], values, np.array(slopes), nearest, of_each, sides)

    def own_weights(self, frame: float, count: int) -> np.ndarray:
        """Weights of the control vertices of NURBS, shape [n]; 1 where there are none that fit."""
        attribute = self._prim.GetAttribute("pointWeights")
        weights = self.numbers(attribute, frame)
        if len(weights) == count and np.isfinite(weights).all():
            return weights
        if len(weights):
            self._warnings(str(attribute.GetPath()), "does not fit the points and is ignored")
        return np.ones(count)

    def numbers(self, attribute: Usd.Attribute, frame: float) -> np.ndarray:
        """The numbers that an attribute holds; none where it holds nothing."""
        value = raw_at(attribute, frame) if attribute else None
        return np.zeros(0) if value is None else np.array(value, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class _Centres:
    """Middle lines of tubes, in segments [s] with places [p] of which each depends on some vertices [k].

    Attributes:
        vertices: Their vertices at a time code, shape [s, k, 3].
        weights: What each vertex weighs at each place, shape [s or 1, p, k].
        slopes: Change of these along the segment, likewise.
        nearest: The point that weighs most at each place, shape [s, p].
        of_curve: The curve of each segment, shape [s].
        sides: Sides of a tube.
    """

    vertices: Callable[[float], np.ndarray]
    weights: np.ndarray
    slopes: np.ndarray
    nearest: np.ndarray
    of_curve: np.ndarray
    sides: int


def _spheres(points: Callable[[float], np.ndarray], widths: np.ndarray, count: int) -> ShapeAtShutter:
    splits = int(np.clip(math.log(max(MOST_TRIANGLES / (20 * count), 1.0), 4), 0, FINEST_SPLIT))
    directions, faces = _icosphere(splits)
    triangles = (faces + len(directions) * np.arange(count)[:, None, None]).reshape(-1, 3)
    owners = np.repeat(np.arange(count), len(faces))[:, None].repeat(3, axis=1)
    topology = blob_topology(triangles, {name: (count, owners) for name in ("vertex", "varying", "uniform")})
    offsets = 0.5 * widths[:, None, None] * directions
    normals = np.tile(directions, (count, 1))
    return ShapeAtShutter(
        topology,
        count,
        lambda time: (points(time)[:, None] + offsets).reshape(-1, 3),
        lambda time: normals,
        lambda faces: faces.triangles,
    )


def blob_topology(triangles: np.ndarray, owners: dict[str, tuple[int, np.ndarray]]) -> BlobTopology:
    corners = np.arange(triangles.size, dtype=np.int32).reshape(-1, 3)
    faces = np.arange(len(triangles), dtype=np.int32)
    return BlobTopology(triangles.astype(np.int32), corners, faces, len(triangles), triangles.size, owners)


def _icosphere(splits: int) -> tuple[np.ndarray, np.ndarray]:
    """Directions [v, 3] and triangles of an icosahedron, each split in four so many times."""
    golden = 0.5 * (1.0 + math.sqrt(5.0))
    corners = [(s, t * golden, 0.0) for s in (-1.0, 1.0) for t in (-1.0, 1.0)]
    points = unit(np.array([np.roll(corner, k) for k in range(3) for corner in corners]))
    near = np.linalg.norm(points[:, None] - points[None], axis=2)
    edge = near[near > 1e-9].min() * 1.001
    faces = np.array(
        [
            (a, b, c)
            for a in range(12)
            for b in range(a + 1, 12)
            for c in range(b + 1, 12)
            if max(near[a, b], near[b, c], near[c, a]) < edge
        ]
    )
    outward = np.linalg.det(points[faces]) > 0
    faces[~outward] = faces[~outward][:, [0, 2, 1]]
    for _ in range(splits):
        sides = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
        edges, of = np.unique(sides, axis=0, return_inverse=True)
        a, b, c = (len(points) + of.reshape(-1, 3)).T
        points = np.concatenate([points, unit(points[edges].sum(axis=1))])
        x, y, z = faces.T
        faces = np.concatenate([np.stack(part, axis=1) for part in ((x, a, c), (y, b, a), (z, c, b), (a, b, c))])
    return points, faces


def _segments(counts: np.ndarray, basis: str, wrap: str) -> tuple[np.ndarray, np.ndarray]:
    """Control vertices of each segment [s, 2] (straight) or [s, 4] (cubic), and its curve [s]."""
    order, step = (4, BASES[basis][1]) if basis else (2, 1)
    periodic, pinned = (
        wrap == UsdGeom.Tokens.periodic,
        wrap == UsdGeom.Tokens.pinned and basis in PINNED,
    )
    starts = np.cumsum(counts) - counts
    parts, of_curve = [], []
    # Curves of one length are laid out together.
    for count in np.unique(counts):
        chosen = np.flatnonzero(counts == count)
        first = np.arange(0, count if periodic else count - order + 1, step)
        local = first[:, None] + np.arange(order)
        if pinned and count >= 2:
            local = np.arange(-1, count - 2)[:, None] + np.arange(4)
        if not len(local) or count < 2:
            continue
        local = local % count if periodic else np.clip(local, 0, count - 1)
        parts.append((starts[chosen][:, None, None] + local).reshape(-1, order))
        of_curve.append(np.repeat(chosen, len(local)))
    if not parts:
        return np.zeros((0, order), dtype=int), np.zeros(0, dtype=int)
    return np.concatenate(parts), np.concatenate(of_curve)


def _weights(basis: str, pieces: int) -> tuple[np.ndarray, np.ndarray]:
    """Weights of a segment's control vertices at its places, and those of the slope there, shapes [pieces + 1, k]."""
    t = np.linspace(0.0, 1.0, pieces + 1)[:, None]
    if not basis:
        return np.concatenate([1 - t, t], axis=1), np.tile([[-1.0, 1.0]], (pieces + 1, 1))
    matrix = BASES[basis][0]
    # Where control vertices fall together the slope at an end may vanish: it is taken a little further in.
    inner = np.clip(t, 1e-3, 1 - 1e-3)
    powers = np.concatenate([t**3, t**2, t, np.ones_like(t)], axis=1)
    slopes = np.concatenate([3 * inner**2, 2 * inner, np.ones_like(t), np.zeros_like(t)], axis=1)
    return powers @ matrix, slopes @ matrix


def _tube_triangles(rings: np.ndarray, sides: int) -> tuple[np.ndarray, np.ndarray]:
    """Triangles between the neighbouring rings of each row, and the ring of each of their corners, shapes [m, 3]."""
    low, high = rings[:, :-1].reshape(-1, 1), rings[:, 1:].reshape(-1, 1)
    here = np.arange(sides)
    after = (here + 1) % sides
    a, b = low * sides + here, low * sides + after
    c, d = high * sides + after, high * sides + here
    triangles = np.concatenate([np.stack([a, b, c], axis=2).reshape(-1, 3), np.stack([a, c, d], axis=2).reshape(-1, 3)])
    return triangles, triangles // sides
