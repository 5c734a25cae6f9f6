"""Lights with extent on the device, and direct light from them.

Unshadowed irradiance is known in closed form: of a sphere and of the sun's disc (Snyder 1996), a disk (its light
vector, Fock 1924), a rectangle (Lambert 1760). It is multiplied by the share of the light that nothing hides, which a
few stratified places on the light tell; so there is noise in penumbras only. That of a cylinder is that of a rectangle
that is seen as its side is, and that of an ellipsoid that of the flat ellipse as which it is seen.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.scene.description import ExtentShape, LightAtShutter, LightKind
from tpdwarp.scene.device.ellipsoids import ellipsoid_from
from tpdwarp.scene.device.geometry import Surfaces
from tpdwarp.scene.device.links import UNLIT
from tpdwarp.scene.device.round_lights import VISIBLE_SIDE, round_irradiance
from tpdwarp.scene.device.shaping import SHAPING_COUNT, ShapingValues, across_of, shaped, shaping_of_surface
from tpdwarp.scene.device.textures import TextureArrays
from tpdwarp.scene.normalization import Normalization
from tpdwarp.view.lights import FAR, set_links

# Strata of the light along either of its axes, of one camera sample; the samples of a pixel share out each of them.
# Chosen, not derived: four samples a pixel then look at sixteen places.
STRATA = wp.constant(2)
# A sun whose half angle has no larger sine, 1.1° across, has one: its penumbras are a fiftieth as wide as what throws
# them is high, and four shadow rays in place of one made whole frames of a sea a quarter slower.
NARROW = wp.constant(0.01)
ROUND = wp.constant(int(ExtentShape.ROUND))
DISK = wp.constant(int(ExtentShape.DISK))
RECT = wp.constant(int(ExtentShape.RECT))
CYLINDER = wp.constant(int(ExtentShape.CYLINDER))
ELLIPSOID = wp.constant(int(ExtentShape.ELLIPSOID))
PI = wp.constant(math.pi)
NODE_OF_DISC = wp.constant(math.sqrt(2.0 / 3.0))
# A point is never nearer to the middle of a sphere than its radius, and a little: within it nothing is defined.
OUTSIDE = wp.constant(1.0001)
# A flat light farther off than so many times its size is a point: that errs by the square of the ratio, 0.1 %, and the
# sum over the edges of a polygon by its rounding, 6e-8 by that square.
POINT_FROM = wp.constant(30.0)
# An ellipse farther off than so many times its size, all above the horizon, is summed over nodes that are exact to the
# fifth order: that errs by the sixth power of the ratio.
NODES_FROM = wp.constant(3.0)
# Edges of the polygon that stands for a disk which the horizon cuts; of equal area, it errs by 0.1 %.
EDGES = wp.constant(24)
EDGE_SCALE = wp.constant(math.sqrt(2.0 * math.pi / (24 * math.sin(2.0 * math.pi / 24))))
# A disk counts as a circle where its axes differ by no more than this part, and as an ellipse elsewhere.
CIRCLE = wp.constant(1.0e-3)
TURN = wp.constant(2.0 * math.pi)
# Random numbers that choose places on lights, the same ones in every frame; others than those of other choices.
OF_LIGHTS = wp.constant(15485863)


@wp.struct
class AreaLightArrays:
    """Lights with extent in the tracer's units, one row a light.

    ``place`` is the direction of travel or the position, ``span_a``, ``span_b`` and ``span_c`` are as in
    :class:`tpdwarp.scene.description.Extent`; each changes by its motion over the shutter. ``facing`` is the normal of
    what is flat. ``radius`` of parallel light is the sine of the half angle. ``shaping`` is that beside the profile.
    ``meshed`` is 1 for lights in whose place mirrors show a mesh that shines.
    """

    distant: wp.array(dtype=wp.int32)
    shape: wp.array(dtype=wp.int32)
    place: wp.array(dtype=wp.vec3)
    place_motion: wp.array(dtype=wp.vec3)
    power: wp.array(dtype=wp.vec3)
    radius: wp.array(dtype=wp.float32)
    radius_motion: wp.array(dtype=wp.float32)
    span_a: wp.array(dtype=wp.vec3)
    span_a_motion: wp.array(dtype=wp.vec3)
    span_b: wp.array(dtype=wp.vec3)
    span_b_motion: wp.array(dtype=wp.vec3)
    span_c: wp.array(dtype=wp.vec3)
    span_c_motion: wp.array(dtype=wp.vec3)
    facing: wp.array(dtype=wp.vec3)
    facing_motion: wp.array(dtype=wp.vec3)
    shaping: wp.array(dtype=ShapingValues)
    meshed: wp.array(dtype=wp.int32)
    links: wp.array2d(dtype=wp.int32)
    link_row: wp.array(dtype=wp.int32)


def area_light_arrays(
    lights: tuple[LightAtShutter, ...], normalization: Normalization, launcher: Launcher, paths: Sequence[str] = ()
) -> AreaLightArrays:
    """The kernel's view of those of ``lights`` that have an extent.

    Args:
        paths: Paths of the objects that lights may be linked to.
    """
    chosen = [light for light in lights if light.extent is not None]
    distant = [light.kind == LightKind.DISTANT for light in chosen]
    scale = normalization.scale
    rows: dict[str, list[object]] = {
        "place": [
            -light.axes[2] if far else normalization.points(light.position[None])[0]
            for light, far in zip(chosen, distant, strict=True)
        ],
        "place_motion": [
            -light.axes_motion[2] if far else light.position_motion * scale
            for light, far in zip(chosen, distant, strict=True)
        ],
        "power": [normalization.light_power(light) for light in chosen],
        "span_a": [scale * light.extent.spans[0] for light in chosen],
        "span_a_motion": [scale * light.extent.spans_motion[0] for light in chosen],
        "span_b": [scale * light.extent.spans[1] for light in chosen],
        "span_b_motion": [scale * light.extent.spans_motion[1] for light in chosen],
        "span_c": [scale * third_of(light.extent.spans) for light in chosen],
        "span_c_motion": [scale * third_of(light.extent.spans_motion) for light in chosen],
        "facing": [-light.axes[2] for light in chosen],
        "facing_motion": [-light.axes_motion[2] for light in chosen],
    }
    out = AreaLightArrays()
    set_links(out, chosen, launcher, paths)
    for name, values in rows.items():
        setattr(out, name, launcher.array(np.array(values, np.float32).reshape(-1, 3), wp.vec3))
    values = np.array([shaping_of_surface(light) for light in chosen], np.float32)
    out.shaping = launcher.array(values.reshape(-1, SHAPING_COUNT), ShapingValues)
    out.distant = launcher.array(np.array(distant, np.int32), wp.int32)
    out.meshed = launcher.array(np.array([light.meshed for light in chosen], np.int32), wp.int32)
    out.shape = launcher.array(np.array([light.extent.shape for light in chosen], np.int32), wp.int32)
    opened, radii, closed = (
        np.array(
            [
                math.sin(light.extent.radius_at(part)) if far else scale * light.extent.radius_at(part)
                for light, far in zip(chosen, distant, strict=True)
            ]
        )
        for part in (-0.5, 0.0, 0.5)
    )
    out.radius = launcher.array(radii.astype(np.float32), wp.float32)
    out.radius_motion = launcher.array((closed - opened).astype(np.float32), wp.float32)
    return out


def third_of(spans: np.ndarray) -> np.ndarray:
    """The third of what spans a light, shape [3]; zero of what has but two."""
    return spans[2] if len(spans) > 2 else np.zeros(3)


@wp.struct
class AreaLight:
    """A light with extent at a time, as seen from a point: ``d`` leads to its middle, or is the direction there.

    An ellipsoid is the disk as which it is seen: ``share`` is the power of that by its own, and ``depth`` the inverse
    of its distance where it is the unit sphere, 0 of what is flat.
    """

    distant: bool
    shape: int
    d: wp.vec3
    radius: float
    a: wp.vec3
    b: wp.vec3
    facing: wp.vec3
    share: float
    depth: float


@wp.func
def light_seen_from(lights: AreaLightArrays, k: int, x: wp.vec3, time: float) -> AreaLight:
    """Light ``k`` from x at ``time`` in the shutter."""
    out = AreaLight()
    place = lights.place[k] + time * lights.place_motion[k]
    out.distant = lights.distant[k] == 1
    out.shape = lights.shape[k]
    out.radius = lights.radius[k] + time * lights.radius_motion[k]
    if out.distant:
        out.d = -wp.normalize(place)
    else:
        out.d = place - x
    out.a = lights.span_a[k] + time * lights.span_a_motion[k]
    out.b = lights.span_b[k] + time * lights.span_b_motion[k]
    out.facing = wp.normalize(lights.facing[k] + time * lights.facing_motion[k])
    out.share = 1.0
    if out.shape == ELLIPSOID:
        c = lights.span_c[k] + time * lights.span_c_motion[k]
        seen = ellipsoid_from(out.a, out.b, c, out.d)
        out.shape = DISK
        out.depth = 1.0 / seen.away
        nearer = 1.0 - out.depth * out.depth
        out.d *= nearer
        out.a = wp.sqrt(nearer) * seen.a
        out.b = wp.sqrt(nearer) * seen.b
        area = wp.cross(out.a, out.b)
        out.facing = wp.normalize(area)
        if wp.dot(out.facing, out.d) > 0.0:
            out.facing = -out.facing
        out.share = wp.length(area) / (out.radius * out.radius)
    return out


@wp.func
def before_surface(light: AreaLight, square: float) -> float:
    """Which part of the way to a place on the disk that stands for an ellipsoid lies before its surface; ``square`` is
    that of the place's distance from the middle of a unit disk."""
    return 1.0 / (1.0 + light.depth * wp.sqrt(wp.max(1.0 - square, 0.0)))


