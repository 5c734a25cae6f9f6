"""A mesh where it stands, or where many copies of it do: its shape over a shutter, carried into the world."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from pxr import Usd, UsdGeom

from tpdwarp.errors import InputError, WarnOnce
from tpdwarp.scene.description import MeshAtShutter, Shutter
from tpdwarp.usd.read.appearances import Appearance, Appearances
from tpdwarp.usd.read.blobs import Blobs
from tpdwarp.usd.read.jumps import Jump, settled
from tpdwarp.usd.read.motion import blur_scale, blur_scaled, over_shutter
from tpdwarp.usd.read.normals import transform_normals, unit
from tpdwarp.usd.read.primitives import Primitive
from tpdwarp.usd.read.shapes import Shape
from tpdwarp.usd.read.topology import Topology
from tpdwarp.usd.read.transforms import Transforms, transform_points, union, usable
from tpdwarp.usd.read.uv import CornerCoordinates, authored_points, corner_coordinates, planar_coordinates


class Placement(Protocol):
    """Where a prim, or each of its copies, stands in the world."""

    span: tuple[float, float] | None

    def worlds(self, time: float, frame: float) -> np.ndarray:
        """Local-to-world matrices at ``time`` for a shutter around ``frame``, one a copy, shape [n, 4, 4]."""
        ...

    def jumps(self) -> tuple[Jump, ...]:
        """Pairs of times between which it jumps."""
        ...

    def visible(self, frame: float) -> bool:
        """Whether the prim is visible there at a time code."""
        ...

    def colors(self, frame: float) -> np.ndarray | None:
        """The colours [n, 3] that an instancer gives it at a time code; None where it gives none."""
        ...


class OnStage:
    """The placement of a prim that is on the stage itself (native instances included)."""

    def __init__(self, prim: Usd.Prim, transforms: Transforms) -> None:
        self._prim, self._transforms = prim, transforms
        self.span = transforms.span(prim)
        self._visible: tuple[float, bool] | None = None

    def worlds(self, time: float, frame: float) -> np.ndarray:
        return self._transforms.world(self._prim, time)[None]

    def jumps(self) -> tuple[Jump, ...]:
        return self._transforms.jumps(self._prim)

    def visible(self, frame: float) -> bool:
        # An instancer is asked once for each of its instances.
        if self._visible is None or self._visible[0] != frame:
            shown = UsdGeom.Imageable(self._prim).ComputeVisibility(frame) != UsdGeom.Tokens.invisible
            self._visible = frame, shown
        return self._visible[1]

    def colors(self, frame: float) -> np.ndarray | None:
        return None


class PlacedMesh:
    """One mesh, one instance of it, or many of them together.

    Args:
        label: Path it is known by.
        prim: The mesh prim as placed (its visibility, materials and inherited primvars count).
        shape: Its shape, shared between instances.
        placement: Where it stands.
        animation: First and last time code of the stage.
        cubic: Whether motion is cubic.
        appearances: Reads what it looks like.
        warnings: Takes what is not supported, and names the file in errors.
        copies: Paths of the instances that it stands for, in the order of their matrices; empty for one mesh.
    """

    def __init__(
        self,
        label: str,
        prim: Usd.Prim,
        shape: Shape | Primitive | Blobs,
        placement: Placement,
        animation: tuple[float, float],
        cubic: bool,
        appearances: Appearances,
        warnings: WarnOnce,
        copies: tuple[str, ...] = (),
    ) -> None:
        self.label, self.prim, self.shape, self.placement, self.copies = label, prim, shape, placement, copies
        self._cubic, self._appearances, self._warnings = cubic, appearances, warnings
        self._own_span = union(shape.span, placement.span)
        self.span = union(animation, self._own_span)
        self._geometry: _Geometry | None = None
        self._appearance: tuple[Topology, Appearance] | None = None
        self._whole: MeshAtShutter | None = None

    @property
    def varies(self) -> bool:
        """Whether its points or its place may change with time."""
        return self._own_span is not None

    def over(self, shutter: Shutter) -> MeshAtShutter | None:
        """The mesh over ``shutter``; None where it is invisible or has no triangles.

        Raises:
            InputError: Points, faces, transforms or materials that cannot be used.
        """
        if not self.placement.visible(shutter.frame):
            return None
        if self.varies or self._geometry is None:
            self._geometry = self._evaluate(shutter)
            self._whole = None
        geometry = self._geometry
        if geometry is None:
            return None
        known = self._appearance
        if known is None or known[1].varies or known[0] is not geometry.topology:
            given = self.placement.colors(shutter.frame)
            appearance = self._appearances.of(
                self.prim, geometry.topology, geometry.point_count, shutter.frame, None if given is None else given[0]
            )
            if appearance.given_at >= 0:
                others, last = np.split(appearance.colors, [appearance.given_at])
                appearance = replace(appearance, colors=np.concatenate([others, given, last[1:]]))
            self._appearance = geometry.topology, appearance
            self._whole = None
        if self._whole is None:
            self._whole = self._dressed(geometry.mesh, self._appearance[1])
        return self._whole if len(self._whole.triangles) else None

    @property
    def count(self) -> int:
        """How many instances it stands for."""
        return len(self.copies) or 1

    def _dressed(self, mesh: MeshAtShutter, appearance: Appearance) -> MeshAtShutter:
        """The mesh with its materials, without what these cut out."""
        count, kept = self.count, appearance.kept
        return _without_holes(
            replace(
                mesh,
                materials=appearance.materials,
                triangle_materials=_for_copies(appearance.triangle_materials, count),
                colors=appearance.colors,
                color_indices=_with_given(appearance.color_indices, count, appearance.given_at),
                coordinates=appearance.coordinates,
                coordinate_indices=_for_copies(appearance.coordinate_indices, count),
                priority=self._appearances.priority(self.prim),
            ),
            _for_copies(kept, count),
        )

    def coordinates(self, name: str, shutter: Shutter) -> CornerCoordinates | None:
        """Texture coordinates of the triangles of :meth:`over`; None where there are none of these.

        Args:
            name: Primvar; a mesh without it is projected along its thinnest axis, which is said.
            shutter: The shutter.

        Raises:
            InputError: As :meth:`over`; values that are not finite.
        """
        if self.over(shutter) is None:
            return None
        geometry, appearance = self._geometry, self._appearance[1]
        topology, count = geometry.topology, geometry.point_count
        values = corner_coordinates(self.prim, topology, count, name, shutter.frame, self._warnings)
        projected = None
        if values is None:
            self._warnings(self.label, f"has no {name}: projected along its thinnest axis (choose with --uv)")
            points = authored_points(self.prim, count)
            if points is not None:
                projected = planar_coordinates(points)
                spread, indices = topology.spread(projected, str(UsdGeom.Tokens.vertex), count)
                values = spread[indices]
            else:
                projected = np.zeros((0, 2))
                still = Shutter.still(self.span[0])
                values = planar_coordinates(self.shape.at(still, self.span).points(self.span[0]))[topology.triangles]
        return CornerCoordinates(values if appearance.kept is None else values[appearance.kept], projected)

    def _evaluate(self, shutter: Shutter) -> _Geometry | None:
        frame = shutter.frame
        shutter = settled(blur_scaled(shutter, blur_scale(self.prim, frame, self._warnings)), self.placement.jumps())
        shape = self.shape.at(shutter, self.span)
        if shape is None:
            return None

        def state(time: float) -> tuple[np.ndarray, ...]:
            matrices = self._worlds(time, frame)
            points = transform_points(shape.points(time), matrices)
            return (points,) if shape.normals is None else (points, transform_normals(shape.normals(time), matrices))

        with np.errstate(over="ignore", invalid="ignore"):
            middle, motions = over_shutter(state, shutter, self.span, self._cubic)
        if not all(np.isfinite(values).all() for values in (*middle, *(motions or ()))):
            raise InputError(
                f"its points leave the range of numbers within the shutter of frame {frame:g} "
                "(correct its points or its transform)",
                self._warnings.file,
                self.label,
            )
        held = self._worlds(min(max(shutter.middle, self.span[0]), self.span[1]), frame)
        mirrored = np.linalg.det(held[:, :3, :3]) < 0
        if mirrored.any() != mirrored.all():
            raise InputError("some of its copies are mirrored, and others are not", self._warnings.file, self.label)
        topology = shape.topology.mirrored if mirrored[0] else shape.topology
        normals = normal_indices = None
        if shape.normals is not None:
            normals = unit(middle[1])
            elements = np.ascontiguousarray(shape.normal_elements(topology), dtype=np.int32)
            normal_indices = _for_copies(elements, self.count, len(normals) // self.count)
        mesh = MeshAtShutter(
            self.label,
            middle[0],
            _for_copies(topology.triangles, self.count, len(middle[0]) // self.count),
            motions=None if motions is None else motions[0],
            normals=normals,
            normal_motions=motions[1] if normals is not None and motions is not None else None,
            normal_indices=normal_indices,
            copies=self.copies,
        )
        return _Geometry(mesh, topology, shape.point_count)

    def _worlds(self, time: float, frame: float) -> np.ndarray:
        matrices = self.placement.worlds(time, frame)
        # The one with the largest number in it, or one that is none.
        usable(matrices[np.argmax(np.abs(matrices)) // 16], time, self.label, self._warnings.file)
        return matrices


def _for_copies(rows: np.ndarray | None, count: int, step: int = 0) -> np.ndarray | None:
    """Rows [m, ...] of a mesh for ``count`` copies of it, [count m, ...].

    Indices grow by ``step`` from one copy to the next; what is no index, −1, stays.
    """
    if rows is None or count == 1:
        return rows
    if step == 0:
        return np.tile(rows, (count, *[1] * (rows.ndim - 1)))
    steps = (step * np.arange(count)).astype(rows.dtype).reshape(-1, *[1] * rows.ndim)
    copied = rows[None] + steps
    if (none := rows < 0).any():
        copied[:, none] = -1
    return copied.reshape(-1, *rows.shape[1:])


def _with_given(rows: np.ndarray | None, count: int, given_at: int) -> np.ndarray | None:
    """Indices of colours, as :func:`_for_copies`, where each copy has a colour of its own in the place of ``given_at``.

    Those of colours behind it are moved by as many.
    """
    copied = _for_copies(rows, count)
    if rows is None or count == 1 or given_at < 0:
        return copied
    own = np.where(copied == given_at, copied + _copy_of_each(rows, count), copied)
    return np.where(copied > given_at, copied + np.int32(count - 1), own)


def _copy_of_each(rows: np.ndarray, count: int) -> np.ndarray:
    """The number of the copy that each of the rows for ``count`` copies belongs to, with as many axes."""
    return np.repeat(np.arange(count, dtype=np.int32), len(rows)).reshape(-1, *[1] * (rows.ndim - 1))


def _without_holes(mesh: MeshAtShutter, kept: np.ndarray | None) -> MeshAtShutter:
    """The mesh without the triangles that its materials cut out."""
    if kept is None:
        return mesh
    by_triangle = ("triangles", "normal_indices", "triangle_materials", "color_indices", "coordinate_indices")
    parts = {name: None if (part := getattr(mesh, name)) is None else part[kept] for name in by_triangle}
    return replace(mesh, **parts)


@dataclass(frozen=True, eq=False)
class _Geometry:
    """A mesh without its materials, and what they are spread over."""

    mesh: MeshAtShutter
    topology: Topology
    point_count: int
