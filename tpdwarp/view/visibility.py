"""Visibility: visible points on diffuse surfaces, through and in specular ones, and the direct light there.

Camera paths branch at dielectrics as photons do (see :mod:`tpdwarp.photons.branching`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntFlag
from functools import cache

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.footprints.irradiance import QueryArrays
from tpdwarp.photons.beam import interface_at, passed, relative_index, scatter, transfer_to
from tpdwarp.photons.branching import first_open_decision, reported_paths, take_branch
from tpdwarp.scene.description import Interaction, LightAtShutter, LightKind
from tpdwarp.scene.device.geometry import Surfaces
from tpdwarp.scene.device.intersection import along, closest_hit, diffuse_color, occluded, shading_normal
from tpdwarp.scene.device.media import crossing_at, media_at
from tpdwarp.scene.device.textures import TextureArrays, on_plane, textured_color
from tpdwarp.scene.normalization import Normalization
from tpdwarp.scene.requirements import Requirements
from tpdwarp.settings import ViewSettings
from tpdwarp.view.camera import Camera, camera_ray
from tpdwarp.view.domes import DomeArrays, dome_irradiance, dome_radiance

# Reflected branches of camera paths that carry less than this are not followed: one step of eight bits (1/255).
SMALLEST_THROUGHPUT = ViewSettings.view_cutoff
# Where glass moves past, a pixel's view can race over the receiver. Faster than this, in scenes of unit size a shutter,
# the differential says nothing any more. Chosen, not derived.
FASTEST_QUERY = wp.constant(0.25)
# A diffuse BRDF is albedo/π.
INV_PI = wp.constant(0.3183098861837907)
DIFFUSE = wp.constant(int(Interaction.DIFFUSE))
DIELECTRIC = wp.constant(int(Interaction.DIELECTRIC))
# Rays end there, in the tracer's units, in which the scene is of unit size, as photons' do.
FAR = wp.constant(1.0e6)


@wp.struct
class LightArrays:
    """Lights in the tracer's units: direction of travel or position, and how these change over the shutter.

    ``power`` is irradiance at normal incidence per square unit, or radiant intensity.
    """

    distant: wp.array(dtype=wp.int32)
    place: wp.array(dtype=wp.vec3)
    place_motion: wp.array(dtype=wp.vec3)
    power: wp.array(dtype=wp.vec3)


class PathFlag(IntFlag):
    """What is to be known of a camera path."""

    MET_MOTION = 1  # met a surface that moves, and may be another path at other times
    TOO_FAST = 2  # races over the receiver, and is slowed down
    NOT_FINITE = 4  # has a motion that is none, and counts as at rest
    CULLED = 8  # had a branch below the cutoff


# Kernels know no enumerations.
MET_MOTION = wp.constant(int(PathFlag.MET_MOTION))
TOO_FAST = wp.constant(int(PathFlag.TOO_FAST))
NOT_FINITE = wp.constant(int(PathFlag.NOT_FINITE))
CULLED = wp.constant(int(PathFlag.CULLED))


@wp.struct
class VisibleArrays:
    """One row a camera path. ``weight`` turns irradiance into radiance: throughput · albedo/π.

    ``flags`` are those of :class:`PathFlag`.
    """

    weight: wp.array(dtype=wp.vec3)
    direct: wp.array(dtype=wp.vec3)
    flags: wp.array(dtype=wp.int32)
    reported: wp.array(dtype=wp.int32)
    first_position: wp.array(dtype=wp.vec3)
    first_normal: wp.array(dtype=wp.vec3)
    first_depth: wp.array(dtype=wp.float32)


def light_arrays(lights: tuple[LightAtShutter, ...], normalization: Normalization, launcher: Launcher) -> LightArrays:
    """The kernel's view of ``lights``."""
    out = LightArrays()
    distant = np.array([light.kind == LightKind.DISTANT for light in lights], bool)
    place, motion, power = (np.zeros((len(lights), 3)) for _ in range(3))
    for i, light in enumerate(lights):
        power[i] = normalization.light_power(light)
        if distant[i]:
            place[i], motion[i] = -light.axes[2], -light.axes_motion[2]
        else:
            place[i] = normalization.points(light.position[None])[0]
            motion[i] = light.position_motion * normalization.scale
    out.distant = launcher.array(distant.astype(np.int32), wp.int32)
    out.place = launcher.array(place.astype(np.float32), wp.vec3)
    out.place_motion = launcher.array(motion.astype(np.float32), wp.vec3)
    out.power = launcher.array(power.astype(np.float32), wp.vec3)
    return out


