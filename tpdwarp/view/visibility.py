"""Visibility: visible points on diffuse surfaces, through and in specular ones, and the direct light there.

Camera paths branch at dielectrics as photons do (see :mod:`tpdwarp.photons.branching`); of faint branches, samples of a
pixel share those that they follow (:mod:`tpdwarp.view.shared_branches`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntFlag
from functools import cache

import numpy as np
import warp as wp

from tpdwarp.compiler_flags import calls_inlined, own_module
from tpdwarp.device import Launcher
from tpdwarp.footprints.irradiance import QueryArrays
from tpdwarp.photons.beam import Beam, interface_at, passed, relative_index, scatter, transfer_to
from tpdwarp.photons.branching import MOST_DECISIONS, first_open_decision, reported_paths, take_branch, take_share
from tpdwarp.photons.differentials import reflect
from tpdwarp.photons.rough_lobes import behind_sheet, facet
from tpdwarp.photons.thin_walls import sheet_index, sheet_reflectance
from tpdwarp.scene.description import Interaction
from tpdwarp.scene.device.geometry import Surfaces
from tpdwarp.scene.device.intersection import Hit, along, closest_hit, diffuse_color, shading_normal
from tpdwarp.scene.device.media import crossing_at, media_at
from tpdwarp.scene.device.presence import presence_over
from tpdwarp.scene.device.textures import (
    TextureArrays,
    absorbed_in_media,
    absorbed_within,
    diffuse_share_at,
    emission_at,
    mapped_normal,
    metal_at,
    mirror_tint,
    on_plane,
    roughness_at,
    textured_color,
    transmittance_at,
)
from tpdwarp.scene.requirements import Requirements
from tpdwarp.settings import ViewSettings
from tpdwarp.view.area_lights import OF_LIGHTS, AreaLightArrays, area_irradiance, within
from tpdwarp.view.camera import Camera, camera_ray, kept_by_planes, through_lens
from tpdwarp.view.domes import DomeArrays, dome_irradiance, dome_radiance
from tpdwarp.view.ggx import lobe_at, mirrored_by_a_facet, share_of_facet
from tpdwarp.view.glossy_lights import area_reflection, dome_reflection, lights_along, point_reflection
from tpdwarp.view.lights import FAR, LightArrays, point_irradiance, share_that_arrives
from tpdwarp.view.shared_branches import MOST_FOR_OTHERS, follows, samples_served
from tpdwarp.view.surface_aovs import SURFACE_AOVS, SurfaceArrays, SurfaceExtras, find_surfaces, surface_extras
from tpdwarp.view.view_state import KEPT_STATES, ViewState, keep_state, kept_rows, view_state

# Reflected branches of camera paths that carry less than this are not followed: one step of eight bits (1/255).
SMALLEST_THROUGHPUT = ViewSettings.view_cutoff
# Where glass moves past, a pixel's view can race over the receiver. Faster than this, in scenes of unit size a shutter,
# the differential says nothing any more. Chosen, not derived.
FASTEST_QUERY = wp.constant(0.25)
# A diffuse BRDF is albedo/π.
INV_PI = wp.constant(0.3183098861837907)
DIFFUSE = wp.constant(int(Interaction.DIFFUSE))
DIELECTRIC = wp.constant(int(Interaction.DIELECTRIC))
# Random numbers that choose places on the lens, and facets, are others than those that keep rays off edges.
OF_LENS = wp.constant(104729)
OF_FACETS = wp.constant(1299709)
# Width α of the lobe of the roughest mirror, and what lights in mirrors are blurred by that rough metal shows.
WIDEST_MIRROR = wp.constant(0.09)
TURN = wp.constant(6.283185307179586)


class PathFlag(IntFlag):
    """What is to be known of a camera path."""

    MET_MOTION = 1  # met a surface that moves, and may be another path at other times
    TOO_FAST = 2  # races over the receiver, and is slowed down
    NOT_FINITE = 4  # has a motion that is none, and counts as at rest
    CULLED = 8  # had a branch below the cutoff
    OFF_METAL = 16  # comes from rough metal, which has seen lights and domes
    TURNED = 32  # was reflected or refracted


# Kernels know no enumerations.
MET_MOTION = wp.constant(int(PathFlag.MET_MOTION))
TOO_FAST = wp.constant(int(PathFlag.TOO_FAST))
NOT_FINITE = wp.constant(int(PathFlag.NOT_FINITE))
CULLED = wp.constant(int(PathFlag.CULLED))
OFF_METAL = wp.constant(int(PathFlag.OFF_METAL))
TURNED = wp.constant(int(PathFlag.TURNED))
# What goes on with a branch.
INHERITED = wp.constant(int(PathFlag.MET_MOTION | PathFlag.OFF_METAL | PathFlag.TURNED))


@wp.struct
class VisibleArrays:
    """One row a camera path. ``weight`` turns irradiance into radiance: throughput · albedo/π; of a path that leaves
    the scene through surfaces that are there in part, and met nothing else, it is the share that it leaves by.

    ``flags`` are those of :class:`PathFlag`; position, normal and triangle of what was met first are those of paths
    that start at the camera.
    ``albedo`` and ``triangle`` are those of the surface where the path ends, ``first_triangle`` is what it met first;
    they have rows only where AOVs ask for them.
    """

    weight: wp.array(dtype=wp.vec3)
    direct: wp.array(dtype=wp.vec3)
    flags: wp.array(dtype=wp.int32)
    reported: wp.array(dtype=wp.int32)
    first_position: wp.array(dtype=wp.vec3)
    first_normal: wp.array(dtype=wp.vec3)
    first_depth: wp.array(dtype=wp.float32)
    albedo: wp.array(dtype=wp.vec3)
    triangle: wp.array(dtype=wp.int32)
    first_triangle: wp.array(dtype=wp.int32)


@wp.func
def place_for(film: wp.vec2) -> wp.vec2:
    """Where on lights a camera sample looks: its place in the pixel, moved by a random step that the pixel has."""
    column = wp.floor(film[0])
    row = wp.floor(film[1])
    chance = wp.rand_init(int(OF_LIGHTS), int(column) * 65537 + int(row))
    return wp.vec2(film[0] - column + wp.randf(chance), film[1] - row + wp.randf(chance))


@wp.func
def facet_for(film: wp.vec2, sample: int, bounce: int) -> wp.vec2:
    """Which facet of rough metal a camera sample looks at: those of a pixel are spread evenly (Roberts 2018), moved by
    random steps, which those that choose places on lights know nothing of."""
    chance = wp.rand_init(int(OF_FACETS) + bounce, int(wp.floor(film[0])) * 65537 + int(wp.floor(film[1])))
    u = wp.randf(chance) + 0.754877666 * float(sample)
    v = wp.randf(chance) + 0.569840291 * float(sample)
    return within(wp.vec2(u, v))


@wp.func
def query_motion(motion: wp.vec3) -> wp.vec3:
    """How a pixel's view moves over the receiver, no faster than ``FASTEST_QUERY``; at rest where that is unknown."""
    speed = wp.length(motion)
    if not wp.isfinite(speed):
        return wp.vec3(0.0, 0.0, 0.0)
    if speed > FASTEST_QUERY:
        return motion * (FASTEST_QUERY / speed)
    return motion


