"""Where a ray meets the scene: the hit, the surface's motion there, its shading normal and how that varies."""

import warp as wp

from tpdwarp.scene.device.geometry import Surfaces
from tpdwarp.scene.device.ray_offset import ray_offset
from tpdwarp.scene.device.ray_tree import first_met

# A ray starts a little off the surface it leaves, on the side it leaves to, and is shifted sideways by less than that
# (a part of the coordinates of the triangle at hand, some 16 units in their last place), because rays that pass exactly
# through vertices and edges can slip between triangles; the hit is then found by intersecting the true ray with the
# triangle's plane.
SHIFT = wp.constant(1.0e-6)
# Below this cosine a plane is too nearly along the ray to say where they meet: it is the rounding of a direction.
GRAZING = wp.constant(1.0e-7)
# Planes within this cosine of each other (0.08°) are parallel: float32 normals of fine meshes are no more exact.
COPLANAR = wp.constant(0.999999)
# What lies in the plane just left is at most this part of its own ray offset off it: four half units in the last place.
OWN_PLANE = wp.constant(0.06)
# A ray that meets the plane again that it left starts anew so many times farther off; seven times at most, by which the
# offset has grown from rounding of the triangle's coordinates to its size.
OFFSET_GROWTH = wp.constant(8.0)
MOST_ATTEMPTS = wp.constant(8)


@wp.struct
class Hit:
    """A point of a triangle: position, unit geometric normal (not flipped), motion, dual basis g1, g2 of its edges.

    ``offset`` is how far off it rays have to start that leave it, ``magnitude`` how large its coordinates are along
    each axis, ``retried`` is 1 where it was missed at first.
    """

    triangle: int
    distance: float
    position: wp.vec3
    n_g: wp.vec3
    motion: wp.vec3
    beta: wp.vec3
    g1: wp.vec3
    g2: wp.vec3
    offset: float
    magnitude: wp.vec3
    retried: int


@wp.struct
class ShadingNormal:
    """Interpolated normal N = Σ β_i n_i: unit n, |N|, and what D_a N needs (n_1 − n_0, n_2 − n_0, Σ β_i D_t n_i)."""

    n: wp.vec3
    length: float
    along1: wp.vec3
    along2: wp.vec3
    rate: wp.vec3


@wp.func
def along(x: wp.vec3, w: wp.vec3, distance: float) -> wp.vec3:
    """x + λω in double precision, for rays that are long beside what they hit."""
    return wp.vec3(wp.vec3d(x) + wp.float64(distance) * wp.vec3d(w))


@wp.struct
class TrianglePlane:
    """The plane of a triangle in double precision, which long thin triangles need.

    ``area`` is e1 × e2, ``length`` its length. ``offset`` and ``magnitude`` are as in :class:`Hit`.
    """

    origin: wp.vec3d
    e1: wp.vec3d
    e2: wp.vec3d
    area: wp.vec3d
    length: wp.float64
    inverse: wp.float64
    n_g: wp.vec3
    offset: float
    magnitude: wp.vec3


@wp.func
def plane_of(surfaces: Surfaces, face: int) -> TrianglePlane:
    """The plane of triangle ``face``."""
    plane = TrianglePlane()
    corner = surfaces.triangles[face]
    q0 = surfaces.points[corner[0]]
    q1 = surfaces.points[corner[1]]
    q2 = surfaces.points[corner[2]]
    plane.origin = wp.vec3d(q0)
    plane.e1 = wp.vec3d(q1) - plane.origin
    plane.e2 = wp.vec3d(q2) - plane.origin
    plane.area = wp.cross(plane.e1, plane.e2)
    square = wp.dot(plane.area, plane.area)
    plane.length = wp.sqrt(square)
    plane.inverse = wp.float64(1.0) / square
    plane.n_g = wp.vec3(plane.area * (plane.length * plane.inverse))
    magnitude = wp.max(wp.max(wp.abs(q0), wp.abs(q1)), wp.abs(q2))
    edges = wp.abs(q1 - q0) + wp.abs(q2 - q0)
    size = edges[0] + edges[1] + edges[2]
    plane.offset = ray_offset(plane.n_g, magnitude, size)
    plane.magnitude = magnitude + wp.vec3(1.0e-3, 1.0e-3, 1.0e-3) * size
    return plane