@wp.func
def direct_irradiance(
    surfaces: Surfaces, lights: LightArrays, x: wp.vec3, n: wp.vec3, n_g: wp.vec3, offset: wp.vec3
) -> wp.vec3:
    """Irradiance from lights that nothing hides; whatever is specular hides them too (its light comes as photons).

    The cosine is that of the shading normal ``n``; what the surface itself hides, ``n_g`` decides.
    """
    total = wp.vec3(0.0, 0.0, 0.0)
    for k in range(lights.power.shape[0]):
        place = lights.place[k] + surfaces.time * lights.place_motion[k]
        if lights.distant[k] == 1:
            w = -wp.normalize(place)
            cosine = wp.dot(n, w)
            if cosine > 0.0 and wp.dot(n_g, w) > 0.0:
                if not occluded(surfaces, x, w, offset, FAR):
                    total += lights.power[k] * cosine
        else:
            d = place - x
            distance = wp.length(d)
            w = d / distance
            cosine = wp.dot(n, w)
            if cosine > 0.0 and wp.dot(n_g, w) > 0.0:
                if not occluded(surfaces, x, w, offset, distance):
                    total += lights.power[k] * (cosine / (distance * distance))
    return total


@wp.func
def query_motion(motion: wp.vec3) -> wp.vec3:
    """How a pixel's view moves over the receiver, no faster than ``FASTEST_QUERY``; at rest where that is unknown."""
    speed = wp.length(motion)
    if not wp.isfinite(speed):
        return wp.vec3(0.0, 0.0, 0.0)
    if speed > FASTEST_QUERY:
        return motion * (FASTEST_QUERY / speed)
    return motion