@wp.func
def faced_normal(surfaces: Surfaces, hit: Hit, n_g: wp.vec3, moves: bool) -> wp.vec3:
    """The shading normal, faced to the viewer as ``n_g`` is, also where it was authored against the winding."""
    n = shading_normal(surfaces, hit, False, moves).n
    if wp.dot(n, n_g) < 0.0:
        return -n
    return n


@cache
def visible_kernel(
    moves: bool,
    refraction: bool,
    reflection: bool,
    smooth_receivers: bool,
    textured: bool = False,
    nested: bool = False,
    domed: bool = False,
    named: bool = False,
    partial: bool = False,
    tinted: bool = False,
    lens: bool = False,
    emission: bool = False,
    extended: bool = False,
    linked: bool = False,
    thin_walls: bool = False,
    rough: bool = False,
    clipped: bool = False,
    normal_maps: bool = False,
    mapped: bool = False,
    metals: bool = False,
    glints: bool = False,
    mirrored_lights: bool = False,
) -> wp.Kernel:
    """The kernel that follows one camera path to the diffuse surface it ends on; ``named`` notes which that is."""
    both, specular, branches = refraction and reflection, refraction or reflection, refraction or partial or metals
    placed = textured or mapped or partial or metals
    arrives = share_that_arrives(linked, partial)
    from_points, from_areas = point_irradiance(arrives, linked), area_irradiance(arrives, linked)
    # To make functions takes a while: only those that are called.
    off_points = point_reflection(arrives, linked) if metals or glints else None
    off_areas = area_reflection(arrives, linked) if metals and extended else None
    # In mirrors, meshes that shine are seen themselves.
    glint_of_areas = area_reflection(arrives, linked, False) if glints and extended else None
    seen_in_mirrors = lights_along(arrives, linked) if mirrored_lights else None

    @wp.kernel(**own_module(calls_inlined()))
    def see(
        base: int,
        in_turn: int,
        # Scene
        surfaces: Surfaces,
        lights: LightArrays,
        area_lights: AreaLightArrays,
        camera: Camera,
        textures: TextureArrays,
        domes: DomeArrays,
        # In
        films: wp.array(dtype=wp.vec2),
        items: wp.array(dtype=wp.int32),
        masks: wp.array(dtype=wp.int32),
        rows: wp.array(dtype=wp.int32),
        sources: wp.array(dtype=wp.int32),
        states_before: wp.array(dtype=ViewState),
        bounces: int,
        smallest_throughput: float,
        segments: float,
        radiance_power: float,
        sample_side: float,
        samples: int,
        most_for_others: float,
        # Out
        queries: QueryArrays,
        out: VisibleArrays,
        states: wp.array(dtype=ViewState),
    ):
        first_tid = base + wp.tid() * in_turn
        for tid in range(first_tid, first_tid + in_turn):
            i = rows[tid]

            item = items[tid]
            mask = masks[tid]
            first_open = first_open_decision(mask)
            reported = int(0)
            kept = int(0)
            branch_of = int(-1)
            if wp.static(branches):
                if sources.shape[0] > 0:
                    branch_of = sources[tid]
            beam = Beam()
            throughput = wp.vec3(1.0, 1.0, 1.0)
            stream = wp.rand_init(7919, item)
            start = float(0.0)
            end = float(FAR)
            passed_by = float(0.0)
            travelled = float(0.0)
            depth_scale = float(0.0)
            straight = bool(True)
            inside = int(0)
            decision = int(0)
            first_bounce = int(0)
            flags = int(0)
            queries.receiver[i] = -1
            out.first_depth[i] = -1.0
            mirrored = wp.vec3(0.0, 0.0, 0.0)
            blurred = float(0.0)
            if wp.static(named):
                out.first_triangle[i] = -1
            if branch_of >= 0:
                # ---- It branches from another path
                resumed = states_before[branch_of]
                beam = resumed.beam
                throughput = resumed.throughput
                stream = resumed.stream
                start = resumed.start
                end = resumed.end
                passed_by = resumed.passed_by
                travelled = resumed.travelled
                depth_scale = resumed.depth_scale
                out.first_depth[i] = resumed.depth
                inside = resumed.inside
                decision = resumed.decision
                first_bounce = resumed.bounce
                flags = resumed.flags
                if (flags & OFF_METAL) != 0:
                    blurred = WIDEST_MIRROR
            else:
                # ---- The camera's ray
                beam = camera_ray(camera, films[item], surfaces.time)
                if wp.static(lens):
                    chance = wp.rand_init(int(OF_LENS), item)
                    radius = wp.sqrt(wp.randf(chance))
                    beam = through_lens(camera, beam, surfaces.time, radius, TURN * wp.randf(chance))
                depth_scale = -wp.dot(beam.w, wp.normalize(camera.back + surfaces.time * camera.back_motion))
                # The origin lies in what is specular: an eye close to it looks at what may be tiny beside the scene.
                closeness = wp.max(wp.abs(beam.x)) + 1.0e-9
                beam.magnitude = wp.min(surfaces.magnitude, wp.vec3(closeness, closeness, closeness))
                start = camera.near / depth_scale
                end = camera.far / depth_scale
                if wp.static(clipped):
                    between = kept_by_planes(camera, beam.x, beam.w, surfaces.time, start, end)
                    start = between[0]
                    end = between[1]
                if wp.static(nested):
                    inside = media_at(surfaces, along(beam.x, beam.w, start), beam.w)

            for bounce in range(first_bounce, bounces + 1):
                if wp.static(clipped):
                    if end <= start:
                        if wp.static(domed):
                            out.direct[i] = wp.cw_mul(throughput, dome_radiance(domes, beam.w))
                        break
                if wp.static(partial):
                    # ---- Where another share of the surface acts, a path begins here
                    state = view_state(
                        beam, throughput, stream, start, end, passed_by, travelled, depth_scale, out.first_depth[i],
                        inside, decision, bounce, flags & INHERITED,
                    )  # fmt: skip
                # ---- Transfer to the next surface
                hit = closest_hit(
                    surfaces, beam.x, beam.w, beam.offset, beam.magnitude, start, end, wp.static(moves), stream
                )
                if hit.triangle < 0:
                    if wp.static(domed):
                        if (flags & OFF_METAL) == 0:
                            out.direct[i] = wp.cw_mul(throughput, dome_radiance(domes, beam.w))
                    if wp.static(partial):
                        if straight and branch_of < 0:
                            out.weight[i] = throughput
                    break
                across = wp.vec3(0.0, 0.0, 0.0)
                down = wp.vec3(0.0, 0.0, 0.0)
                if wp.static(placed):
                    # What a sample stands for is taken to be as wide as it would be without what bent its ray.
                    travelled += hit.distance
                    width = sample_side
                    if camera.orthographic == 0:
                        width *= travelled * depth_scale
                    across = on_plane(width * camera.pixel[0] * camera.right, beam.w, hit.n_g)
                    down = on_plane(width * camera.pixel[1] * camera.up, beam.w, hit.n_g)
                if wp.static(nested and tinted):
                    throughput = wp.cw_mul(throughput, absorbed_in_media(textures, inside, hit.distance))
                if wp.static(partial):
                    # ---- What is not there is seen through
                    share = presence_over(surfaces, textures, hit, across, down)
                    part = take_share(mask, decision, first_open, share, throughput, smallest_throughput)
                    throughput = part.throughput
                    reported = reported | part.reported
                    if part.reported != 0:
                        kept = keep_state(states, tid, kept, state)
                    decision += part.decided
                    if part.decided == 1 and out.first_depth[i] < 0.0:
                        out.first_position[i] = hit.position
                        out.first_normal[i] = -wp.sign(wp.dot(hit.n_g, beam.w)) * hit.n_g
                        out.first_depth[i] = (passed_by + hit.distance) * depth_scale
                        if wp.static(named):
                            out.first_triangle[i] = hit.triangle
                    if not part.reflected:
                        passed_by += hit.distance
                        beam = passed(transfer_to(beam, hit, False, wp.static(moves)), hit)
                        start = 0.0
                        end = FAR
                        continue
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
                            beam = passed(transfer_to(beam, hit, False, wp.static(moves)), hit)
                            start = 0.0
                            end = FAR
                            continue
                beam = transfer_to(beam, hit, False, wp.static(moves))
                if wp.static(moves):
                    if wp.length_sq(hit.motion) > 0.0:
                        flags = flags | MET_MOTION
                n_g = -wp.sign(wp.dot(hit.n_g, beam.w)) * hit.n_g
                first = bounce == 0
                if wp.static(nested or partial):
                    # Before it, there may have been surfaces that are not there.
                    first = out.first_depth[i] < 0.0
                if first:
                    out.first_position[i] = beam.x
                    out.first_normal[i] = faced_normal(surfaces, hit, n_g, wp.static(moves))
                    if wp.static(named):
                        out.first_triangle[i] = hit.triangle
                    depth = hit.distance
                    if wp.static(nested or partial):
                        depth += passed_by
                    out.first_depth[i] = depth * depth_scale
                material = surfaces.material_of[hit.triangle]
                interaction = surfaces.interaction[material]
                if wp.static(partial):
                    diffuse = textures.diffuse_shares[material]
                    if wp.static(mapped):
                        diffuse = diffuse_share_at(textures, material, hit, across, down)
                    part = take_share(mask, decision, first_open, diffuse, throughput, smallest_throughput)
                    throughput = part.throughput
                    reported = reported | part.reported
                    if part.reported != 0:
                        kept = keep_state(states, tid, kept, state)
                    decision += part.decided
                    if part.reflected:
                        interaction = DIFFUSE

                # ---- A diffuse surface ends the path: direct light, and a query for the photons'
                if interaction == DIFFUSE:
                    n = faced_normal(surfaces, hit, n_g, wp.static(moves))
                    albedo = diffuse_color(surfaces, hit)
                    if wp.static(textured):
                        albedo = textured_color(textures, material, hit, albedo, across, down)
                        if wp.static(normal_maps):
                            n = mapped_normal(textures, material, hit, n, across, down)
                    weight = wp.cw_mul(throughput, albedo) * INV_PI
                    object = surfaces.object_of[hit.triangle]
                    offset = hit.offset * n_g
                    metal = float(0.0)
                    if wp.static(metals):
                        metal = metal_at(textures, material, hit, across, down)
                        if metal > 0.0:
                            # ---- Rough metal: what other surfaces send off one of its facets is a branch
                            width = roughness_at(textures, material, hit, across, down)
                            lobe = lobe_at(n, -beam.w, width, albedo)
                            facing = mirrored_by_a_facet(lobe, facet_for(films[item], item % samples, bounce))
                            if decision < MOST_DECISIONS and bounce < bounces and wp.dot(n_g, facing) > 0.0:
                                off = wp.cw_mul(metal * throughput, share_of_facet(lobe, facing))
                                mirror = interface_at(surfaces, hit, beam.w, False, 1.0, wp.static(moves))
                                mirror.n = wp.normalize(facing - beam.w)
                                turned = scatter(beam, hit, mirror, True, False, wp.static(moves))
                                served = samples_served(off, samples, most_for_others)
                                bit = 1 << decision
                                if (mask & bit) != 0:
                                    # It is the branch, begun at the camera again.
                                    throughput = float(served) * off
                                    beam = turned
                                    flags = flags | OFF_METAL | TURNED
                                    blurred = WIDEST_MIRROR
                                    decision += 1
                                    straight = False
                                    start = 0.0
                                    end = FAR
                                    continue
                                if decision >= first_open and wp.max(off) >= smallest_throughput:
                                    if follows(films[item], item % samples, mask | bit, served):
                                        reported = reported | bit
                                        of_branch = view_state(
                                            turned, float(served) * off, stream, 0.0, FAR, passed_by, travelled,
                                            depth_scale, out.first_depth[i], inside, decision + 1, bounce + 1,
                                            (flags & MET_MOTION) | OFF_METAL | TURNED,
                                        )  # fmt: skip
                                        kept = keep_state(states, tid, kept, of_branch)
                    irradiance = wp.vec3(0.0, 0.0, 0.0)
                    if metal < 1.0:
                        irradiance = from_points(surfaces, textures, lights, beam.x, n, n_g, offset, object)
                        if wp.static(extended):
                            irradiance += from_areas(
                                surfaces, textures, area_lights, beam.x, n, n_g, offset, place_for(films[item]), object
                            )
                        if wp.static(domed):
                            # Neighbours in the image choose other parts of the dome.
                            scattered = wp.randf(stream) + 0.754877666 * films[item][0] + 0.569840291 * films[item][1]
                            place = scattered - wp.floor(scattered)
                            irradiance += dome_irradiance(
                                surfaces, textures, wp.static(partial), domes, beam.x, n, n_g, offset, place
                            )
                    direct = wp.cw_mul(weight, irradiance)
                    if wp.static(metals):
                        if metal > 0.0:
                            glossy = off_points(surfaces, textures, lights, lobe, beam.x, n_g, offset, object)
                            if wp.static(extended):
                                glossy += off_areas(
                                    surfaces, textures, area_lights, lobe, beam.x, n_g, offset, place_for(films[item]),
                                    object,
                                )  # fmt: skip
                            if wp.static(domed):
                                glossy += dome_reflection(
                                    surfaces, textures, wp.static(partial), domes, lobe, beam.x, n_g, offset,
                                    place_for(films[item]),
                                )  # fmt: skip
                            direct = (1.0 - metal) * direct + metal * wp.cw_mul(throughput, glossy)
                    if wp.static(named):
                        out.albedo[i] = albedo
                        out.triangle[i] = hit.triangle
                    out.weight[i] = weight
                    out.direct[i] = direct
                    if wp.static(emission):
                        shining = textures.emissions[material]
                        if wp.static(textured):
                            shining = emission_at(textures, material, hit, across, down)
                        if wp.static(metals):
                            if (flags & OFF_METAL) != 0 and textures.lamps[material] == 1:
                                shining = wp.vec3(0.0, 0.0, 0.0)
                        out.direct[i] += wp.cw_mul(throughput, shining)
                    queries.receiver[i] = object
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
                    straight = False
                    flags = flags | TURNED
                    dielectric = wp.static(refraction)
                    if wp.static(both):
                        dielectric = interaction == DIELECTRIC
                    if wp.static(refraction and not nested):
                        if dielectric:
                            eta = relative_index(surfaces, hit, beam.w)
                    sheet = bool(False)
                    if wp.static(thin_walls):
                        sheet = dielectric and textures.thin_walls[material] == 1
                        if sheet:
                            eta = sheet_index(surfaces, material)
                    at = interface_at(surfaces, hit, beam.w, dielectric, eta, wp.static(moves))
                    smooth = at.n
                    u = float(0.0)
                    v = float(0.0)
                    roughness = float(0.0)
                    if wp.static(rough):
                        u = wp.randf(stream)
                        v = wp.randf(stream)
                        roughness = textures.roughnesses[material]
                        if wp.static(mapped):
                            roughness = roughness_at(textures, material, hit, across, down)
                        if roughness > 0.0:
                            at = facet(at, hit, beam.w, dielectric, roughness, u, v)
                    reflected = True
                    if dielectric:
                        if wp.static(tinted):
                            contained = at.side < 0.0
                            if wp.static(nested):
                                # That of nested media is taken along the way.
                                contained = contained and surfaces.medium_of[surfaces.object_of[hit.triangle]] < 0
                            if contained:
                                throughput = wp.cw_mul(throughput, absorbed_within(textures, material, hit.distance))
                        reflectance = float(at.reflectance)
                        if wp.static(thin_walls):
                            if sheet:
                                reflectance = sheet_reflectance(reflectance)
                        branch = take_branch(mask, decision, first_open, reflectance, throughput, smallest_throughput)
                        reflected = branch.reflected
                        throughput = branch.throughput
                        if reflected and branch.decided != 0:
                            throughput *= float(samples_served(throughput, samples, most_for_others))
                        if not reflected:
                            if not sheet:
                                throughput = throughput * wp.pow(at.eta, radiance_power)
                            if wp.static(tinted):
                                passing = textures.transmittances[material]
                                if wp.static(mapped):
                                    passing = transmittance_at(textures, material, hit, across, down)
                                throughput = wp.cw_mul(throughput, passing)
                        if branch.reported != 0:
                            served = samples_served(branch.other, samples, most_for_others)
                            if follows(films[item], item % samples, mask | branch.reported, served):
                                reported = reported | branch.reported
                                # ---- What is reflected goes on from here
                                other = scatter(beam, hit, at, True, False, wp.static(moves))
                                of_branch = view_state(
                                    other, float(served) * branch.other, stream, 0.0, FAR, passed_by, travelled,
                                    depth_scale, out.first_depth[i], inside, decision + 1, bounce + 1,
                                    (flags & MET_MOTION) | TURNED,
                                )  # fmt: skip
                                kept = keep_state(states, tid, kept, of_branch)
                        if wp.max(branch.culled) > 0.0:
                            flags = flags | CULLED
                        decision += branch.decided
                    else:
                        tint = surfaces.tint[material]
                        if wp.static(mapped):
                            tint = mirror_tint(textures, material, hit, tint, across, down)
                        if wp.static(glints or mirrored_lights):
                            # ---- Lights in it; a path that is begun again to branch later on has seen them
                            if decision >= first_open:
                                object = surfaces.object_of[hit.triangle]
                                offset = hit.offset * n_g
                                shown = wp.vec3(0.0, 0.0, 0.0)
                                # Few of the facets that see another mirror find the lights in it: these are as blurred
                                # as the way there is (Kaplanyan and Dachsbacher 2013).
                                blurred = wp.max(blurred, roughness)
                                if wp.static(mirrored_lights):
                                    if blurred == 0.0:
                                        w = reflect(beam.w, smooth)
                                        seen = seen_in_mirrors(
                                            surfaces, textures, area_lights, beam.x, w, offset, object
                                        )  # fmt: skip
                                        shown = wp.cw_mul(tint, seen)
                                if wp.static(glints):
                                    if blurred > 0.0:
                                        lobe = lobe_at(smooth, -beam.w, blurred, tint)
                                        shown = off_points(
                                            surfaces, textures, lights, lobe, beam.x, n_g, offset, object
                                        )  # fmt: skip
                                        if wp.static(extended):
                                            shown += glint_of_areas(
                                                surfaces, textures, area_lights, lobe, beam.x, n_g, offset,
                                                place_for(films[item]), object,
                                            )  # fmt: skip
                                mirrored += wp.cw_mul(throughput, shown)
                        throughput = wp.cw_mul(throughput, tint)
                    if wp.static(metals):
                        if reflected:
                            flags = flags & ~OFF_METAL
                    if wp.static(nested):
                        if not reflected:
                            inside = beyond
                    start = 0.0
                    end = FAR
                    if sheet and not reflected:
                        beam = passed(beam, hit)
                        if wp.static(rough):
                            beam.w = behind_sheet(beam.w, surfaces.ior[material], roughness, u, v)
                    else:
                        beam = scatter(beam, hit, at, reflected, False, wp.static(moves))
                else:
                    break

            if wp.static(glints or mirrored_lights):
                out.direct[i] += mirrored
            out.reported[i] = reported
            out.flags[i] = flags

    return see