@wp.func
def edge_term(p: wp.vec3, q: wp.vec3, n: wp.vec3) -> float:
    """An edge's part of Lambert's sum: the angle that it subtends, by the cosine of its plane's normal to n."""
    normal = wp.cross(p, q)
    length = wp.length(normal)
    if length <= 0.0:
        return 0.0
    return wp.dot(n, normal) / length * wp.atan2(length, wp.dot(p, q))


@wp.func
def corner(light: AreaLight, number: int) -> wp.vec3:
    """A corner of the polygon that a flat light is, from the point that looks at it."""
    if light.shape == DISK:
        angle = TURN * float(number) / float(EDGES)
        return light.d + EDGE_SCALE * (wp.cos(angle) * light.a + wp.sin(angle) * light.b)
    u = wp.where(number == 0 or number == 3, -1.0, 1.0)
    v = wp.where(number == 0 or number == 1, -1.0, 1.0)
    return light.d + u * light.a + v * light.b


@wp.func
def polygon_irradiance(light: AreaLight, n: wp.vec3) -> float:
    """Irradiance of a flat light of unit radiance by Lambert's formula, cut by the horizon."""
    count = int(4)
    if light.shape == DISK:
        count = int(EDGES)
    total = float(0.0)
    leaves = wp.vec3(0.0, 0.0, 0.0)
    enters = wp.vec3(0.0, 0.0, 0.0)
    cut = bool(False)
    p = corner(light, 0)
    for number in range(count):
        q = corner(light, (number + 1) % count)
        height_p = wp.dot(n, p)
        height_q = wp.dot(n, q)
        if height_p > 0.0 or height_q > 0.0:
            start = p
            end = q
            if height_p <= 0.0:
                start = p + (height_p / (height_p - height_q)) * (q - p)
                enters = start
                cut = True
            if height_q <= 0.0:
                end = p + (height_p / (height_p - height_q)) * (q - p)
                leaves = end
                cut = True
            total += edge_term(start, end, n)
        p = q
    if cut:
        total += edge_term(leaves, enters, n)
    return 0.5 * wp.abs(total)


