"""Tracing photons with their differentials through specular surfaces to the diffuse surface where they land.

A thread follows some paths and what branches from them (see :mod:`tpdwarp.photons.branching` and :mod:`.path_regions`),
one after the other: emission, transfer to the next surface (Eqs. 3 and 4 of the paper), reflection or refraction there,
until a diffuse surface takes it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import warp as wp

from tpdwarp.compiler_flags import calls_inlined, own_module
from tpdwarp.device import Launcher
from tpdwarp.photons.beam import Beam, Interface, interface_at, passed, relative_index, scatter, transfer_to
from tpdwarp.photons.branching import first_open_decision, take_branch, take_share
from tpdwarp.photons.differentials import riding_shift
from tpdwarp.photons.dispersion import Band, bands_of
from tpdwarp.photons.emission import ChosenCells, Patch, cell_flux, emit, leaving
from tpdwarp.photons.energy import EnergyAccount
from tpdwarp.photons.fates import (
    FATE_DEPOSITED,
    FATE_DEPTH,
    FATE_DIRECT,
    FATE_ESCAPED,
    FATE_NONFINITE,
    Fate,
    FluxSums,
    add_sums,
    channel_sum,
    with_path,
)
from tpdwarp.photons.lattices import EmissionPlan, Lattice
from tpdwarp.photons.light_columns import (
    FluxOfPlaces,
    LightColumns,
    centroid_shift,
    columns_at,
    flux_of_directions,
    flux_of_places,
    from_visible_side,
    mean_reflectance,
    scatter_columns,
    shaping_of_place,
    transfer_columns,
)
from tpdwarp.photons.path_regions import (
    SPARE,
    VERTICES,
    PathQueue,
    PathRegions,
    WaitingPaths,
    add_branch,
    as_they_lie,
    given_to,
    hand_over,
    row_of,
)
from tpdwarp.photons.path_state import path_state
from tpdwarp.photons.photon_map import MOST_VERTICES, PhotonMap, joined
from tpdwarp.photons.rough_lobes import widened, widened_by_sheet
from tpdwarp.photons.thin_walls import sheet_index, sheet_reflectance
from tpdwarp.scene.description import Interaction, SceneAtShutter
from tpdwarp.scene.device.geometry import Geometry, Surfaces
from tpdwarp.scene.device.intersection import Hit, along, closest_hit, occluded
from tpdwarp.scene.device.links import PASSED, UNLIT, links_of
from tpdwarp.scene.device.media import crossing_at, media_at
from tpdwarp.scene.device.presence import presence_over
from tpdwarp.scene.device.textures import (
    TextureArrays,
    absorbed_in_media,
    absorbed_within,
    diffuse_share_at,
    mirror_tint,
    roughness_at,
    transmittance_at,
)
from tpdwarp.scene.nesting import nesting_of
from tpdwarp.scene.requirements import Requirements
from tpdwarp.settings import LightSettings

# Reflected branches below this part of the emitted flux are given up and accounted as lost. Chosen, not derived: half a
# step of eight bits.
SMALLEST_BRANCH = LightSettings.branch_cutoff
# Light is followed through so many interactions however little is left, then as long as that is above the cutoff.
# Chosen, not derived.
FIRST_INTERACTIONS = wp.constant(8)
DIFFUSE = wp.constant(int(Interaction.DIFFUSE))
DIELECTRIC = wp.constant(int(Interaction.DIELECTRIC))
# Cells whose photons are traced together, which limits memory: with states of what branches they take some 200 MB.
BLOCK = 1 << 17
# Rays end there, in the tracer's units, in which the scene is of unit size. From so far away a rounding of a direction
# (6e-8) misses by a sixteenth of the scene, so that nothing farther off can be met.
FAR = wp.constant(1.0e6)


@wp.struct
class PhotonArrays:
    """One row a path, in the tracer's units; ``dxdt`` is the world displacement over the photon's own (sub-)shutter.

    All but ``fate`` is of paths that are deposited.
    """

    position: wp.array(dtype=wp.vec3)
    normal: wp.array(dtype=wp.vec3)
    dxdu: wp.array(dtype=wp.vec3)
    dxdv: wp.array(dtype=wp.vec3)
    dxdt: wp.array(dtype=wp.vec3)
    receiver_motion: wp.array(dtype=wp.vec3)
    flux: wp.array(dtype=wp.vec3)
    emission: wp.array(dtype=wp.vec2)
    shift: wp.array(dtype=wp.vec2)
    receiver: wp.array(dtype=wp.int32)
    bounces: wp.array(dtype=wp.int32)
    path: wp.array(dtype=wp.uint32)
    share: wp.array(dtype=wp.float32)
    incidence: wp.array(dtype=wp.vec3)
    dxda: wp.array(dtype=wp.vec3)
    dxdb: wp.array(dtype=wp.vec3)
    image: wp.array(dtype=wp.int32)
    fate: wp.array(dtype=wp.int32)


@dataclass(frozen=True)
class TracingVariant:
    """What the tracing kernel is compiled for."""

    moves: bool
    refraction: bool
    reflection: bool
    riding: bool
    jittered: bool
    smooth_receivers: bool
    nested: bool = False
    partial: bool = False
    tinted: bool = False
    recording: bool = False
    extended: bool = False
    linked: bool = False
    thin_walls: bool = False
    rough: bool = False
    specular_maps: bool = False

    @property
    def branches(self) -> bool:
        """Whether paths may branch at all."""
        return self.refraction or self.partial


@wp.func
def prolonged(path: wp.uint32, step: int) -> wp.uint32:
    """The number of a path (its FNV-1a hash) that goes on by ``step``."""
    return (path ^ wp.uint32(step)) * wp.uint32(16777619)


@wp.func
def start_of(surfaces: Surfaces, patch: Patch, x: wp.vec3, w: wp.vec3, offset: wp.vec3) -> float:
    """Where along a beam to begin: what is tiny is met from nearby, unless something stands before it.

    The rounding of a ray goes with its length, so that rays from afar miss what is small beside that.
    """
    start = patch.start
    if patch.domain == 1:
        start = wp.max(start, leaving(patch, w))
    if patch.near > start:
        if not occluded(surfaces, along(x, w, start), w, offset, patch.near - start):
            start = patch.near
    return start


@wp.func
def meets_nothing(surfaces: Surfaces, beam: Beam, stream: wp.uint32) -> bool:
    """Whether light that leaves a surface leaves the scene.

    Most that is reflected off the outside of solids and off open water does: it needs no row, whose memory costs more
    than a ray.
    """
    return closest_hit(surfaces, beam.x, beam.w, beam.offset, beam.magnitude, 0.0, FAR, False, stream).triangle < 0


@cache
def tracing_kernel(variant: TracingVariant) -> wp.Kernel:
    """The kernel that traces the paths of a region and all that branches from them, specialised by what the scene
    requires."""
    moves, refraction, jittered = variant.moves, variant.refraction, variant.jittered
    both, riding = variant.refraction and variant.reflection, variant.riding and variant.moves
    smooth_receivers, nested = variant.smooth_receivers, variant.nested
    partial, tints, recording, extended = variant.partial, variant.tinted, variant.recording, variant.extended
    linked, thin_walls, rough, branches = variant.linked, variant.thin_walls, variant.rough, variant.branches
    mapped = variant.specular_maps

    @wp.func
    def columns_after(
        columns: LightColumns,
        before: wp.vec3,
        after: wp.vec3,
        hit: Hit,
        at: Interface,
        reflected: bool,
        roughness: float,
    ) -> LightColumns:
        """The columns D_a, D_b of light behind an interface, a rough one too (beyond the paper)."""
        out = scatter_columns(columns, before, hit, at, reflected)
        if wp.static(rough):
            if roughness > 0.0:
                out = widened(out, before, after, at, reflected, roughness)
        return out

    @wp.kernel(**own_module(calls_inlined()))
    def trace_photons(
        base: int,
        in_turn: int,
        # Scene
        surfaces: Surfaces,
        textures: TextureArrays,
        patches: wp.array(dtype=Patch),
        first_cells: wp.array(dtype=wp.int32),
        # In
        offsets: wp.array(dtype=wp.vec2),
        tags: wp.array(dtype=wp.int32),
        links: wp.array2d(dtype=wp.int32),
        sources: wp.array(dtype=wp.int32),
        waiting: PathQueue,
        bounces: int,
        smallest_branch: float,
        seed: int,
        # Out
        out: PhotonArrays,
        paths: PathQueue,
        sums: wp.array(dtype=FluxSums),
    ):
        first = base + wp.tid() * in_turn
        for region in range(first, first + in_turn):
            own = given_to(paths, region)
            for k in range(own):
                hand_over(waiting, sources[region * paths.given + k], paths, row_of(paths, region, k))
            used = int(own)
            done = int(0)
            sum = FluxSums()
            while done < used and used - own + wp.static(SPARE if branches else 0) <= paths.room:
                i = row_of(paths, region, done)
                done += 1
                # ---- Emission
                number = wp.lower_bound(first_cells, paths.cell[i] + 1) - 1
                patch = patches[number]
                cell = paths.cell[i] - first_cells[number]
                index_u = patch.first_u + cell % patch.count_u
                index_v = patch.first_v + cell // patch.count_u
                stream = wp.rand_init(seed, index_u * 65537 + index_v)
                place_in_cell = wp.vec2(0.5, 0.5)
                if wp.static(jittered):
                    place_in_cell = wp.vec2(wp.randf(stream), wp.randf(stream))
                coordinates = wp.vec2(float(index_u), float(index_v)) + place_in_cell
                place = coordinates
                if offsets.shape[0] > 0:
                    place += offsets[paths.cell[i]]
                beam = emit(patch, place)
                emitted = cell_flux(patch, place)
                flux = emitted
                absorbed = wp.vec3(0.0, 0.0, 0.0)
                culled = wp.vec3(0.0, 0.0, 0.0)
                entering = wp.vec3(0.0, 0.0, 0.0)
                mask = paths.mask[i]
                first_open = first_open_decision(mask)
                cutoff = smallest_branch * wp.max(emitted)
                fate = int(FATE_DEPTH)
                count = int(0)
                decision = int(0)
                retried = int(0)
                path = wp.uint32(1)
                columns = LightColumns()
                shift = wp.vec2(0.0, 0.0)
                first_bounce = int(0)
                start = float(0.0)
                inside = int(0)
                # Outside the cone of a light there is nothing to follow.
                dark = wp.max(emitted) <= 0.0
                resumes = int(0)
                if wp.static(branches):
                    resumes = paths.resumes[i]
                if resumes == 1:
                    # ---- It branches from another path
                    resumed = paths.states[i]
                    beam = resumed.beam
                    columns = resumed.columns
                    emitted = resumed.emitted
                    flux = resumed.flux
                    shift = resumed.shift
                    path = resumed.path
                    start = resumed.start
                    inside = resumed.inside
                    decision = resumed.decision
                    count = resumed.count
                    first_bounce = resumed.bounce
                else:
                    start = start_of(surfaces, patch, beam.x, beam.w, beam.offset)
                    beam.magnitude = patch.magnitude
                    if wp.static(recording):
                        paths.vertices[i * VERTICES] = along(beam.x, beam.w, start)
                    if wp.static(nested):
                        # Light from afar begins outside of everything.
                        if patch.domain == 1:
                            inside = media_at(surfaces, along(beam.x, beam.w, leaving(patch, beam.w)), beam.w)

                for bounce in range(first_bounce, bounces + 1):
                    if dark:
                        fate = FATE_DIRECT
                        break
                    if wp.static(partial):
                        # ---- Where another share of the surface acts, a path begins here
                        state = path_state(
                            beam, columns, emitted, flux, shift, path, start, inside, decision, count, bounce
                        )
                    # ---- Transfer to the next surface (Eqs. 3, 4)
                    hit = closest_hit(
                        surfaces, beam.x, beam.w, beam.offset, beam.magnitude, start, FAR, wp.static(moves), stream
                    )
                    if hit.triangle < 0:
                        if count > 0:
                            fate = FATE_ESCAPED
                        else:
                            fate = FATE_DIRECT
                        break
                    retried += hit.retried
                    if wp.static(nested and tints):
                        left = wp.cw_mul(flux, absorbed_in_media(textures, inside, hit.distance))
                        if decision >= first_open:
                            absorbed += flux - left
                        flux = left
                    if wp.static(linked):
                        # ---- What the light passes, or does not shine on
                        link = links[number, surfaces.object_of[hit.triangle]]
                        takes = surfaces.interaction[surfaces.material_of[hit.triangle]] == DIFFUSE and count > 0
                        # What throws no shadow is lit all the same, by light that others bend too.
                        if (link & PASSED) != 0 and ((link & UNLIT) != 0 or not takes):
                            beam = passed(transfer_to(beam, hit, True, wp.static(moves)), hit)
                            if wp.static(extended):
                                columns = transfer_columns(columns, beam.w, hit)
                            start = 0.0
                            continue
                        if (link & UNLIT) != 0:
                            if count == 0:
                                fate = FATE_DIRECT
                            else:
                                absorbed += flux
                            flux = wp.vec3(0.0, 0.0, 0.0)
                            break
                    if wp.static(partial):
                        # ---- What is not there lets light pass, and is no part of its path
                        there = transfer_to(beam, hit, True, wp.static(moves))
                        share = presence_over(surfaces, textures, hit, there.dxdu, there.dxdv)
                        part = take_share(mask, decision, first_open, share, flux, cutoff)
                        flux = part.throughput
                        if part.reported != 0:
                            add_branch(paths, row_of(paths, region, used), i, part.reported, state)
                            used += 1
                        culled += part.culled
                        decision += part.decided
                        if not part.reflected:
                            beam = passed(there, hit)
                            if wp.static(extended):
                                columns = transfer_columns(columns, beam.w, hit)
                            start = 0.0
                            continue

                    # ---- What another solid displaces is not there (Schmidt & Budge 2002)
                    eta = float(1.0)
                    if wp.static(nested):
                        beyond = int(inside)
                        if surfaces.interaction[surfaces.material_of[hit.triangle]] == DIELECTRIC:
                            crossing = crossing_at(surfaces, hit, beam.w, inside)
                            eta = crossing.eta
                            beyond = crossing.beyond
                            if crossing.nothing:
                                inside = beyond
                                beam = passed(transfer_to(beam, hit, True, wp.static(moves)), hit)
                                if wp.static(extended):
                                    columns = transfer_columns(columns, beam.w, hit)
                                start = 0.0
                                continue
                    if tags.shape[0] > 0:
                        path = prolonged(path, tags[hit.triangle])
                    beam = transfer_to(beam, hit, True, wp.static(moves))
                    if wp.static(recording):
                        paths.vertices[i * VERTICES + wp.min(count + 1, VERTICES - 1)] = beam.x
                    if wp.static(extended):
                        columns = transfer_columns(columns, beam.w, hit)
                    material = surfaces.material_of[hit.triangle]
                    interaction = surfaces.interaction[material]
                    if wp.static(partial):
                        share = textures.diffuse_shares[material]
                        if wp.static(mapped):
                            share = diffuse_share_at(textures, material, hit, beam.dxdu, beam.dxdv)
                        part = take_share(mask, decision, first_open, share, flux, cutoff)
                        flux = part.throughput
                        if part.reported != 0:
                            add_branch(paths, row_of(paths, region, used), i, part.reported, state)
                            used += 1
                        culled += part.culled
                        decision += part.decided
                        if part.reflected:
                            interaction = DIFFUSE

                    # ---- A diffuse surface takes it
                    if interaction == DIFFUSE:
                        fate = FATE_DIRECT
                        if count > 0:
                            fate = FATE_DEPOSITED
                            out.receiver[i] = surfaces.object_of[hit.triangle]
                            out.normal[i] = -wp.sign(wp.dot(hit.n_g, beam.w)) * hit.n_g
                            out.receiver_motion[i] = hit.motion
                            if wp.static(smooth_receivers):
                                out.incidence[i] = -beam.w / wp.abs(wp.dot(beam.w, hit.n_g))
                        break
                    if bounce == bounces:
                        break

                    if wp.static(partial):
                        # The flux that a first specular surface receives, counted by the path that others branch from.
                        if count == 0 and decision >= first_open:
                            entering = flux

                    # ---- Riding on the first specular surface (beyond the paper)
                    if wp.static(riding):
                        if count == 0:
                            shift = riding_shift(beam.dxdu, beam.dxdv, hit.n_g, hit.motion - beam.dxdt)
                            beam.dxdt += shift[0] * beam.dxdu + shift[1] * beam.dxdv
                            beam.dwdt += shift[0] * beam.dwdu + shift[1] * beam.dwdv

                    # ---- The light's extent, seen from the first specular surface (beyond the paper)
                    places = FluxOfPlaces()
                    if wp.static(extended):
                        if count == 0:
                            from_middle = beam.w
                            beam = from_visible_side(patch, beam)
                            columns = columns_at(patch, beam, hit.n_g)
                            if patch.is_place == 1:
                                left_of_place = shaping_of_place(patch, beam, columns, hit.n_g)
                                flux *= left_of_place
                                emitted *= left_of_place
                                entering *= left_of_place
                                if left_of_place <= 0.0:
                                    # Its cone ends before.
                                    fate = FATE_DIRECT
                                    break
                                off = patch.light_place[0] * columns.dwda + patch.light_place[1] * columns.dwdb
                                beam.w = wp.normalize(beam.w + off)
                            elif patch.extent_shape >= 0:
                                if patch.domain == 0:
                                    places = flux_of_directions(patch, beam, columns, hit.n_g)
                                else:
                                    places = flux_of_places(patch, beam, columns, hit.n_g, from_middle)
                                columns.gain = places.gain
                                columns.dwda *= places.narrowing[0]
                                columns.dwdb *= places.narrowing[1]
                                flux *= places.mean
                                emitted *= places.mean
                                entering *= places.mean
                                if places.mean <= 0.0:
                                    # No place on the light shines there.
                                    fate = FATE_DIRECT
                                    break

                    # ---- Reflection or refraction
                    roughness = float(0.0)
                    if wp.static(rough):
                        roughness = textures.roughnesses[material]
                        if wp.static(mapped):
                            roughness = roughness_at(textures, material, hit, beam.dxdu, beam.dxdv)
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
                    if wp.static(extended):
                        if dielectric:
                            at.reflectance = mean_reflectance(at, beam.w, columns, places)
                    reflected = True
                    if dielectric:
                        if wp.static(tints):
                            within = at.side < 0.0
                            if wp.static(nested):
                                # That of nested media is taken along the way.
                                within = within and surfaces.medium_of[surfaces.object_of[hit.triangle]] < 0
                            if within:
                                left = wp.cw_mul(flux, absorbed_within(textures, material, hit.distance))
                                if decision >= first_open:
                                    absorbed += flux - left
                                flux = left
                        reflectance = float(at.reflectance)
                        if wp.static(thin_walls):
                            if sheet:
                                reflectance = sheet_reflectance(reflectance)
                        branch = take_branch(mask, decision, first_open, reflectance, flux, cutoff)
                        reflected = branch.reflected
                        flux = branch.throughput
                        if branch.reported != 0:
                            # ---- What is reflected goes on from here
                            other = scatter(beam, hit, at, True, True, wp.static(moves))
                            if at.side > 0.0 and meets_nothing(surfaces, other, stream):
                                sum.escaped += channel_sum(branch.other)
                            else:
                                others = columns
                                if wp.static(extended):
                                    others = columns_after(columns, beam.w, other.w, hit, at, True, roughness)
                                of_branch = path_state(
                                    other, others, emitted, branch.other, shift, prolonged(path, 1), 0.0, inside,
                                    decision + 1, count + 1, bounce + 1,
                                )  # fmt: skip
                                add_branch(paths, row_of(paths, region, used), i, branch.reported, of_branch)
                                used += 1
                        culled += branch.culled
                        decision += branch.decided
                        if wp.static(tints):
                            if not reflected:
                                passing = textures.transmittances[material]
                                if wp.static(mapped):
                                    passing = transmittance_at(textures, material, hit, beam.dxdu, beam.dxdv)
                                left = wp.cw_mul(flux, passing)
                                if decision >= first_open:
                                    absorbed += flux - left
                                flux = left
                        if bounce >= FIRST_INTERACTIONS and wp.max(flux) < cutoff:
                            culled += flux
                            flux = wp.vec3(0.0, 0.0, 0.0)
                            break
                    else:
                        tint = surfaces.tint[material]
                        if wp.static(mapped):
                            tint = mirror_tint(textures, material, hit, tint, beam.dxdu, beam.dxdv)
                        tinted = wp.cw_mul(flux, tint)
                        if decision >= first_open:
                            absorbed += flux - tinted
                        flux = tinted
                    if wp.static(nested):
                        if not reflected:
                            inside = beyond
                    path = prolonged(path, int(reflected))
                    start = 0.0
                    count += 1
                    if wp.static(thin_walls):
                        if sheet and not reflected:
                            beam = passed(beam, hit)
                            if wp.static(rough):
                                if roughness > 0.0:
                                    columns = widened_by_sheet(columns, beam.w, surfaces.ior[material], roughness)
                            continue
                    before = beam.w
                    beam = scatter(beam, hit, at, reflected, True, wp.static(moves))
                    if wp.static(extended):
                        columns = columns_after(columns, before, beam.w, hit, at, reflected, roughness)

                if fate == FATE_DEPOSITED:
                    size = wp.length_sq(beam.dxdu) + wp.length_sq(beam.dxdv)
                    size += wp.length_sq(beam.dxdt) + wp.length_sq(beam.x)
                    if wp.static(extended):
                        size += wp.length_sq(columns.dxda) + wp.length_sq(columns.dxdb)
                    if not wp.isfinite(size):
                        fate = FATE_NONFINITE
                if fate == FATE_DEPOSITED:
                    if wp.static(extended):
                        beam.x += centroid_shift(columns)
                        out.dxda[i] = columns.dxda
                        out.dxdb[i] = columns.dxdb
                        out.image[i] = columns.image
                    out.position[i] = beam.x
                    out.shift[i] = shift
                    out.dxdu[i] = beam.dxdu
                    out.dxdv[i] = beam.dxdv
                    out.dxdt[i] = beam.dxdt
                    out.flux[i] = flux
                    out.emission[i] = coordinates
                    out.bounces[i] = count
                    out.path[i] = path
                    out.share[i] = wp.max(flux) / wp.max(wp.max(emitted), 1.0e-30)
                out.fate[i] = fate

                # ---- Of surfaces that are there in part, more than one path may be the first to meet what is specular
                if wp.static(partial):
                    sent = entering
                else:
                    sent = wp.where(mask == 0, emitted, wp.vec3(0.0, 0.0, 0.0))
                sum = with_path(sum, fate, sent, flux, absorbed, culled, retried)
            sums[region] = sum
            paths.done[region] = done
            paths.used[region] = used

    return trace_photons


_COLUMNS = (
    "position", "normal", "dxdu", "dxdv", "dxdt", "receiver_motion", "flux", "emission", "shift", "receiver", "bounces",
    "path", "share", "incidence", "dxda", "dxdb", "image",
)  # fmt: skip


def trace_photons(
    scene: SceneAtShutter,
    geometry: Geometry,
    plan: EmissionPlan,
    requirements: Requirements,
    launcher: Launcher,
    *,
    riding: bool = True,
    jittered: bool = False,
    seed: int = 0,
    weight: float = 1.0,
    smallest_branch: float = SMALLEST_BRANCH,
    chosen: Callable[[Lattice, Patch], ChosenCells] | None = None,
    aimed: bool = True,
    tags: np.ndarray | None = None,
    textures: TextureArrays | None = None,
    recording: bool = False,
    place: tuple[float, float] | None = None,
) -> tuple[PhotonMap, EnergyAccount]:
    """Traces the lattice photons of ``plan`` through ``geometry``.

    Args:
        riding: Keep each photon on the material point it first hit (beyond the paper), not on its emission point.
        jittered: Emit from random points of the lattice cells instead of their centres.
        weight: Part of the frame's exposure that these photons stand for; scales all flux.
        smallest_branch: Reflected branches below this fraction of the emitted flux are given up and accounted lost.
        chosen: Gives the cells of a lattice to emit; None emits all of the patch.
        aimed: Whether patches are those that reach what is specular; not where ``chosen`` knows cells without them.
        tags: A number for each triangle, by which paths differ, shape [m] int32; without, they differ by how they
            branch alone.
        textures: What the surfaces have of textures and of parts that are not there, where there are any.
        recording: Whether the vertices of paths are wanted.
        place: Where on lights with extent photons come from, through the same points of the first specular surface, by
            the light's coordinates (a, b). None for all of the light: photons then have the mean flux of its places,
            and land where the middle of their light does.

    Returns:
        The photons that landed on diffuse surfaces, and where all of the flux went [W, summed over channels].
    """
    account = EnergyAccount()
    landed: list[dict[str, np.ndarray]] = []
    needs = requirements
    variant = TracingVariant(
        needs.photon_motion, needs.refraction, needs.reflection, riding, jittered, needs.smooth_receivers, needs.nested,
        needs.partial, needs.tinted, recording, needs.light_columns, needs.linked, needs.thin_walls, needs.rough,
        needs.specular_maps,
    )  # fmt: skip
    kernel = tracing_kernel(variant)
    left_out = () if needs.smooth_receivers else ("incidence",)
    left_out += () if variant.extended else ("dxda", "dxdb", "image")
    columns = [name for name in _COLUMNS if name not in left_out]
    lights = tuple(light.path for light in scene.lights)
    links = links_of(scene.lights, geometry.paths)
    device_tags = launcher.array(np.zeros(0, np.int32) if tags is None else tags, wp.int32)
    bands = bands_of(geometry, nesting_of(scene), launcher) if needs.dispersive else [Band(0, geometry.surfaces)]
    for band in bands:
        emitting = _Emitting.of(plan.patches(scene, aimed=aimed), chosen or (plan.portion and plan.cells_of))
        for patch in emitting.patches:
            patch.power = weight * band.tinted(patch.power)
            if place is not None:
                patch.is_place, patch.light_place = 1, wp.vec2(*place)
        account.add(EnergyAccount(counts={"emitted": len(emitting.cells)}))
        if not len(emitting.cells):
            continue
        of_lattice = np.array([lights.index(plan.light_of(one)) for one in emitting.lattices], np.int16)
        patches = wp.array(emitting.patches, dtype=Patch, device=launcher.device)
        first_cells, offsets = launcher.array(emitting.first, wp.int32), launcher.array(emitting.offsets, wp.vec2)
        own = launcher.array(links[of_lattice] if len(links) else np.zeros((0, 0), np.int32), wp.int32)
        for begin in range(0, len(emitting.cells), BLOCK):
            paths = WaitingPaths.at_light(emitting.cells[begin : begin + BLOCK], launcher)
            while count := len(paths.sources):
                regions = PathRegions.room_for(count, variant.branches, recording, launcher)
                arrays = launcher.rows(PhotonArrays, regions.rows, left_out, zeroed=False)
                inputs = [band.surfaces, textures or TextureArrays(), patches, first_cells]
                inputs += [offsets, device_tags, own, launcher.array(paths.sources, wp.int32), paths.queue]
                inputs += [requirements.bounces, smallest_branch, seed]
                sums = launcher.zeros(regions.count, FluxSums)
                inputs += [arrays, regions.queue, sums]
                launcher(kernel, regions.count, inputs, smallest_chunk=1, in_turn=True)
                rows = regions.traced()
                landing = launcher.rows_of(arrays.fate, as_they_lie(rows)) == Fate.DEPOSITED
                add_sums(account, sums.numpy(), plan.normalization.power)
                if landing.any():
                    rows = as_they_lie(rows[landing])
                    found = {name: launcher.rows_of(getattr(arrays, name), rows) for name in columns}
                    cells, masks = (launcher.rows_of(getattr(regions.queue, name), rows) for name in ("cell", "mask"))
                    lattice, found["ids"] = emitting.ids(cells, band.path(masks), plan.id_count)
                    if recording:
                        found["vertices"] = regions.queue.vertices.numpy().reshape(-1, MOST_VERTICES, 3)[rows]
                    found["light"] = of_lattice[lattice]
                    landed.append(found)
                paths = WaitingPaths.of(regions)
    account.counts["landed"] = sum(len(found["ids"]) for found in landed)
    if not landed:
        return PhotonMap.empty(), account
    columns += ["ids", "light", *(["vertices"] if recording else [])]
    rows = {name: joined([found[name] for found in landed]) for name in columns}
    return PhotonMap(**rows, light_paths=lights, light_parts=plan.splits), account


@dataclass(frozen=True, eq=False)
class _Emitting:
    """The cells that one shutter emits, of all lattices together, so that they are traced at once.

    Attributes:
        lattices, patches: Those that emit; a patch is cut to hold just its cells.
        first: Number of the first cell of each patch, and of all cells, shape [k + 1] int32.
        cells: Numbers of the cells that emit, shape [n] int32.
        offsets: How far from the middle of each cell its photon starts, in lattice steps, shape [m, 2], one row for
            each cell of the patches; none where all start there.
    """

    lattices: list[Lattice]
    patches: list[Patch]
    first: np.ndarray
    cells: np.ndarray
    offsets: np.ndarray

    @classmethod
    def of(
        cls, pairs: Sequence[tuple[Lattice, Patch]], chosen: Callable[[Lattice, Patch], ChosenCells] | None
    ) -> _Emitting:
        """Those of all cells of the patches, or of the ``chosen`` ones."""
        cells, offsets, total = [np.zeros(0, np.int32)], [np.zeros((0, 2), np.float32)], 0
        first, emitting = [], []
        for lattice, patch in pairs:
            if chosen:
                numbers, there = _placed(chosen(lattice, patch), patch)
                offsets.append(there)
            else:
                numbers = np.arange(patch.count_u * patch.count_v, dtype=np.int32)
            if len(numbers):
                emitting.append((lattice, patch))
                first.append(total)
                cells.append(numbers + np.int32(total))
                total += patch.count_u * patch.count_v
        lattices, patches = ([pair[k] for pair in emitting] for k in (0, 1))
        first = np.array([*first, total], np.int32)
        return cls(lattices, patches, first, joined(cells[1:] or cells), joined(offsets))

    def ids(self, cells: np.ndarray, masks: np.ndarray, id_count: int) -> tuple[np.ndarray, np.ndarray]:
        """The lattice that each of some cells lies in, and the identity of its photon: cell and path, shape [n].

        Args:
            masks: Masks of their paths, with the numbers of their wavelengths beyond.
        """
        number = np.searchsorted(self.first, cells, side="right") - 1

        def of_each(values: list[int]) -> np.ndarray | int:
            return np.array(values, np.int64)[number] if len(values) > 1 else values[0]

        count_u = of_each([patch.count_u for patch in self.patches])
        down, across = np.divmod(cells.astype(np.int64) - self.first[number], count_u)
        wrap = [of_each([lattice.wrap[axis] for lattice in self.lattices]) for axis in (0, 1)]
        u = (of_each([patch.first_u for patch in self.patches]) + across) % wrap[0]
        v = (of_each([patch.first_v for patch in self.patches]) + down) % wrap[1]
        first_id = of_each([lattice.first_id for lattice in self.lattices])
        return number, masks.astype(np.int64) * id_count + first_id + v * wrap[0] + u


def _placed(chosen: ChosenCells, patch: Patch) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the chosen cells in ``patch``, which is cut to hold just them, and the offset of each of its cells.

    There are no offsets where all start in the middle of their cells.
    """
    if not len(chosen):
        return np.zeros(0, np.int32), np.zeros((0, 2), np.float32)
    first, last = chosen.cell.min(axis=0), chosen.cell.max(axis=0)
    (patch.first_u, patch.first_v), (patch.count_u, patch.count_v) = map(int, first), map(int, last - first + 1)
    u, v = (chosen.cell - first).T
    numbers = (u + patch.count_u * v).astype(np.int32)
    if chosen.offset is None:
        return numbers, np.zeros((0, 2), np.float32)
    offsets = np.zeros((patch.count_u * patch.count_v, 2), np.float32)
    offsets[numbers] = chosen.offset
    return numbers, offsets