@cache
def visible_kernel(
    moves: bool,
    refraction: bool,
    reflection: bool,
    smooth_receivers: bool,
    textured: bool = False,
    nested: bool = False,
    domed: bool = False,
) -> wp.Kernel:
    """The kernel that follows one camera path to the diffuse surface it ends on."""
    both, specular = refraction and reflection, refraction or reflection

    @wp.kernel(module="unique", enable_backward=False)
    def see(
        base: int,
        # Scene
        surfaces: Surfaces,
        lights: LightArrays,
        camera: Camera,
        textures: TextureArrays,
        domes: DomeArrays,
        # In
        films: wp.array(dtype=wp.vec2),
        items: wp.array(dtype=wp.int32),
        masks: wp.array(dtype=wp.int32),
        bounces: int,
        smallest_throughput: float,
        segments: float,
        radiance_power: float,
        sample_side: float,
        # Out
        queries: QueryArrays,
        out: VisibleArrays,
    ):
        i = base + wp.tid()

        # ---- The camera's ray
        item = items[i]
        stream = wp.rand_init(7919, item)
        beam = camera_ray(camera, films[item], surfaces.time)
        depth_scale = -wp.dot(beam.w, wp.normalize(camera.back + surfaces.time * camera.back_motion))
        # The origin lies in what is specular: an eye close to it looks at what may be tiny beside the scene.
        closeness = wp.max(wp.abs(beam.x)) + 1.0e-9
        beam.magnitude = wp.min(surfaces.magnitude, wp.vec3(closeness, closeness, closeness))
        start = camera.near / depth_scale
        end = camera.far / depth_scale
        if wp.static(nested):
            passed_by = float(0.0)
            inside = media_at(surfaces, along(beam.x, beam.w, start), beam.w)
        throughput = wp.vec3(1.0, 1.0, 1.0)
        mask = masks[i]
        first_open = first_open_decision(mask)
        reported = int(0)
        flags = int(0)
        decision = int(0)
        travelled = float(0.0)
        queries.receiver[i] = -1
        out.first_depth[i] = -1.0

        for bounce in range(bounces + 1):
            # ---- Transfer to the next surface
            hit = closest_hit(
                surfaces, beam.x, beam.w, beam.offset, beam.magnitude, start, end, wp.static(moves), stream
            )
            if hit.triangle < 0:
                if wp.static(domed):
                    out.direct[i] = wp.cw_mul(throughput, dome_radiance(domes, beam.w))
                break
            if wp.static(textured):
                travelled += hit.distance
            # ---- What another solid displaces is not there
            eta = float(1.0)
            if wp.static(nested):
                beyond = int(inside)
                if surfaces.interaction[surfaces.material_of[hit.triangle]] == DIELECTRIC:
                    crossing = crossing_at(surfaces, hit, beam.w, inside)
                    eta = crossing.eta
                    beyond = crossing.beyond
                    if crossing.nothing:
                        inside = beyond
                        passed_by += hit.distance
                        beam = passed(transfer_to(beam, hit, wp.static(moves)), hit)
                        start = 0.0
                        end = FAR
                        continue
            beam = transfer_to(beam, hit, wp.static(moves))
            if wp.static(moves):
                if wp.length_sq(hit.motion) > 0.0:
                    flags = flags | MET_MOTION
            side = -wp.sign(wp.dot(hit.n_g, beam.w))
            n_g = side * hit.n_g
            n = shading_normal(surfaces, hit, False, wp.static(moves)).n
            # Faced to the viewer, as the geometric normal is, also where it was authored against the winding.
            if wp.dot(n, n_g) < 0.0:
                n = -n
            first = bounce == 0
            if wp.static(nested):
                # Before it, there may have been surfaces that are not there.
                first = out.first_depth[i] < 0.0
            if first:
                out.first_position[i] = beam.x
                out.first_normal[i] = n
                depth = hit.distance
                if wp.static(nested):
                    depth += passed_by
                out.first_depth[i] = depth * depth_scale
            material = surfaces.material_of[hit.triangle]
            interaction = surfaces.interaction[material]

            # ---- A diffuse surface ends the path: direct light, and a query for the photons'
            if interaction == DIFFUSE:
                albedo = diffuse_color(surfaces, hit)
                if wp.static(textured):
                    # What a sample stands for is taken to be as wide as it would be without what bent its ray.
                    width = sample_side
                    if camera.orthographic == 0:
                        width *= travelled * depth_scale
                    across = on_plane(width * camera.pixel[0] * camera.right, beam.w, hit.n_g)
                    down = on_plane(width * camera.pixel[1] * camera.up, beam.w, hit.n_g)
                    albedo = textured_color(textures, material, hit, albedo, across, down)
                weight = wp.cw_mul(throughput, albedo) * INV_PI
                irradiance = direct_irradiance(surfaces, lights, beam.x, n, n_g, hit.offset * n_g)
                if wp.static(domed):
                    # Neighbours in the image choose other parts of the dome.
                    scattered = wp.randf(stream) + 0.754877666 * films[item][0] + 0.569840291 * films[item][1]
                    place = scattered - wp.floor(scattered)
                    irradiance += dome_irradiance(surfaces, domes, beam.x, n, n_g, hit.offset * n_g, place)
                out.weight[i] = weight
                out.direct[i] = wp.cw_mul(weight, irradiance)
                queries.receiver[i] = surfaces.object_of[hit.triangle]
                queries.normal[i] = n_g
                if wp.static(smooth_receivers):
                    queries.shading_normal[i] = n
                queries.position[i] = beam.x
                if wp.static(moves):
                    speed = wp.length(segments * beam.dxdt)
                    if not wp.isfinite(speed):
                        flags = flags | NOT_FINITE
                    elif speed > FASTEST_QUERY:
                        flags = flags | TOO_FAST
                    queries.motion[i] = query_motion(segments * beam.dxdt)
                break

            # ---- Reflection or refraction
            if wp.static(specular):
                if bounce == bounces:
                    break
                dielectric = wp.static(refraction)
                if wp.static(both):
                    dielectric = interaction == DIELECTRIC
                if wp.static(refraction and not nested):
                    if dielectric:
                        eta = relative_index(surfaces, hit, beam.w)
                at = interface_at(surfaces, hit, beam.w, dielectric, eta, wp.static(moves))
                reflected = True
                if dielectric:
                    branch = take_branch(mask, decision, first_open, at.reflectance, throughput, smallest_throughput)
                    reflected = branch.reflected
                    throughput = branch.throughput
                    if not reflected:
                        throughput = throughput * wp.pow(at.eta, radiance_power)
                    reported = reported | branch.reported
                    if wp.max(branch.culled) > 0.0:
                        flags = flags | CULLED
                    decision += branch.decided
                else:
                    throughput = wp.cw_mul(throughput, surfaces.tint[material])
                if wp.static(nested):
                    if not reflected:
                        inside = beyond
                beam = scatter(surfaces, beam, hit, at, reflected, wp.static(moves))
                start = 0.0
                end = FAR
            else:
                break

        out.reported[i] = reported
        out.flags[i] = flags

    return see