@wp.func
def disk_irradiance(light: AreaLight, n: wp.vec3) -> float:
    """Irradiance of a circular disk above the horizon, by that of its intensity along its normal: its light vector."""
    z = -wp.dot(light.d, light.facing)
    outward = -light.d - z * light.facing
    rho = wp.length(outward)
    r2 = wp.length_sq(light.a)
    t = rho * rho + z * z - r2
    s = rho * rho + z * z + r2
    q = wp.sqrt(t * t + 4.0 * r2 * z * z)
    axial = float(0.0)
    if t > 0.0:
        axial = 2.0 * z * z / (q * (q + t))
    else:
        axial = 0.5 * (q - t) / (q * r2)
    total = -axial * wp.dot(n, light.facing)
    if rho > 0.0:
        total -= 2.0 * z * rho / (q * (q + s)) * wp.dot(n, outward) / rho
    return total


@wp.func
def cylinder_irradiance(light: AreaLight, n: wp.vec3) -> float:
    """Irradiance of a cylinder by its intensity across its axis: of the flat strip between the lines it is seen by.

    Light of one radiance tells nothing of depth: the strip stands where what is seen of the cylinder does on average,
    so that its ends are those of the side, and is as wide from here.
    """
    axis = wp.normalize(light.a)
    across = light.d - wp.dot(light.d, axis) * axis
    apart = wp.length(across)
    if apart <= light.radius:
        # Before its ends, and within it, nothing is seen of its side.
        return 0.0
    # From afar half of the cylinder is seen, from close by little more than the line that is nearest.
    sine = light.radius / apart
    nearer = 1.0 - sine * wp.lerp(VISIBLE_SIDE, 1.0, sine * sine)
    strip = light
    strip.shape = RECT
    strip.d = light.d - (1.0 - nearer) * across
    half = wp.length(light.a)
    distance = wp.length(strip.d)
    if distance * distance > POINT_FROM * POINT_FROM * (half * half + light.radius * light.radius):
        w = strip.d / distance
        return nearer * wp.max(wp.dot(n, w), 0.0) * wp.length(wp.cross(axis, w)) / (distance * distance)
    sideways = wp.normalize(wp.cross(axis, across))
    strip.b = sideways * (nearer * light.radius / wp.sqrt(1.0 - sine * sine))
    return polygon_irradiance(strip, n) / (4.0 * half * light.radius)


