"""A mesh where it stands: its shape over a shutter, carried into the world, with its materials."""

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
from tpdwarp.usd.read.transforms import Transforms, union, usable
from tpdwarp.usd.read.uv import CornerCoordinates, authored_points, corner_coordinates, planar_coordinates


class Placement(Protocol):
    """Where a prim stands in the world."""

    span: tuple[float, float] | None

    def world(self, time: float, frame: float) -> np.ndarray:
        """Local-to-world matrix at ``time`` for a shutter around ``frame``, shape [4, 4]."""
        ...

    def jumps(self) -> tuple[Jump, ...]:
        """Pairs of times between which it jumps."""
        ...

    def visible(self, frame: float) -> bool:
        """Whether the prim is visible there at a time code."""
        ...

    def color(self, frame: float) -> np.ndarray | None:
        """The colour [3] that an instancer gives it at a time code; None where it gives none."""
        ...


class OnStage:
    """The placement of a prim that is on the stage itself (native instances included)."""

    def __init__(self, prim: Usd.Prim, transforms: Transforms) -> None:
        self._prim, self._transforms = prim, transforms
        self.span = transforms.span(prim)
        self._visible: tuple[float, bool] | None = None

    def world(self, time: float, frame: float) -> np.ndarray:
        return self._transforms.world(self._prim, time)

    def jumps(self) -> tuple[Jump, ...]:
        return self._transforms.jumps(self._prim)

    def visible(self, frame: float) -> bool:
        # An instancer is asked once for each of its instances.
        if self._visible is None or self._visible[0] != frame:
            shown = UsdGeom.Imageable(self._prim).ComputeVisibility(frame) != UsdGeom.Tokens.invisible
            self._visible = frame, shown
        return self._visible[1]

    def color(self, frame: float) -> np.ndarray | None:
        return None


class PlacedMesh:
    """One mesh, or one instance of it.

    Args:
        label: Path it is known by.
        prim: The mesh prim as placed (its visibility, materials and inherited primvars count).
        shape: Its shape, shared between instances.
        placement: Where it stands.
        animation: First and last time code of the stage.
        cubic: Whether motion is cubic.
        appearances: Reads what it looks like.
        warnings: Takes what is not supported, and names the file in errors.
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
    ) -> None:
        self.label, self.prim, self.shape, self.placement = label, prim, shape, placement
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
            appearance = self._appearances.of(
                self.prim, geometry.topology, geometry.point_count, shutter.frame, self.placement.color
            )
            self._appearance = geometry.topology, appearance
            self._whole = None
        if self._whole is None:
            appearance = self._appearance[1]
            self._whole = _without_holes(
                replace(
                    geometry.mesh,
                    materials=appearance.materials,
                    triangle_materials=appearance.triangle_materials,
                    colors=appearance.colors,
                    color_indices=appearance.color_indices,
                    coordinates=appearance.coordinates,
                    coordinate_indices=appearance.coordinate_indices,
                    priority=self._appearances.priority(self.prim),
                ),
                appearance.kept,
            )
        return self._whole if len(self._whole.triangles) else None

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
        shutter = settled(blur_scaled(shutter, blur_scale(self.prim, frame)), self.placement.jumps())
        shape = self.shape.at(shutter, self.span)
        if shape is None:
            return None

        def state(time: float) -> tuple[np.ndarray, ...]:
            matrix = self._world(time, frame)
            points = shape.points(time) @ matrix[:3, :3] + matrix[3, :3]
            return (points,) if shape.normals is None else (points, transform_normals(shape.normals(time), matrix))

        with np.errstate(over="ignore", invalid="ignore"):
            middle, motions = over_shutter(state, shutter, self.span, self._cubic)
        if not all(np.isfinite(values).all() for values in (*middle, *(motions or ()))):
            raise InputError(
                f"its points leave the range of numbers within the shutter of frame {frame:g} "
                "(correct its points or its transform)",
                self._warnings.file,
                self.label,
            )
        held = self._world(min(max(shutter.middle, self.span[0]), self.span[1]), frame)
        topology = shape.topology.mirrored if np.linalg.det(held[:3, :3]) < 0 else shape.topology
        shaded = shape.normals is not None
        mesh = MeshAtShutter(
            self.label,
            middle[0],
            topology.triangles,
            motions=None if motions is None else motions[0],
            normals=unit(middle[1]) if shaded else None,
            normal_motions=motions[1] if shaded and motions is not None else None,
            normal_indices=np.ascontiguousarray(shape.normal_elements(topology), dtype=np.int32) if shaded else None,
        )
        return _Geometry(mesh, topology, shape.point_count)

    def _world(self, time: float, frame: float) -> np.ndarray:
        return usable(self.placement.world(time, frame), time, self.label, self._warnings.file)


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
