"""Edges of receivers: light that a footprint would spread beyond them is mirrored back.

A footprint reaches over a cell or two and a pixel. Where its receiver ends there, as at the lip of a step, or another
one stands on it, the rest would fall on nothing: of a wide B-spline beside an edge a sixth of its cell. But light goes
on evenly up to the edge. So a footprint that reaches over an edge has an image beyond it, reflected about the line of
the edge: what the footprint loses there its image brings back, flux is whole, and even light stays even (the reflection
method of density estimation: Silverman 1986, section 2.10). At a corner there are images by both lines, and one by the
one after the other.

Edges are looked for with short rays, in eight directions of the ellipse that a footprint reaches over, its way
included: there the receiver does not go on, on planes that the footprint counts on, or another one stands before it.
Two such places make a line; of several lines the one that most of the places lie on counts.

Beyond the paper, whose receivers are without end.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.footprints.gather import SMALLEST_COSINE
from tpdwarp.footprints.shaping import (
    LONGEST_AXIS,
    PLANE_TOLERANCE,
    direction,
    in_frame,
    out_of_frame,
    singular_values,
    slant_of,
    tangent_frame,
)
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.scene.description import Interaction
from tpdwarp.scene.device.geometry import Surfaces
from tpdwarp.scene.device.intersection import plane_of
from tpdwarp.scene.device.ray_tree import Met, first_met

# Unrolled, its loops over directions take minutes to compile.
wp.set_module_options({"max_unroll": 0})

DIFFUSE = wp.constant(int(Interaction.DIFFUSE))
DIRECTIONS = 8
HALF_OF_DIRECTIONS = DIRECTIONS // 2
STEP_OF_DIRECTIONS = wp.constant(2.0 * math.pi / DIRECTIONS)
# Semi-axes of the ellipse, in cells: it holds the corners of the 3 x 3 cells of a B-spline.
REACH_IN_CELLS = wp.constant(2.0)
# Places where a receiver ends are told to 2⁻ᵏ of half of an ellipse: a focus may be a sixteenth of a pixel wide, and
# its image has to lie on the other side.
BISECTIONS = 9
# Places lie on a line that are no farther from it than this, in the ellipse's units.
ON_LINE = wp.constant(0.02)
# A line is where a receiver ends if it is there so far to one side of it, and not to the other, in the same units.
BESIDE_LINE = wp.constant(0.05)
# Light that goes by more than so many of its cells is not mirrored: it leaves receivers, and none comes in its place.
# Chosen, not derived.
LONGEST_WAY = wp.constant(16.0)
# Surfaces that short rays pass at most on their way: what lies on a receiver, or glass in contact with it.
MOST_PASSED = 4
# A ray that grazes a surface goes on no farther behind it than so many offsets.
MOST_OFFSETS = wp.constant(1.0e3)
# What stands on a receiver is looked for at this height, as a part of how far off its plane a footprint counts.
HEIGHT_OF_WALLS = wp.constant(0.25)
# Reflections that a photon has at most.
LINES = 2

Places = wp.types.vector(length=DIRECTIONS, dtype=wp.float32)


@wp.struct
class PhotonsAtEdges:
    """Photons whose footprints may reach over edges, in the tracer's units: one row a photon.

    ``light`` is against the light and has the length one along ``normal``; no rows of flat receivers. ``late`` is how
    long after the scene's own time photons stand where they do, by the time of their motion.
    """

    position: wp.array(dtype=wp.vec3)
    normal: wp.array(dtype=wp.vec3)
    dxdu: wp.array(dtype=wp.vec3)
    dxdv: wp.array(dtype=wp.vec3)
    way: wp.array(dtype=wp.vec3)
    receiver_motion: wp.array(dtype=wp.vec3)
    receiver: wp.array(dtype=wp.int32)
    light: wp.array(dtype=wp.vec3)
    late: float


@wp.struct
class Receiver:
    """The receiver of a footprint: its object, its unit normal, along what planes beside it are looked for (with the
    length one along the normal), and how far off its own plane they may lie."""

    number: int
    normal: wp.vec3
    light: wp.vec3
    height: float


@wp.struct
class Line:
    """A line in the ellipse's units: unit normal, distance from the centre, and how many places lie on it."""

    normal: wp.vec2
    distance: float
    support: int


@wp.func
def is_of(surfaces: Surfaces, triangle: int, receiver: Receiver) -> bool:
    """Whether a footprint on ``receiver`` counts on a triangle (Eq. 8 beyond the plane of its photon)."""
    if surfaces.object_of[triangle] != receiver.number:
        return False
    return wp.abs(wp.dot(plane_of(surfaces, triangle).n_g, receiver.normal)) > SMALLEST_COSINE