@wp.func
def is_plane_left(plane: TrianglePlane, x: wp.vec3, side: wp.vec3, offset: float) -> bool:
    """Whether ``plane`` is the one that a ray has just left at x: parallel to it, and within the ray's offset.

    Args:
        side: Unit normal of the plane left, zero for a ray that comes from nowhere.
        offset: How far off it the ray started.
    """
    height = wp.dot(plane.area, wp.vec3d(x) - plane.origin)
    tolerance = wp.max(offset, OWN_PLANE * plane.offset)
    return wp.abs(wp.dot(side, plane.n_g)) > COPLANAR and wp.abs(height) < plane.length * wp.float64(tolerance)


@wp.func
def closest_hit(
    surfaces: Surfaces,
    x: wp.vec3,
    w: wp.vec3,
    offset: wp.vec3,
    magnitude: wp.vec3,
    start: float,
    end: float,
    moves: bool,
    stream: wp.uint32,
) -> Hit:
    """First surface along x + λω for λ in [start, end]; ``triangle`` is −1 where there is none.

    Where the ray meets the triangle's plane is found in double precision: long thin triangles need it. A ray that finds
    the plane again that it just left starts anew from farther off.
    """
    hit = Hit()
    hit.triangle = -1
    side = wp.normalize(offset)
    offset_length = wp.length(offset)
    farther = float(1.0)
    missed = int(0)
    attempt = int(0)
    while hit.triangle < 0 and missed < 2 and attempt < MOST_ATTEMPTS:
        attempt += 1
        shift = wp.vec3(wp.randf(stream) - 0.5, wp.randf(stream) - 0.5, wp.randf(stream) - 0.5)
        shift = SHIFT * wp.cw_mul(shift, magnitude)
        shift = shift - wp.dot(shift, side) * side
        origin = along(x, w, start) + farther * offset + shift
        met = first_met(surfaces.tree, origin, w, end - start)
        if met.triangle < 0:
            missed += 1
        else:
            plane = plane_of(surfaces, met.triangle)
            if is_plane_left(plane, x, side, offset_length):
                farther *= OFFSET_GROWTH
            elif wp.isfinite(plane.inverse):
                from_corner = wp.vec3d(x) - plane.origin
                # Both times the area; the plane's normal itself need not be known in double precision.
                height = wp.dot(plane.area, from_corner)
                cosine = wp.dot(plane.area, wp.vec3d(w))
                distance = wp.float64(start + met.distance)
                if wp.abs(cosine) > wp.float64(GRAZING) * plane.length:
                    distance = -height / cosine
                from_corner = from_corner + distance * wp.vec3d(w)
                g1 = wp.cross(plane.e2, plane.area) * plane.inverse
                g2 = wp.cross(plane.area, plane.e1) * plane.inverse
                b1 = wp.dot(g1, from_corner)
                b2 = wp.dot(g2, from_corner)
                hit.triangle = met.triangle
                hit.retried = missed
                hit.distance = float(distance)
                hit.position = wp.vec3(plane.origin + from_corner)
                hit.n_g = plane.n_g
                hit.g1 = wp.vec3(g1)
                hit.g2 = wp.vec3(g2)
                hit.beta = wp.vec3(wp.float32(wp.float64(1.0) - b1 - b2), wp.float32(b1), wp.float32(b2))
                hit.offset = plane.offset
                hit.magnitude = plane.magnitude
                if moves:
                    corner = surfaces.triangles[met.triangle]
                    hit.motion = (
                        hit.beta[0] * surfaces.motions[corner[0]]
                        + hit.beta[1] * surfaces.motions[corner[1]]
                        + hit.beta[2] * surfaces.motions[corner[2]]
                    )
    return hit


@wp.func
def hit_on(surfaces: Surfaces, triangle: int, beta: wp.vec3, moves: bool) -> Hit:
    """The point of a triangle with barycentric coordinates β, as if a ray had met it there (without what rays need)."""
    hit = Hit()
    hit.triangle = triangle
    hit.beta = beta
    corners = surfaces.triangles[triangle]
    p0 = surfaces.points[corners[0]]
    p1 = surfaces.points[corners[1]]
    p2 = surfaces.points[corners[2]]
    hit.position = beta[0] * p0 + beta[1] * p1 + beta[2] * p2
    e1 = p1 - p0
    e2 = p2 - p0
    area = wp.cross(e1, e2)
    inverse = 1.0 / wp.max(wp.dot(area, area), 1.0e-30)
    hit.n_g = wp.normalize(area)
    hit.g1 = wp.cross(e2, area) * inverse
    hit.g2 = wp.cross(area, e1) * inverse
    if moves:
        m0 = surfaces.motions[corners[0]]
        m1 = surfaces.motions[corners[1]]
        m2 = surfaces.motions[corners[2]]
        hit.motion = beta[0] * m0 + beta[1] * m1 + beta[2] * m2
    return hit