@wp.func
def irradiance_of_nodes(light: AreaLight, n: wp.vec3) -> float:
    """Irradiance of an elliptical disk above the horizon, by that of its intensity along its normal, by seven nodes."""
    total = float(0.0)
    for number in range(7):
        d = light.d
        weight = float(0.25)
        if number < 6:
            turn = TURN / 6.0 * float(number)
            d += NODE_OF_DISC * (wp.cos(turn) * light.a + wp.sin(turn) * light.b)
            weight = 0.125
        square = wp.length_sq(d)
        total -= weight * wp.dot(n, d) * wp.dot(light.facing, d) / (square * square)
    return total


@wp.func
def unshadowed_irradiance(light: AreaLight, n: wp.vec3) -> float:
    """Irradiance of a light that nothing hides, by its power: its largest intensity, or its irradiance."""
    distance = wp.length(light.d)
    cosine = wp.dot(n, light.d) / distance
    if light.shape == ROUND:
        if light.distant:
            return round_irradiance(cosine, 1.0 / light.radius)
        h = wp.max(distance / light.radius, OUTSIDE)
        return round_irradiance(cosine, h) / (h * h * light.radius * light.radius)
    if light.shape == CYLINDER:
        return cylinder_irradiance(light, n)
    height = -wp.dot(light.d, light.facing)
    if height <= 0.0:
        return 0.0
    a2 = wp.length_sq(light.a)
    b2 = wp.length_sq(light.b)
    if distance * distance > POINT_FROM * POINT_FROM * (a2 + b2):
        return wp.max(cosine, 0.0) * height / (distance * distance * distance)
    area = 4.0 * wp.length(wp.cross(light.a, light.b))
    if light.shape == DISK:
        area *= 0.25 * PI
        reach = wp.sqrt(wp.dot(n, light.a) * wp.dot(n, light.a) + wp.dot(n, light.b) * wp.dot(n, light.b))
        if wp.dot(n, light.d) + reach <= 0.0:
            return 0.0
        is_circle = wp.abs(a2 - b2) <= CIRCLE * a2 and wp.abs(wp.dot(light.a, light.b)) <= CIRCLE * a2
        if wp.dot(n, light.d) >= reach and is_circle:
            return disk_irradiance(light, n)
        if wp.dot(n, light.d) >= reach and distance * distance > NODES_FROM * NODES_FROM * wp.max(a2, b2):
            return irradiance_of_nodes(light, n)
    return polygon_irradiance(light, n) / area


@wp.struct
class PlaceOnLight:
    """A place on a light: direction there, distance, and by how much it lights a point, up to a factor."""

    w: wp.vec3
    distance: float
    weight: float


@wp.func
def highest_place(light: AreaLight, n: wp.vec3) -> wp.vec2:
    """The place on a light that stands highest above the horizon, but for a tenth of the light around it."""
    a = light.a
    b = light.b
    if light.shape == ROUND:
        middle = wp.normalize(light.d)
        a = across_of(middle)
        b = wp.cross(middle, a)
    if light.shape == ROUND or light.shape == DISK:
        turn = wp.atan2(wp.dot(n, b), wp.dot(n, a)) / TURN
        return wp.vec2(0.9, turn - wp.floor(turn))
    return wp.vec2(0.5 + 0.45 * wp.sign(wp.dot(n, a)), 0.5 + 0.45 * wp.sign(wp.dot(n, b)))