@wp.func
def behind(surfaces: Surfaces, met: Met, w: wp.vec3) -> float:
    """How far along ω a ray goes on that passed a surface (beyond the paper)."""
    plane = plane_of(surfaces, met.triangle)
    return met.distance + plane.offset * wp.min(MOST_OFFSETS, 1.0 / wp.max(wp.abs(wp.dot(plane.n_g, w)), 1.0e-6))


@wp.func
def goes_on(surfaces: Surfaces, receiver: Receiver, place: wp.vec3) -> bool:
    """Whether the receiver is there at a place of its plane (beyond the paper)."""
    start = place + receiver.height * receiver.light
    way = -2.0 * receiver.height * receiver.light
    left = wp.length(way)
    w = way / left
    for _ in range(MOST_PASSED):
        met = first_met(surfaces.tree, start, w, left)
        if met.triangle < 0:
            return False
        if is_of(surfaces, met.triangle, receiver):
            return True
        passed = behind(surfaces, met, w)
        start += passed * w
        left -= passed
        if left <= 0.0:
            return False
    return False


@wp.func
def is_within(surfaces: Surfaces, number: int, place: wp.vec3, up: wp.vec3) -> bool:
    """Whether what is above a place is the object ``number`` (beyond the paper), as it is within a solid."""
    met = first_met(surfaces.tree, place, up, 2.0 * LONGEST_AXIS)
    if met.triangle < 0:
        return False
    return surfaces.object_of[met.triangle] == number


@wp.func
def part_before_wall(surfaces: Surfaces, receiver: Receiver, place: wp.vec3, way: wp.vec3) -> float:
    """The part of a way on the receiver before it goes into a solid, or comes out of it; more than one where it does
    not (beyond the paper): behind a thin wall there is a receiver that has no part in this light.
    """
    length = wp.length(way)
    w = way / length
    start = place + HEIGHT_OF_WALLS * receiver.height * receiver.normal
    gone = float(0.0)
    for _ in range(MOST_PASSED):
        met = first_met(surfaces.tree, start + gone * w, w, length - gone)
        if met.triangle < 0:
            return 2.0
        diffuse = surfaces.interaction[surfaces.material_of[met.triangle]] == DIFFUSE
        if diffuse and not is_of(surfaces, met.triangle, receiver):
            number = surfaces.object_of[met.triangle]
            inside = is_within(surfaces, number, start, receiver.normal)
            if is_within(surfaces, number, start + length * w, receiver.normal) != inside:
                return (gone + met.distance) / length
            return 2.0
        gone += behind(surfaces, met, w)
        if gone >= length:
            return 2.0
    return 2.0


@wp.func
def is_reached(surfaces: Surfaces, receiver: Receiver, center: wp.vec3, place: wp.vec2, u: wp.vec3, v: wp.vec3) -> bool:
    """Whether the receiver is there at a place of the ellipse with the semi-axes u, v (beyond the paper)."""
    out = wp.length(place)
    way = (place[0] * u + place[1] * v) / wp.max(out, 1.0e-6)
    before_wall = part_before_wall(surfaces, receiver, center, way) > out
    return before_wall and goes_on(surfaces, receiver, center + out * way)


@wp.func
def best_line(
    surfaces: Surfaces, receiver: Receiver, center: wp.vec3, u: wp.vec3, v: wp.vec3, parts: Places, left: Places
) -> Line:
    """The line through two places that most of the places ``left`` lie on, by the two that are farthest apart.

    Half-way between two places on different edges of a corner the receiver does not end.

    Args:
        surfaces, receiver: What ends.
        center: Of the ellipse.
        u, v: Its semi-axes.
        parts: How far out the receiver ends in each direction, in the ellipse's units; above one where it does not.
        left: Above zero for those that count.
    """
    best = Line()
    longest = float(0.0)
    for k in range(DIRECTIONS):
        for other in range(k):
            if left[k] > 0.0 and left[other] > 0.0:
                a = parts[k] * direction(float(k) * STEP_OF_DIRECTIONS)
                b = parts[other] * direction(float(other) * STEP_OF_DIRECTIONS)
                apart = wp.length(b - a)
                line = Line()
                line.normal = wp.vec2(a[1] - b[1], b[0] - a[0]) / wp.max(apart, 1.0e-6)
                line.distance = wp.dot(line.normal, a)
                for j in range(DIRECTIONS):
                    at = parts[j] * direction(float(j) * STEP_OF_DIRECTIONS)
                    if left[j] > 0.0 and wp.abs(wp.dot(line.normal, at) - line.distance) < ON_LINE:
                        line.support += 1
                if line.support > best.support or (line.support == best.support and apart > longest):
                    within = 0.5 * (a + b) - BESIDE_LINE * line.normal
                    beyond = 0.5 * (a + b) + BESIDE_LINE * line.normal
                    one = is_reached(surfaces, receiver, center, within, u, v)
                    if is_reached(surfaces, receiver, center, beyond, u, v) != one:
                        best = line
                        longest = apart
    return best