@dataclass
class VisiblePoints:
    """Camera paths of one pass, one row each: ``items`` index the film positions they start from.

    Attributes:
        items: Shape [n].
        queries: Where they ended; the receiver is −1 where that is no diffuse surface.
        arrays: What they carry.
        first: Whether they are the first paths of their film positions.
        surfaces: What AOVs ask for besides; None where none do.
    """

    items: np.ndarray
    queries: QueryArrays
    arrays: VisibleArrays
    first: bool
    surfaces: SurfaceArrays | None = None

    @property
    def turned(self) -> np.ndarray:
        """1 for paths that were reflected or refracted, else 0, shape [n] int32."""
        return (self.arrays.flags.numpy() & PathFlag.TURNED) // PathFlag.TURNED

    @property
    def extras(self) -> SurfaceExtras | None:
        """What AOVs ask for besides, on the host."""
        return None if self.surfaces is None else surface_extras(self.arrays.albedo, self.surfaces)

    @classmethod
    def empty(
        cls, items: np.ndarray, smooth_receivers: bool, aovs: tuple[str, ...], first: bool, launcher: Launcher
    ) -> VisiblePoints:
        """Rows for the paths of ``items``, which are still to be followed."""
        named = bool(set(aovs) & set(SURFACE_AOVS))
        left_out = () if smooth_receivers else ("shading_normal",)
        unnamed = () if named else ("albedo", "triangle", "first_triangle")
        queries = launcher.rows(QueryArrays, len(items), but=left_out)
        arrays = launcher.rows(VisibleArrays, len(items), but=unnamed)
        surfaces = launcher.rows(SurfaceArrays, len(items)) if named else None
        return cls(items, queries, arrays, first, surfaces)


