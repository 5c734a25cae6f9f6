"""Photons as they leave lights: points, parallel light, and lights with extent.

Light with extent is sampled jointly over places on the light (or directions of the sun's disc) and over a ball that
holds all that is specular, so that each photon is one of the light's radiance, and no place is averaged before.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import warp as wp

from .description import DIFFUSE, Light, Mesh, between
from .sobol import coordinate

# Parallel light starts so far before the nearest vertex it is aimed at: farther than anything that shades it.
BEFORE = wp.constant(wp.float64(100.0))
ZERO = wp.constant(wp.float64(0.0))
ONE = wp.constant(wp.float64(1.0))
TWO = wp.constant(wp.float64(2.0))
TURN = wp.constant(wp.float64(2.0 * math.pi))
POINT, PARALLEL, SUN, SPHERE, RECTANGLE, DISC, TUBE = (wp.constant(kind) for kind in range(7))


@wp.struct
class Pending:
    """A branch to follow: origin, direction, time, flux, triangle just left, surfaces met."""

    x: wp.vec3d
    w: wp.vec3d
    s: wp.float64
    flux: wp.float64
    left: wp.int32
    surfaces: wp.int32


@wp.struct
class Emission:
    """The light over a part of the shutter and a window of its own plane.

    Parallel light: photons start at ``origin`` + a·``e1`` + b·``e2`` along ``e3``. Point: they leave ``origin`` along
    a·e1 + b·e2 + e3, and their flux falls with the cube of the cosine to e3. (a, b) lie in ``corner`` + [0, ``size``].
    Lights with extent: photons meet the ball of ``radius`` about ``middle``. Those of a sun, of a half angle with the
    sine ``extent``, go along e3 but for that. Those of a sphere of radius ``extent``, of a rectangle or an ellipse with
    half of its sides ``span_a`` and ``span_b``, which shines along e3, or of the side of a cylinder of radius
    ``extent`` about ± ``span_a`` leave its surface about ``origin``.
    ``flux`` is that of a photon along e3, of lights with extent π times their radiance by the number of photons;
    ``seed`` that of the sequence. Times lie in ``start`` + [0, ``duration``], parts of the shutter, over all of which
    the origin moves by ``motion``.
    """

    kind: wp.int32
    origin: wp.vec3d
    e1: wp.vec3d
    e2: wp.vec3d
    e3: wp.vec3d
    corner: wp.vec2d
    size: wp.vec2d
    flux: wp.float64
    seed: wp.int32
    motion: wp.vec3d
    start: wp.float64
    duration: wp.float64
    extent: wp.float64
    span_a: wp.vec3d
    span_b: wp.vec3d
    middle: wp.vec3d
    radius: wp.float64


@wp.func
def on_disc(a: wp.float64, b: wp.float64) -> wp.vec2d:
    """A point of the unit disc, evenly."""
    r = wp.sqrt(a)
    return wp.vec2d(r * wp.cos(TURN * b), r * wp.sin(TURN * b))


@wp.func
def across(w: wp.vec3d) -> wp.vec3d:
    """A unit vector at right angles to a unit vector."""
    other = wp.vec3d(ONE, ZERO, ZERO)
    if wp.abs(w[0]) > wp.float64(0.6):
        other = wp.vec3d(ZERO, ONE, ZERO)
    return wp.normalize(wp.cross(other, w))


@wp.func
def of_sun(emission: Emission, a: wp.float64, b: wp.float64, place: wp.vec2d) -> Pending:
    """A photon of a disc of directions through the ball: π L dA dω / π, with dω the area of sines over the cosine."""
    out = Pending()
    sines = emission.extent * place
    cosine = wp.sqrt(ONE - wp.dot(sines, sines))
    out.w = sines[0] * emission.e1 + sines[1] * emission.e2 + cosine * emission.e3
    e1 = across(out.w)
    point = emission.radius * on_disc(a, b)
    out.x = emission.middle + point[0] * e1 + point[1] * wp.cross(out.w, e1) - BEFORE * out.w
    area = wp.float64(0.5) * TURN * emission.radius * emission.radius
    out.flux = emission.flux * emission.extent * emission.extent * area / cosine
    return out


@wp.func
def into_ball(emission: Emission, x: wp.vec3d, n: wp.vec3d, a: wp.float64, b: wp.float64) -> Pending:
    """A photon from a place with normal n into the cone around the ball: L dA cos θ dω, without dA."""
    out = Pending()
    to_ball = emission.middle - x
    distance = wp.length(to_ball)
    lowest = -ONE
    if distance > emission.radius:
        sine = emission.radius / distance
        lowest = wp.sqrt(ONE - sine * sine)
    cosine = ONE - a * (ONE - lowest)
    sine = wp.sqrt(wp.max(ONE - cosine * cosine, ZERO))
    axis = to_ball / distance
    e1 = across(axis)
    turned = wp.cos(TURN * b) * e1 + wp.sin(TURN * b) * wp.cross(axis, e1)
    out.x = x
    out.w = wp.normalize(cosine * axis + sine * turned)
    # π L of the light, 2π (1 − cos) of the cone.
    out.flux = emission.flux * TWO * (ONE - lowest) * wp.max(wp.dot(out.w, n), ZERO)
    return out


@wp.func
def of_extent(
    emission: Emission, origin: wp.vec3d, a: wp.float64, b: wp.float64, c: wp.float64, d: wp.float64
) -> Pending:
    """A photon of a light with extent: (a, b) say where it meets the ball, (c, d) where it comes from."""
    if emission.kind == SUN:
        return of_sun(emission, a, b, on_disc(c, d))
    if emission.kind == SPHERE:
        height = ONE - TWO * c
        level = wp.sqrt(wp.max(ONE - height * height, ZERO))
        n = wp.vec3d(level * wp.cos(TURN * d), level * wp.sin(TURN * d), height)
        out = into_ball(emission, origin + emission.extent * n, n, a, b)
        out.flux *= TWO * TURN * emission.extent * emission.extent
        return out
    if emission.kind == TUBE:
        e1 = across(wp.normalize(emission.span_a))
        n = wp.cos(TURN * d) * e1 + wp.sin(TURN * d) * wp.cross(wp.normalize(emission.span_a), e1)
        out = into_ball(emission, origin + (TWO * c - ONE) * emission.span_a + emission.extent * n, n, a, b)
        out.flux *= TWO * TURN * emission.extent * wp.length(emission.span_a)
        return out
    place = wp.vec2d(TWO * c - ONE, TWO * d - ONE)
    area = wp.float64(4.0)
    if emission.kind == DISC:
        place = on_disc(c, d)
        area = wp.float64(0.5) * TURN
    out = into_ball(emission, origin + place[0] * emission.span_a + place[1] * emission.span_b, emission.e3, a, b)
    out.flux *= area * wp.length(wp.cross(emission.span_a, emission.span_b))
    return out


@wp.func
def first_ray(emission: Emission, directions: wp.array2d(dtype=wp.uint32), photon: int) -> Pending:
    """A photon as it leaves the light."""
    s = emission.start + emission.duration * coordinate(directions, photon, 2, emission.seed)
    origin = emission.origin + s * emission.motion
    a = coordinate(directions, photon, 0, emission.seed)
    b = coordinate(directions, photon, 1, emission.seed)
    ray = Pending()
    ray.flux = emission.flux
    if emission.kind >= SUN:
        c = coordinate(directions, photon, 3, emission.seed)
        d = coordinate(directions, photon, 4, emission.seed)
        ray = of_extent(emission, origin, a, b, c, d)
    a = emission.corner[0] + emission.size[0] * a
    b = emission.corner[1] + emission.size[1] * b
    ray.left = -1
    ray.surfaces = 0
    ray.s = s
    if emission.kind == PARALLEL:
        ray.x = origin + a * emission.e1 + b * emission.e2
        ray.w = emission.e3
    elif emission.kind == POINT:
        ray.x = origin
        ray.w = wp.normalize(a * emission.e1 + b * emission.e2 + emission.e3)
        cosine = wp.dot(ray.w, emission.e3)
        ray.flux = emission.flux * cosine * cosine * cosine
    return ray


@dataclass(frozen=True, eq=False)
class Window:
    """The part of a light's domain that photons are sent into; see :class:`Emission`.

    Attributes:
        origin, motion: Origin at the opening of the shutter and its displacement until it closes, shape [3].
        axes: Rows are e1, e2, e3, shape [3, 3].
        corner, size: Of the window, shape [2].
    """

    origin: np.ndarray
    motion: np.ndarray
    axes: np.ndarray
    corner: np.ndarray
    size: np.ndarray


def window_of(light: Light, meshes: tuple[Mesh, ...], start: float, end: float) -> Window:
    """The window over the bounds of the specular meshes that a light is aimed at, from ``start`` to ``end``.

    A vertex and the light move linearly: their offset's coordinates, and the ratios of these, are extreme at the ends.

    Raises:
        ValueError: A point light next to or between what it is aimed at.
    """
    aimed = _aimed_at(light, meshes)
    points = [np.concatenate([between(mesh.points, s) for mesh in aimed]) for s in (start, end)]
    if light.direction is not None:
        axes = _axes_around(np.asarray(light.direction, dtype=np.float64))
        nearest = min(float((ends @ axes[2]).min()) for ends in points)
        origin, motion = axes[2] * (nearest - float(BEFORE.value)), np.zeros(3)
        flat = np.concatenate([(ends - origin) @ axes[:2].T for ends in points])
    else:
        origin = between(light.position, 0.0)
        motion = between(light.position, 1.0) - origin
        middle = 0.5 * (points[0].min(axis=0) + points[0].max(axis=0))
        axes = _axes_around(middle - between(light.position, start))
        local = np.concatenate(
            [(ends - between(light.position, s)) @ axes.T for ends, s in zip(points, (start, end), strict=True)]
        )
        if local[:, 2].min() <= 0.0:
            raise ValueError(f"{light.name} is too near to what it is aimed at")
        flat = local[:, :2] / local[:, 2:]
    low, high = flat.min(axis=0), flat.max(axis=0)
    return Window(origin, motion, axes, low, high - low)



def emission_of(light: Light, meshes: tuple[Mesh, ...], start: float, end: float, count: int, seed: int) -> Emission:
    """How ``count`` photons leave a light from ``start`` to ``end``, along the sequence of ``seed``."""
    out = Emission()
    out.seed, out.start, out.duration = seed, start, end - start
    if not light.extended:
        window = window_of(light, meshes, start, end)
        out.kind = POINT if light.direction is None else PARALLEL
        out.origin, out.motion = wp.vec3d(*window.origin), wp.vec3d(*window.motion)
        out.e1, out.e2, out.e3 = (wp.vec3d(*axis) for axis in window.axes)
        out.corner, out.size = wp.vec2d(*window.corner), wp.vec2d(*window.size)
        out.flux = light.power * float(np.prod(window.size)) / count
        return out
    points = np.concatenate([between(m.points, s) for m in _aimed_at(light, meshes) for s in (start, end)])
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    out.middle, out.radius = wp.vec3d(*middle), float(np.linalg.norm(points - middle, axis=1).max())
    if light.direction is not None:
        out.kind, out.extent = SUN, math.sin(0.5 * light.angle)
        out.e1, out.e2, out.e3 = (wp.vec3d(*axis) for axis in _axes_around(light.direction))
        # π sin² σ L is the irradiance across the middle.
        out.flux = light.power / (out.extent**2 * count)
        return out
    origin = between(light.position, 0.0)
    out.origin, out.motion = wp.vec3d(*origin), wp.vec3d(*(between(light.position, 1.0) - origin))
    if light.spans is None:
        out.kind, out.extent = SPHERE, light.radius
        area = math.pi * light.radius**2
    elif light.radius > 0.0:
        out.kind, out.span_a, out.extent = TUBE, wp.vec3d(*light.spans[0]), light.radius
        area = 4.0 * light.radius * float(np.linalg.norm(light.spans[0]))
    else:
        a, b = light.spans
        out.kind, out.span_a, out.span_b = DISC if light.rounded else RECTANGLE, wp.vec3d(*a), wp.vec3d(*b)
        area = (math.pi if light.rounded else 4.0) * float(np.linalg.norm(np.cross(a, b)))
        out.e3 = wp.normalize(wp.vec3d(*np.cross(b, a)))
    # The area that is seen from before it, times its radiance, is the intensity.
    out.flux = math.pi * light.power / (area * count)
    return out


def _aimed_at(light: Light, meshes: tuple[Mesh, ...]) -> list[Mesh]:
    return [m for m in meshes if m.interaction != DIFFUSE and (light.aim is None or m.name in light.aim)]


def _axes_around(direction: np.ndarray) -> np.ndarray:
    """Rows are three orthonormal axes, the last along ``direction``."""
    last = direction / np.linalg.norm(direction)
    first = np.cross(np.eye(3)[int(np.argmin(np.abs(last)))], last)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(last, first), last])