@wp.func
def goes_through(line: Line, parts: Places) -> bool:
    """Whether a line ends a receiver wherever it goes through the ellipse (beyond the paper): it does not beside a
    corner that the receiver goes around, where the image of a footprint would fall on what has light of its own."""
    through = bool(True)
    for k in range(DIRECTIONS):
        toward = wp.dot(line.normal, direction(float(k) * STEP_OF_DIRECTIONS))
        if wp.sign(line.distance) * toward > wp.abs(line.distance) + ON_LINE and parts[k] > 1.0:
            through = False
    return through


@wp.kernel(enable_backward=False)
def find_edges(
    base: int,
    in_turn: int,
    # In
    surfaces: Surfaces,
    photons: PhotonsAtEdges,
    pixel_side: float,
    # Out
    edges: wp.array2d(dtype=wp.vec4),
):
    """The lines about which footprints are mirrored, as planes (unit normal, distance from the origin) across that of
    the receiver; zero where there are none."""
    first = base + wp.tid() * in_turn
    for i in range(first, first + in_turn):
        receiver = Receiver()
        receiver.number = photons.receiver[i]
        receiver.normal = photons.normal[i]
        receiver.light = receiver.normal
        if photons.light.shape[0] > 0:
            receiver.light = receiver.normal + slant_of(photons.light[i], receiver.normal)
        frame = tangent_frame(receiver.normal)
        since = photons.late * photons.receiver_motion[i]
        center = photons.position[i] - since

        # ---- The ellipse that the footprint reaches over: cells, the pixel, and half of its way to either side
        u = in_frame(frame, photons.dxdu[i])
        v = in_frame(frame, photons.dxdv[i])
        way = in_frame(frame, 0.5 * photons.way[i])
        square = REACH_IN_CELLS * REACH_IN_CELLS
        xx = square * (u[0] * u[0] + v[0] * v[0]) + way[0] * way[0] + pixel_side * pixel_side
        xy = square * (u[0] * u[1] + v[0] * v[1]) + way[0] * way[1]
        yy = square * (u[1] * u[1] + v[1] * v[1]) + way[1] * way[1] + pixel_side * pixel_side
        spread = singular_values(xx, xy, xy, yy)
        long = wp.min(wp.sqrt(spread.s1), LONGEST_AXIS)
        short = wp.min(wp.sqrt(wp.abs(spread.s2)), LONGEST_AXIS)
        along = direction(spread.left)
        a = long * out_of_frame(frame, along)
        b = short * out_of_frame(frame, wp.vec2(-along[1], along[0]))
        size = wp.length(u) + wp.length(v)
        receiver.height = wp.min(PLANE_TOLERANCE * (1.5 * size + pixel_side), LONGEST_AXIS)
        if short <= 0.0 or receiver.height <= 0.0 or 2.0 * wp.length(way) > LONGEST_WAY * size:
            continue

        # ---- Where the receiver ends
        here = goes_on(surfaces, receiver, center)
        parts = Places(2.0)
        left = Places()
        found = int(0)
        for turn in range(DIRECTIONS):
            # Every other direction first: most footprints reach over no edge.
            k = 2 * (turn % HALF_OF_DIRECTIONS) + turn // HALF_OF_DIRECTIONS
            if turn < HALF_OF_DIRECTIONS or found > 0:
                toward = direction(float(k) * STEP_OF_DIRECTIONS)
                way_out = toward[0] * a + toward[1] * b
                wall = part_before_wall(surfaces, receiver, center, way_out)
                near = float(0.5)
                far = float(1.0)
                # What is there again farther out has light of its own.
                ends = (wall >= 1.0 and goes_on(surfaces, receiver, center + way_out)) != here
                if ends and (wall > 0.5 and goes_on(surfaces, receiver, center + 0.5 * way_out)) != here:
                    near = 0.0
                    far = 0.5
                if ends:
                    for _ in range(BISECTIONS):
                        part = 0.5 * (near + far)
                        if (part < wall and goes_on(surfaces, receiver, center + part * way_out)) != here:
                            far = part
                        else:
                            near = part
                    parts[k] = 0.5 * (near + far)
                    left[k] = 1.0
                    found += 1

        # ---- Lines through these places
        for number in range(LINES):
            line = best_line(surfaces, receiver, center, a, b, parts, left)
            if line.support > 0:
                for k in range(DIRECTIONS):
                    at = parts[k] * direction(float(k) * STEP_OF_DIRECTIONS)
                    if wp.abs(wp.dot(line.normal, at) - line.distance) < ON_LINE:
                        left[k] = 0.0
                if not goes_through(line, parts):
                    continue
                m = wp.normalize(a * (line.normal[0] / (long * long)) + b * (line.normal[1] / (short * short)))
                foot = center + line.distance * (line.normal[0] * a + line.normal[1] * b) + since
                edges[i, number] = wp.vec4(m[0], m[1], m[2], wp.dot(m, foot))


