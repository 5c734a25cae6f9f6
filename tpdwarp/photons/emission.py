"""Emission: the cells of a lattice on a light, and the beam and flux of the photon in each of them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import warp as wp

from tpdwarp.photons.beam import Beam
from tpdwarp.scene.description import ExtentShape
from tpdwarp.scene.device.shaping import ShapingValues, shaped

CYLINDER = wp.constant(int(ExtentShape.CYLINDER))
ELLIPSOID = wp.constant(int(ExtentShape.ELLIPSOID))


class Domain(IntEnum):
    """What the lattice of a patch lies on."""

    PLANE = 0
    DIRECTIONS = 1


@wp.struct
class Patch:
    """Cells of one lattice for one shutter, in the tracer's units. ``axis_w`` is the direction of emission.

    A plane patch emits along axis_w from points u axis_u + v axis_v; a direction patch emits from ``position`` along
    tan(u) axis_u + tan(v) axis_v + axis_w (equal angles, so that cells have nearly equal solid angle).
    ``power`` is flux per unit of plane area, or per steradian. Beams begin ``start`` along their direction: those of a
    plane patch begin before the scene, though their points lie in a plane through the origin, where float32 is finest.
    ``near`` is where beams come near what is specular; it equals ``start`` where the light is not far beside that.
    ``magnitude`` is how large the coordinates of what is specular are. Where ``is_shaped`` is 1, ``shaping`` is that of
    the light, about ``shaping_axis``. ``extent_shape`` is that of :class:`tpdwarp.scene.description.Extent`, or −1 for
    none, ``span_a`` and ``span_b`` are its spans, and ``extent_radius`` its radius, or the sine of its half angle.
    Where ``is_place`` is 1, photons come from ``light_place`` alone from the first specular surface on, by the
    coordinates (a, b) of the light. Where ``ball_radius`` is above 0, the light is a place in a ball of that radius,
    ``ball_place`` beside its middle; where ``is_in_ellipsoid`` is 1, a place in an ellipsoid that ``to_ball`` makes the
    unit sphere. ``span_c`` is the third radius of an ellipsoid.
    """

    domain: int
    position: wp.vec3
    start: float
    near: float
    magnitude: wp.vec3
    axis_u: wp.vec3
    axis_v: wp.vec3
    axis_w: wp.vec3
    position_motion: wp.vec3
    axis_u_motion: wp.vec3
    axis_v_motion: wp.vec3
    axis_w_motion: wp.vec3
    origin: wp.vec2
    step: wp.vec2
    first_u: int
    first_v: int
    count_u: int
    count_v: int
    power: wp.vec3
    is_shaped: int
    shaping: ShapingValues
    shaping_axis: wp.vec3
    extent_shape: int
    extent_radius: float
    span_a: wp.vec3
    span_b: wp.vec3
    is_place: int
    light_place: wp.vec2
    ball_place: wp.vec3
    ball_radius: float
    span_c: wp.vec3
    is_in_ellipsoid: int
    to_ball: wp.mat33


@dataclass(frozen=True, eq=False)
class ChosenCells:
    """Some cells of a lattice, one row a cell.

    Attributes:
        cell: Which cells, shape [n, 2] int64.
        offset: How far from the middle of each its photon starts, in lattice steps, shape [n, 2]; None starts there.
    """

    cell: np.ndarray
    offset: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.cell)

    @classmethod
    def of_patch(cls, patch: Patch, numbers: np.ndarray | None = None) -> ChosenCells:
        """Cells of ``patch`` by number, u + count_u · v from its first one; None for all."""
        if numbers is None:
            numbers = np.arange(patch.count_u * patch.count_v)
        down, across = np.divmod(np.asarray(numbers, np.int64), patch.count_u)
        return cls(np.stack([patch.first_u + across, patch.first_v + down], axis=1))


@wp.func
def leaving(patch: Patch, w: wp.vec3) -> float:
    """How far from where a beam of direction ω is aimed from its light begins: on the surface of what has a depth.

    So light of a lamp that stands in water by half does not pass the water's surface within the lamp.
    """
    if patch.is_in_ellipsoid == 1:
        place = patch.to_ball * patch.ball_place
        way = patch.to_ball * w
        there = wp.dot(place, way)
        squared = wp.length_sq(way)
        rest = there * there + squared * (1.0 - wp.length_sq(place))
        return wp.max(wp.sqrt(wp.max(rest, 0.0)) - there, 0.0) / squared
    if patch.ball_radius > 0.0:
        along = wp.dot(patch.ball_place, w)
        square = along * along + patch.ball_radius * patch.ball_radius - wp.length_sq(patch.ball_place)
        return wp.max(wp.sqrt(wp.max(square, 0.0)) - along, 0.0)
    if patch.extent_shape == CYLINDER:
        half = wp.length(patch.span_a)
        cosine = wp.abs(wp.dot(patch.span_a, w)) / half
        sine = wp.sqrt(wp.max(1.0 - cosine * cosine, 0.0))
        # Its ends do not shine, but light passes there.
        if patch.extent_radius * cosine < half * sine:
            return patch.extent_radius / sine
        return half / cosine
    return 0.0


@wp.func
def emit(patch: Patch, coordinates: wp.vec2) -> Beam:
    """The beam of the photon at lattice ``coordinates``; columns are per lattice step."""
    beam = Beam()
    u = patch.origin[0] + coordinates[0] * patch.step[0]
    v = patch.origin[1] + coordinates[1] * patch.step[1]
    if patch.domain == 0:
        beam.x = patch.position + u * patch.axis_u + v * patch.axis_v
        beam.w = patch.axis_w
        beam.dxdu = patch.step[0] * patch.axis_u
        beam.dxdv = patch.step[1] * patch.axis_v
        beam.dxdt = patch.position_motion + u * patch.axis_u_motion + v * patch.axis_v_motion
        beam.dwdt = patch.axis_w_motion - patch.axis_w * wp.dot(patch.axis_w, patch.axis_w_motion)
    else:
        tan_u = wp.tan(u)
        tan_v = wp.tan(v)
        d = tan_u * patch.axis_u + tan_v * patch.axis_v + patch.axis_w
        length = wp.length(d)
        beam.x = patch.position
        beam.w = d / length
        along_u = (patch.step[0] * (1.0 + tan_u * tan_u) / length) * patch.axis_u
        along_v = (patch.step[1] * (1.0 + tan_v * tan_v) / length) * patch.axis_v
        beam.dwdu = along_u - beam.w * wp.dot(beam.w, along_u)
        beam.dwdv = along_v - beam.w * wp.dot(beam.w, along_v)
        beam.dxdt = patch.position_motion
    return beam


@wp.func
def cell_flux(patch: Patch, coordinates: wp.vec2) -> wp.vec3:
    """Flux [W] of the lattice cell around ``coordinates``.

    Of light with extent it is without its shaping, of which each place has its own
    (:func:`tpdwarp.photons.light_columns.flux_of_places`,
    :func:`tpdwarp.photons.light_columns.shaping_of_place`).
    """
    cell = patch.step[0] * patch.step[1]
    if patch.domain == 1:
        tan_u = wp.tan(patch.origin[0] + coordinates[0] * patch.step[0])
        tan_v = wp.tan(patch.origin[1] + coordinates[1] * patch.step[1])
        d2 = 1.0 + tan_u * tan_u + tan_v * tan_v
        cell *= (1.0 + tan_u * tan_u) * (1.0 + tan_v * tan_v) / (d2 * wp.sqrt(d2))
        if patch.is_shaped == 1 and patch.extent_shape < 0:
            w = wp.normalize(tan_u * patch.axis_u + tan_v * patch.axis_v + patch.axis_w)
            cell *= shaped(patch.shaping, patch.shaping_axis, w)
    return patch.power * cell