@wp.func
def place_on_light(light: AreaLight, n: wp.vec3, place: wp.vec2) -> PlaceOnLight:
    """The place on a light at ``place`` in the unit square, whose squares of equal area are lights of equal power."""
    out = PlaceOnLight()
    distance = wp.length(light.d)
    middle = light.d / distance
    radius = wp.sqrt(place[0])
    x = radius * wp.cos(TURN * place[1])
    y = radius * wp.sin(TURN * place[1])
    if light.shape == ROUND:
        sine = light.radius
        out.distance = FAR
        if not light.distant:
            sine = 1.0 / wp.max(distance / light.radius, OUTSIDE)
        across = across_of(middle)
        up = wp.cross(middle, across)
        off = sine * radius
        forward = wp.sqrt(wp.max(1.0 - off * off, 0.0))
        out.w = forward * middle + sine * (x * across + y * up)
        if not light.distant:
            # The surface of the sphere lies before its middle.
            rest = wp.sqrt(wp.max(light.radius * light.radius - distance * distance * off * off, 0.0))
            out.distance = wp.max(distance * forward - rest, 0.0)
        out.weight = wp.max(wp.dot(n, out.w), 0.0) / wp.max(forward, 1.0e-3)
        return out
    d = light.d + x * light.a + y * light.b
    if light.shape != DISK:
        d = light.d + (2.0 * place[0] - 1.0) * light.a
        if light.shape == CYLINDER:
            # On the side that is seen, not about the axis: what stands in a cylinder hides none of it.
            chord = 2.0 * place[1] - 1.0
            axis = wp.normalize(light.a)
            before = wp.normalize(light.d - axis * wp.dot(axis, light.d))
            depth = wp.sqrt(wp.max(1.0 - chord * chord, 0.0))
            d += light.radius * (chord * wp.cross(axis, before) - depth * before)
        else:
            d += (2.0 * place[1] - 1.0) * light.b
    out.distance = wp.length(d)
    out.w = d / out.distance
    emitted = -wp.dot(out.w, light.facing)
    if light.shape == CYLINDER:
        emitted = wp.length(wp.cross(wp.normalize(light.a), out.w))
    out.weight = wp.max(wp.dot(n, out.w), 0.0) * wp.max(emitted, 0.0) / (out.distance * out.distance)
    if light.depth > 0.0:
        out.distance *= before_surface(light, place[0])
    return out


@wp.func
def within(place: wp.vec2) -> wp.vec2:
    """A place moved into the unit square by whole numbers."""
    return wp.vec2(place[0] - wp.floor(place[0]), place[1] - wp.floor(place[1]))


@cache
def area_irradiance(share: wp.Function, linked: bool = False) -> wp.Function:
    """The function that sums what lights with extent send to a point.

    Args:
        share: What part of the light from a place on a light is counted, as in
            :func:`tpdwarp.view.lights.point_irradiance`.
        linked: Whether lights are linked to some objects only.
    """

    @wp.func
    def irradiance(
        surfaces: Surfaces,
        textures: TextureArrays,
        lights: AreaLightArrays,
        x: wp.vec3,
        n: wp.vec3,
        n_g: wp.vec3,
        offset: wp.vec3,
        place: wp.vec2,
        object: int,
    ) -> wp.vec3:
        total = wp.vec3(0.0, 0.0, 0.0)
        for k in range(lights.power.shape[0]):
            light = light_seen_from(lights, k, x, surfaces.time)
            mean = unshadowed_irradiance(light, n)
            row = int(0)
            if wp.static(linked):
                row = lights.link_row[k]
                if (lights.links[row, object] & UNLIT) != 0:
                    mean = 0.0
            if mean > 0.0:
                counted = float(0.0)
                whole = float(0.0)
                strata = int(STRATA)
                if light.distant and light.radius <= NARROW:
                    strata = 1
                for number in range(strata * strata + 1):
                    cell = wp.vec2(float(number % strata), float(number // strata))
                    if number < strata * strata:
                        there = place_on_light(light, n, (cell + within(place)) / float(strata))
                    elif whole == 0.0:
                        # All of them lie below the horizon, which does not hide all of the light.
                        there = place_on_light(light, n, highest_place(light, n))
                    else:
                        break
                    whole += there.weight
                    if there.weight > 0.0 and wp.dot(n_g, there.w) > 0.0:
                        part = share(surfaces, textures, lights.links, row, x, there.w, offset, there.distance)
                        if part > 0.0:
                            counted += there.weight * part * shaped(lights.shaping[k], light.facing, -there.w)
                if counted > 0.0:
                    total += lights.power[k] * (light.share * mean * counted / whole)
        return total

    return irradiance