def with_edges(
    photons: PhotonMap,
    surfaces: Surfaces,
    pixel_side: float,
    launcher: Launcher,
    chosen: np.ndarray | None = None,
    finer: int = 1,
) -> PhotonMap:
    """Photons with the edges that their footprints reach over.

    Args:
        photons: With the time and the duration that they have in the shutter of ``surfaces``.
        surfaces: The scene at the middle of that shutter.
        pixel_side: Side of a pixel on receivers [tracer's units].
        launcher: Runs the kernel.
        chosen: Rows of photons that may lie at edges; None for all.
        finer: How many of these photons' cells lie along either side of one whose footprint they may have.
    """
    rows = np.arange(len(photons)) if chosen is None else chosen
    if not len(rows):
        return photons
    asked = PhotonsAtEdges()
    size = np.float32(finer)
    of_rows = photons.rows(rows)
    columns = {"position": of_rows.position, "normal": of_rows.normal, "receiver_motion": of_rows.receiver_motion}
    columns |= {"dxdu": size * of_rows.dxdu, "dxdv": size * of_rows.dxdv, "way": of_rows.dxdt - of_rows.receiver_motion}
    columns["light"] = of_rows.incidence
    for name, values in columns.items():
        setattr(asked, name, launcher.array(values, wp.vec3))
    asked.receiver = launcher.array(of_rows.receiver, wp.int32)
    asked.late = photons.time / photons.duration
    found = wp.zeros((len(rows), LINES), dtype=wp.vec4, device=launcher.device)
    launcher(find_edges, len(rows), [surfaces, asked, pixel_side, found], in_turn=True)
    edges = found.numpy()
    if not edges.any():
        return photons
    everywhere = np.zeros((len(photons), LINES, 4), np.float32)
    everywhere[rows] = edges
    return replace(photons, edges=everywhere)


def with_images(maps: Sequence[PhotonMap]) -> list[PhotonMap]:
    """The photons, and their images by the edges that they reach over."""
    return [part for photons in maps for part in _with_images(photons)]


def _with_images(photons: PhotonMap) -> Iterator[PhotonMap]:
    edges = photons.edges
    photons = replace(photons, edges=edges[:0])
    yield photons
    if not len(edges):
        return
    one, other = (edges[:, number].any(axis=1) for number in range(LINES))
    for numbers, there in (((0,), one), ((1,), other), ((0, 1), one & other)):
        rows = np.flatnonzero(there)
        if len(rows):
            mirrors = np.zeros((len(rows), LINES, 3), np.float32)
            image = replace(photons.rows(rows), mirrors=mirrors)
            for number in numbers:
                mirrors[:, number] = edges[rows, number, :3]
                image = _mirrored(image, edges[rows, number])
            yield image


def _mirrored(photons: PhotonMap, planes: np.ndarray) -> PhotonMap:
    """Photons on the other side of planes that their receivers take along, [n, 4]."""
    normal, distance = planes[:, :3], planes[:, 3:]

    def turned(vectors: np.ndarray) -> np.ndarray:
        if len(vectors) != len(normal):
            return vectors
        return vectors - 2.0 * np.einsum("ij,ij->i", vectors, normal)[:, None] * normal

    moved = turned(photons.dxdt - photons.receiver_motion) + photons.receiver_motion
    columns = {name: turned(getattr(photons, name)) for name in _IN_PLANE}
    trajectory = photons.trajectory
    if trajectory is not None:
        curves = {name: turned(getattr(trajectory, name)) for name in _OF_TRAJECTORIES}
        trajectory = replace(trajectory, **curves)
    position = turned(photons.position) + 2.0 * distance * normal
    return replace(photons, position=position, dxdt=moved, trajectory=trajectory, **columns)


# Columns that are mirrored as vectors.
_IN_PLANE = ("dxdu", "dxdv", "dxda", "dxdb", "bend", "cell_u", "cell_v")
_OF_TRAJECTORIES = ("dxdtt", "dxdttt", "dxdut", "dxdvt")