@wp.func
def occluded(surfaces: Surfaces, x: wp.vec3, w: wp.vec3, offset: wp.vec3, distance: float) -> bool:
    """Whether anything stands between x and x + distance·ω, but for the plane that x lies on.

    A ray offset that goes with the coordinates vanishes in the planes x = 0, y = 0, z = 0 and may be too small for
    large triangles there. So what a ray from a surface meets first is looked at: the plane just left hides nothing, and
    the ray starts anew from farther off. Asking beforehand whether it meets anything costs as much and saves nothing.
    """
    offset_length = wp.length(offset)
    side = wp.normalize(offset)
    farther = float(1.0)
    for _attempt in range(MOST_ATTEMPTS):
        met = first_met(surfaces.tree, x + farther * offset, w, distance)
        if met.triangle < 0:
            return False
        if not is_plane_left(plane_of(surfaces, met.triangle), x, side, offset_length):
            return True
        farther *= OFFSET_GROWTH
    return False


@wp.func
def shading_normal(surfaces: Surfaces, hit: Hit, flat: bool, moves: bool) -> ShadingNormal:
    """The interpolated normal at ``hit``, or the geometric one with its own motion (``flat``, or none authored)."""
    s = ShadingNormal()
    index = surfaces.normal_indices[hit.triangle]
    if index[0] >= 0 and not flat:
        n0 = surfaces.normals[index[0]]
        n1 = surfaces.normals[index[1]]
        n2 = surfaces.normals[index[2]]
        if moves:
            r0 = surfaces.normal_motions[index[0]]
            r1 = surfaces.normal_motions[index[1]]
            r2 = surfaces.normal_motions[index[2]]
            n0 = n0 + surfaces.time * r0
            n1 = n1 + surfaces.time * r1
            n2 = n2 + surfaces.time * r2
            s.rate = hit.beta[0] * r0 + hit.beta[1] * r1 + hit.beta[2] * r2
        N = hit.beta[0] * n0 + hit.beta[1] * n1 + hit.beta[2] * n2
        s.length = wp.length(N)
        if s.length > 1.0e-6:
            s.n = N / s.length
            s.along1 = n1 - n0
            s.along2 = n2 - n0
            return s
    s.n = hit.n_g
    s.length = 1.0
    s.along1 = wp.vec3(0.0, 0.0, 0.0)
    s.along2 = wp.vec3(0.0, 0.0, 0.0)
    s.rate = wp.vec3(0.0, 0.0, 0.0)
    if moves:
        corner = surfaces.triangles[hit.triangle]
        q0 = surfaces.points[corner[0]]
        m0 = surfaces.motions[corner[0]]
        e1 = surfaces.points[corner[1]] - q0
        e2 = surfaces.points[corner[2]] - q0
        rate = wp.cross(surfaces.motions[corner[1]] - m0, e2) + wp.cross(e1, surfaces.motions[corner[2]] - m0)
        s.rate = rate / wp.length(wp.cross(e1, e2))
    return s


@wp.func
def normal_variation(s: ShadingNormal, hit: Hit, drift: wp.vec3) -> wp.vec3:
    """Σ_j (n_j − n_0) D_a β_j for a point that drifts by D_a x' − δ q̇ over the triangle."""
    return s.along1 * wp.dot(hit.g1, drift) + s.along2 * wp.dot(hit.g2, drift)


@wp.func
def diffuse_color(surfaces: Surfaces, hit: Hit) -> wp.vec3:
    """Albedo at ``hit``: display colours where the mesh has them, else the material's."""
    index = surfaces.color_indices[hit.triangle]
    if index[0] >= 0:
        color = (
            hit.beta[0] * surfaces.colors[index[0]]
            + hit.beta[1] * surfaces.colors[index[1]]
            + hit.beta[2] * surfaces.colors[index[2]]
        )
        # On an edge a coordinate may round to less than zero, and so would a colour that is zero there.
        return wp.max(color, wp.vec3(0.0, 0.0, 0.0))
    return surfaces.tint[surfaces.material_of[hit.triangle]]