@dataclass
class VisiblePoints:
    """Camera paths of one pass: ``items`` index the film positions they start from; queries where they ended."""

    items: np.ndarray
    queries: QueryArrays
    arrays: VisibleArrays
    first: bool


def visible_points(
    surfaces: Surfaces,
    lights: LightArrays,
    camera: Camera,
    films: np.ndarray,
    requirements: Requirements,
    launcher: Launcher,
    *,
    moves: bool,
    segments: int = 1,
    scales_radiance: bool = True,
    textures: TextureArrays | None = None,
    domes: DomeArrays | None = None,
    samples: int = 1,
    smallest_throughput: float = SMALLEST_THROUGHPUT,
) -> Iterator[VisiblePoints]:
    """Follows camera rays through ``films`` [n, 2] (pixels); one batch a pass, refracted paths first.

    Args:
        moves: Whether queries carry their motion.
        segments: Segments of the shutter; scene and camera are those of one of them.
        scales_radiance: Whether radiance changes by η² = (η_i/η_t)² where it is refracted, as it does (a beam of it is
            narrower inside); without, as hosts that leave it out have it. Through closed glass it cancels.
        textures: The textures of the surfaces, where there are any.
        domes: Light from all around, where there is any.
        samples: Samples a pixel; textures are averaged over the part of it that each stands for.
        smallest_throughput: Reflected branches that carry less are not followed.
    """
    items = np.arange(len(films), dtype=np.int32)
    masks = np.zeros(len(films), np.int32)
    device_films = launcher.array(films.astype(np.float32), wp.vec2)
    needs = requirements
    kernel = visible_kernel(
        moves,
        needs.refraction,
        needs.reflection,
        needs.smooth_receivers,
        textured=needs.textures,
        nested=needs.nested,
        domed=needs.domes,
    )
    left_out = () if needs.smooth_receivers else ("shading_normal",)
    first = True
    while len(items):
        queries, out = launcher.rows(QueryArrays, len(items), but=left_out), launcher.rows(VisibleArrays, len(items))
        paths = [launcher.array(items, wp.int32), launcher.array(masks, wp.int32)]
        scene = [surfaces, lights, camera, textures or TextureArrays(), domes or DomeArrays(), device_films]
        limits = [needs.bounces, smallest_throughput, float(segments), 2.0 if scales_radiance else 0.0]
        launcher(kernel, len(items), [*scene, *paths, *limits, samples**-0.5, queries, out])
        yield VisiblePoints(items, queries, out, first)
        items, masks = reported_paths(items, masks, out.reported.numpy())
        first = False