def visible_points(
    surfaces: Surfaces,
    lights: LightArrays,
    area_lights: AreaLightArrays,
    camera: Camera,
    films: wp.array,
    items: np.ndarray,
    requirements: Requirements,
    launcher: Launcher,
    *,
    moves: bool,
    into: VisiblePoints | None = None,
    segments: int = 1,
    scales_radiance: bool = True,
    textures: TextureArrays | None = None,
    domes: DomeArrays | None = None,
    samples: int = 1,
    smallest_throughput: float = SMALLEST_THROUGHPUT,
    aovs: tuple[str, ...] = (),
    rays: int = 1,
) -> Iterator[VisiblePoints]:
    """Follows camera rays; one batch a pass, refracted paths first.

    Args:
        films: Film positions [pixels], vec2.
        items: Which of them to look through, shape [n] int32.
        moves: Whether queries carry their motion.
        into: Takes the first paths, which are not given back then: it has a row for each of ``films``.
        segments: Segments of the shutter; scene and camera are those of one of them.
        scales_radiance: Whether radiance changes by η² = (η_i/η_t)² where it is refracted, as it does (a beam of it is
            narrower inside); without, as hosts that leave it out have it. Through closed glass it cancels.
        textures: The textures of the surfaces, where there are any.
        domes: Light from all around, where there is any.
        samples: Samples a pixel; textures are averaged over the part of it that each stands for.
        smallest_throughput: Reflected branches that carry less are not followed.
        aovs: Channel groups wanted beside the beauty.
        rays: How many of ``films`` stand for each of these.
    """
    masks = np.zeros(len(items), np.int32)
    sources, states = np.zeros(0, np.int32), launcher.zeros(0, ViewState)
    needs = requirements
    branches = needs.refraction or needs.partial or needs.metals
    kernel = visible_kernel(
        moves,
        needs.refraction,
        needs.reflection,
        needs.smooth_receivers,
        textured=needs.textures,
        nested=needs.nested,
        domed=needs.domes,
        named=bool(set(aovs) & set(SURFACE_AOVS)),
        partial=needs.partial,
        tinted=needs.tinted,
        lens=needs.lens,
        emission=needs.emission,
        extended=bool(needs.extended_lights),
        linked=needs.linked,
        thin_walls=needs.thin_walls,
        rough=needs.rough,
        clipped=needs.clipped,
        normal_maps=needs.normal_maps,
        mapped=needs.specular_maps,
        metals=needs.metals,
        glints=needs.glints,
        mirrored_lights=needs.mirrored_lights,
    )
    first = True
    while len(items):
        here = first and into is not None
        out = into if here else VisiblePoints.empty(items, needs.smooth_receivers, aovs, first, launcher)
        rows = items if here else np.arange(len(items), dtype=np.int32)
        device_rows = launcher.array(rows, wp.int32)
        kept = launcher.zeros(0, ViewState)
        if branches:
            # Taken up only as it is written.
            kept = launcher.empty(len(items) * KEPT_STATES, ViewState)
        paths = [launcher.array(items, wp.int32), launcher.array(masks, wp.int32), device_rows]
        paths += [launcher.array(sources, wp.int32), states]
        lit = [surfaces, lights, area_lights, camera]
        scene = [*lit, textures or TextureArrays(), domes or DomeArrays(), films]
        limits = [needs.bounces, smallest_throughput, float(segments), 2.0 if scales_radiance else 0.0]
        sharing = [(samples * rays) ** -0.5, samples * rays, MOST_FOR_OTHERS * rays]
        inputs = [*scene, *paths, *limits, *sharing, out.queries, out.arrays, kept]
        launcher(kernel, len(items), inputs, in_turn=True)
        if out.surfaces is not None:
            found = out.queries, out.arrays, device_rows
            find_surfaces(*lit, *found, aovs, launcher, moves, segments, out.surfaces)
        if not here:
            yield out
        reported = out.arrays.reported.numpy()[rows]
        items, masks = reported_paths(items, masks, reported)
        sources, states = kept_rows(reported), kept
        first = False
