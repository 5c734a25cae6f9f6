"""Tracing photons with their differentials through specular surfaces to the diffuse surface where they land.

At a dielectric both branches are followed. A path is named by a mask whose bit b says that the photon was reflected at
interaction b where it could also have been refracted; the first pass traces mask 0 (always refracted) and reports the
interactions whose reflected share is worth following, which the next passes trace from the light again. So every path
has an identity that stays the same from frame to frame, every photon of a pass is independent of all others, and the
flux of a branch is exact rather than a matter of chance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from functools import cache

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.photons.beam import arrive, leave, meet
from tpdwarp.photons.differentials import riding_shift
from tpdwarp.photons.emission import EmissionPlan, Patch, cell_flux, emit
from tpdwarp.photons.record import EnergyAccount, PhotonRecord
from tpdwarp.scene.description import SceneAtShutter
from tpdwarp.scene.device.geometry import Geometry, Surfaces
from tpdwarp.scene.device.intersection import along, closest_hit, occluded
from tpdwarp.scene.requirements import Requirements

SMALLEST_BRANCH = 2.0e-3
DIELECTRIC = wp.constant(1)
FAR = wp.constant(1.0e6)


class Fate(IntEnum):
    """How a path ended."""

    DIRECT = 0  # met no specular surface: direct light's business
    DEPOSITED = 1
    ESCAPED = 2
    DEPTH = 3
    NONFINITE = 4


@wp.struct
class PhotonArrays:
    """One row a path, in the tracer's units; ``dxdt`` is the world displacement over the photon's own (sub-)shutter."""

    position: wp.array(dtype=wp.vec3)
    normal: wp.array(dtype=wp.vec3)
    dxdu: wp.array(dtype=wp.vec3)
    dxdv: wp.array(dtype=wp.vec3)
    dxdt: wp.array(dtype=wp.vec3)
    receiver_motion: wp.array(dtype=wp.vec3)
    emitted: wp.array(dtype=wp.vec3)
    flux: wp.array(dtype=wp.vec3)
    absorbed: wp.array(dtype=wp.vec3)
    culled: wp.array(dtype=wp.vec3)
    emission: wp.array(dtype=wp.vec2)
    shift: wp.array(dtype=wp.vec2)
    receiver: wp.array(dtype=wp.int32)
    entry: wp.array(dtype=wp.int32)
    bounces: wp.array(dtype=wp.int32)
    fate: wp.array(dtype=wp.int32)
    branches: wp.array(dtype=wp.int32)
    retried: wp.array(dtype=wp.int32)


@dataclass(frozen=True)
class TracingVariant:
    """What the tracing kernel is compiled for."""

    moves: bool
    refraction: bool
    reflection: bool
    riding: bool
    jittered: bool
    choosy: bool


@cache
def tracing_kernel(variant: TracingVariant) -> wp.Kernel:
    """The kernel that traces one path of one photon, specialised by what the scene requires."""
    moves, refraction, jittered = variant.moves, variant.refraction, variant.jittered
    both, riding, choosy = variant.refraction and variant.reflection, variant.riding and variant.moves, variant.choosy

    @wp.kernel(module="unique", enable_backward=False)
    def trace_photons(
        base: int,
        # Scene
        surfaces: Surfaces,
        patch: Patch,
        # In
        cells: wp.array(dtype=wp.int32),
        masks: wp.array(dtype=wp.int32),
        taken: wp.array(dtype=wp.int32),
        bounces: int,
        smallest_branch: float,
        seed: int,
        # Out
        out: PhotonArrays,
    ):
        i = base + wp.tid()
        cell = cells[i]
        mask = masks[i]
        index_u = patch.first_u + cell % patch.count_u
        index_v = patch.first_v + cell // patch.count_u
        stream = wp.rand_init(seed, index_u * 65537 + index_v)
        offset = wp.vec2(0.5, 0.5)
        if wp.static(jittered):
            offset = wp.vec2(wp.randf(stream), wp.randf(stream))
        coordinates = wp.vec2(float(index_u), float(index_v)) + offset
        beam = emit(patch, coordinates)
        emitted = cell_flux(patch, coordinates)
        flux = emitted
        absorbed = wp.vec3(0.0, 0.0, 0.0)
        culled = wp.vec3(0.0, 0.0, 0.0)
        branches = int(0)
        fate = int(3)
        count = int(0)
        retried = int(0)
        # Branches before the last one taken belong to the paths that spawned this one.
        newest = int(0)
        while (mask >> newest) > 0:
            newest += 1

        start = patch.start
        if patch.near > start:
            # What is tiny is met from nearby, unless something stands before it: rays from afar round like their way.
            if not occluded(surfaces, along(beam.x, beam.w, start), beam.w, beam.lift, patch.near - start):
                start = patch.near
        beam.grain = patch.grain

        for bounce in range(bounces + 1):
            hit = closest_hit(surfaces, beam.x, beam.w, beam.lift, beam.grain, start, FAR, wp.static(moves), stream)
            if hit.triangle < 0:
                if count > 0:
                    fate = 2
                else:
                    fate = 0
                break
            retried += hit.retried
            beam = arrive(beam, hit, wp.static(moves))
            material = surfaces.material_of[hit.triangle]
            interaction = surfaces.interaction[material]
            if interaction == 0:
                fate = 0
                if count > 0:
                    fate = 1
                    out.receiver[i] = surfaces.object_of[hit.triangle]
                    out.normal[i] = -wp.sign(wp.dot(hit.n_g, beam.w)) * hit.n_g
                    out.receiver_motion[i] = hit.motion
                break
            if bounce == bounces:
                break
            if count == 0:
                entry = surfaces.object_of[hit.triangle]
                out.entry[i] = entry
                if wp.static(choosy):
                    if taken[entry] == 0:
                        fate = 0
                        break
                if wp.static(riding):
                    shift = riding_shift(beam.dxdu, beam.dxdv, hit.n_g, hit.motion - beam.dxdt)
                    beam.dxdt += shift[0] * beam.dxdu + shift[1] * beam.dxdv
                    beam.dwdt += shift[0] * beam.dwdu + shift[1] * beam.dwdv
                    out.shift[i] = shift
            dielectric = wp.static(refraction)
            if wp.static(both):
                dielectric = interaction == DIELECTRIC
            at = meet(surfaces, hit, beam.w, dielectric, wp.static(moves))
            reflected = True
            if dielectric:
                if at.reflectance < 1.0:
                    reflected = (mask & (1 << bounce)) != 0
                    share = flux * at.reflectance
                    if reflected:
                        flux = share
                    else:
                        flux = flux - share
                        if bounce >= newest:
                            if wp.max(share) >= smallest_branch * wp.max(emitted):
                                branches = branches | (1 << bounce)
                            else:
                                culled += share
            else:
                tinted = wp.cw_mul(flux, surfaces.tint[material])
                if bounce >= newest:
                    absorbed += flux - tinted
                flux = tinted
            beam = leave(surfaces, beam, hit, at, reflected, wp.static(moves))
            start = 0.0
            count += 1

        if fate == 1:
            size = wp.length_sq(beam.dxdu) + wp.length_sq(beam.dxdv) + wp.length_sq(beam.dxdt) + wp.length_sq(beam.x)
            if not wp.isfinite(size):
                fate = 4
        out.position[i] = beam.x
        out.dxdu[i] = beam.dxdu
        out.dxdv[i] = beam.dxdv
        out.dxdt[i] = beam.dxdt
        out.emitted[i] = emitted
        out.flux[i] = flux
        out.absorbed[i] = absorbed
        out.culled[i] = culled
        out.emission[i] = coordinates
        out.bounces[i] = count
        out.fate[i] = fate
        out.branches[i] = branches
        out.retried[i] = retried

    return trace_photons


@dataclass
class Curve:
    """How D_t x and the footprints of photons change from the opening to the closing of the shutter, beyond the paper.

    Attributes:
        dxdtt, dxdttt: D_tt x and D_ttt x, each [n, 3].
        dxdut, dxdvt: D_t D_u x and D_t D_v x, each [n, 3].
    """

    dxdtt: np.ndarray
    dxdttt: np.ndarray
    dxdut: np.ndarray
    dxdvt: np.ndarray


@dataclass
class PhotonMap:
    """Photons deposited over one (sub-)shutter, in the tracer's units; all arrays have one row a photon.

    ``dxdt`` [n, 3] is the world displacement over ``duration`` of the shutter, centred at ``time`` (−½ … ½); ``shift``
    [n, 2] the lattice steps by which a photon that rides on its surface moves over it on the light; ``curve`` tells how
    its way is bent, None where it is straight; ``entry`` and ``receiver`` [n] number the objects that it met first and
    last.
    """

    ids: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    dxdu: np.ndarray
    dxdv: np.ndarray
    dxdt: np.ndarray
    receiver_motion: np.ndarray
    flux: np.ndarray
    emission: np.ndarray
    shift: np.ndarray
    receiver: np.ndarray
    entry: np.ndarray
    bounces: np.ndarray
    curve: Curve | None = None
    time: float = 0.0
    duration: float = 1.0

    def __len__(self) -> int:
        return len(self.ids)


_FIELDS = (
    "position", "normal", "dxdu", "dxdv", "dxdt", "receiver_motion", "flux", "emission", "shift", "receiver",
    "entry", "bounces",
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
    chosen: Callable[[Patch], np.ndarray] | None = None,
    taken: Callable[[str], bool] | None = None,
) -> tuple[PhotonMap, EnergyAccount]:
    """Traces the lattice photons of ``plan`` through ``geometry``.

    Args:
        riding: Keep each photon on the material point it first hit (beyond the paper), not on its emission point.
        jittered: Emit from random points of the lattice cells instead of their centres.
        weight: Part of the frame's exposure that these photons stand for; scales all flux.
        smallest_branch: Reflected branches below this fraction of the emitted flux are given up and accounted lost.
        chosen: Gives the cells of a patch to emit (u + count_u · v from its first cell); None emits all.
        taken: Tells by its path whether photons that meet a mesh first are wanted; None wants all. Those that are not
            wanted are not counted as sent.

    Returns:
        The photons that landed on diffuse surfaces, and where all of the flux went [W, summed over channels].
    """
    account = EnergyAccount()
    landed: list[dict[str, np.ndarray]] = []
    kernel = tracing_kernel(
        TracingVariant(
            requirements.photon_motion,
            requirements.refraction,
            requirements.reflection,
            riding,
            jittered,
            choosy=taken is not None,
        )
    )
    wanted = np.array([taken is None or taken(path) for path in geometry.paths], np.int32)
    wanted = launcher.array(wanted if taken else wanted[:0], wp.int32)
    for lattice, patch in plan.patches(scene, taken):
        patch.power = weight * patch.power
        cells = chosen(patch) if chosen else np.arange(patch.count_u * patch.count_v)
        cells = cells.astype(np.int32)
        masks = np.zeros(len(cells), np.int32)
        account.add(EnergyAccount(counts={"emitted": len(cells)}))
        while len(cells):
            out = launcher.rows(PhotonArrays, len(cells))
            inputs = [geometry.surfaces, patch, launcher.array(cells, wp.int32), launcher.array(masks, wp.int32)]
            launcher(kernel, len(cells), [*inputs, wanted, requirements.bounces, smallest_branch, seed, out])
            fate, branches = out.fate.numpy(), out.branches.numpy()
            _tally(account, out, fate, masks, plan.normalization.power)
            keep = np.flatnonzero(fate == Fate.DEPOSITED)
            if len(keep):
                rows = {name: getattr(out, name).numpy()[keep] for name in _FIELDS}
                rows["ids"] = _ids(rows["emission"], masks[keep], lattice, plan.id_count)
                landed.append(rows)
            cells, masks = next_paths(cells, masks, branches)
            # Before the next pass makes its own.
            del out, inputs, fate, branches
    account.counts["landed"] = sum(len(rows["ids"]) for rows in landed)
    if not landed:
        return _empty(), account
    return PhotonMap(**{name: joined([rows[name] for rows in landed]) for name in ("ids", *_FIELDS)}), account


def joined(parts: list[np.ndarray]) -> np.ndarray:
    """The rows of all ``parts``; a single one is not copied, for ten million photons fill memory."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def _tally(account: EnergyAccount, out: PhotonArrays, fate: np.ndarray, masks: np.ndarray, unit: float) -> None:
    flux = unit * out.flux.numpy().sum(axis=1, dtype=np.float64)
    specular = fate != Fate.DIRECT
    # Counted at the light, not added up from where it went: so the account can show that something is missing.
    account.sent += unit * float(out.emitted.numpy()[specular & (masks == 0)].sum(dtype=np.float64))
    retried = int(out.retried.numpy().sum(dtype=np.int64))
    if retried:
        account.counts["hits at the second try"] = account.counts.get("hits at the second try", 0) + retried
    account.deposited += float(flux[fate == Fate.DEPOSITED].sum())
    account.escaped += float(flux[fate == Fate.ESCAPED].sum())
    account.absorbed += unit * float(out.absorbed.numpy()[specular].sum(dtype=np.float64))
    for cause, value in (
        ("branch below cutoff", unit * out.culled.numpy()[specular].sum(dtype=np.float64)),
        ("too many bounces", flux[fate == Fate.DEPTH].sum()),
        ("not finite", flux[fate == Fate.NONFINITE].sum()),
    ):
        if value:
            account.lost[cause] = account.lost.get(cause, 0.0) + float(value)


def _ids(emission: np.ndarray, masks: np.ndarray, lattice, id_count: int) -> np.ndarray:
    cell = np.floor(emission).astype(np.int64)
    u, v = cell[:, 0] % lattice.wrap[0], cell[:, 1] % lattice.wrap[1]
    return masks.astype(np.int64) * id_count + lattice.first_id + v * lattice.wrap[0] + u


def next_paths(cells: np.ndarray, masks: np.ndarray, branches: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Every reported branch becomes a path of its own, in order of interaction, then of photon."""
    next_cells, next_masks = [], []
    for bounce in range(int(branches.max(initial=0)).bit_length()):
        chosen = np.flatnonzero(branches & (1 << bounce))
        next_cells.append(cells[chosen])
        next_masks.append(masks[chosen] | np.int32(1 << bounce))
    if not next_cells:
        return cells[:0], masks[:0]
    return np.concatenate(next_cells), np.concatenate(next_masks)


def _empty() -> PhotonMap:
    three, two = np.zeros((0, 3), np.float32), np.zeros((0, 2), np.float32)
    whole = np.zeros(0, np.int32)
    threes, wholes = [three] * 7, [whole] * 3
    return PhotonMap(np.zeros(0, np.int64), *threes, two, two, *wholes)


def record_of(maps: list[tuple[PhotonMap, EmissionPlan]], paths: tuple[str, ...]) -> PhotonRecord:
    """The photons of a whole shutter in scene units; ids of later maps follow those of earlier ones.

    Args:
        maps: At least one, with the lattices that it comes from.
        paths: Prim paths of the objects.
    """
    norm = maps[0][1].normalization
    ids = sum(plan.id_count for _, plan in maps)
    first = 0
    rows: dict[str, list[np.ndarray]] = {}
    for photons, plan in maps:
        mask, cell = np.divmod(photons.ids, plan.id_count)
        relative = (photons.dxdt - photons.receiver_motion) / photons.duration
        values = {
            "ids": mask * ids + first + cell,
            "positions": norm.world_points(photons.position),
            "normals": photons.normal.astype(np.float64),
            "dxdu": norm.world_vectors(photons.dxdu),
            "dxdv": norm.world_vectors(photons.dxdv),
            "dxdt": norm.world_vectors(relative),
            "flux": norm.power * photons.flux.astype(np.float64),
            "emission": photons.emission.astype(np.float64),
            "bounces": photons.bounces,
            "receivers": photons.receiver,
        }
        for name, value in values.items():
            rows.setdefault(name, []).append(value)
        first += plan.id_count
    return PhotonRecord(**{name: joined(parts) for name, parts in rows.items()}, receiver_paths=paths)
