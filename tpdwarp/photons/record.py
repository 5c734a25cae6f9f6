"""Photons as the world sees them after tracing: plain arrays in scene units."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import numpy as np

from tpdwarp.photons.lattices import EmissionPlan
from tpdwarp.photons.photon_map import PhotonMap, joined

# Ids of photons that stand for a whole segment are smaller; so 2047 parts have room in 63 bits.
PART_IDS = 1 << 52


@dataclass(frozen=True, eq=False, repr=False)
class PhotonRecord:
    """Photons deposited over one shutter, one row each, in scene units.

    Attributes:
        ids: Stable identity from frame to frame, shape [n] int64.
        positions: Footprint centres at mid shutter, shape [n, 3].
        normals: Unit normals of the receiver on the side that was lit, shape [n, 3].
        dxdu, dxdv: Positional differentials per lattice step, shape [n, 3].
        dxdt: Displacement over the whole exposure relative to the receiver, shape [n, 3].
        flux: Flux carried [W], shape [n, 3].
        emission: Lattice coordinates at the light, shape [n, 2].
        bounces: Specular interactions of the path, shape [n] int32.
        receivers: Index into ``receiver_paths``, shape [n] int32.
        receiver_paths: Prim paths of the meshes.
        lights: Index into ``light_paths``, shape [n] int32; no rows where that is not known.
        light_paths: Prim paths of the lights.
        dxda, dxdb: Positional differentials by the place on the light, shape [n, 3]; no rows where no light has an
            extent.
    """

    ids: np.ndarray
    positions: np.ndarray
    normals: np.ndarray
    dxdu: np.ndarray
    dxdv: np.ndarray
    dxdt: np.ndarray
    flux: np.ndarray
    emission: np.ndarray
    bounces: np.ndarray
    receivers: np.ndarray
    receiver_paths: tuple[str, ...]
    lights: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int32))
    light_paths: tuple[str, ...] = ()
    dxda: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    dxdb: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))

    def __len__(self) -> int:
        return len(self.ids)

    def __repr__(self) -> str:
        columns = [f.name for f in fields(self) if isinstance(getattr(self, f.name), np.ndarray)]
        return f"PhotonRecord({len(self)} photons: {', '.join(columns)})"

    def rows(self, chosen: np.ndarray) -> PhotonRecord:
        """Some of the photons, by index or mask."""
        arrays = [f.name for f in fields(self) if isinstance(getattr(self, f.name), np.ndarray)]
        columns = [name for name in arrays if len(getattr(self, name)) == len(self)]
        return replace(self, **{name: getattr(self, name)[chosen] for name in columns})


class LandedPhotons:
    """The photons of one shutter, whose record is made when it is first asked for: most frames never ask.

    Args:
        maps: As :func:`record_of` takes them.
        receiver_paths: Prim paths of the meshes.
        count: Number of photons where they were not kept.
    """

    def __init__(
        self, maps: list[tuple[PhotonMap, EmissionPlan]], receiver_paths: tuple[str, ...], count: int | None = None
    ) -> None:
        self._maps, self.receiver_paths = maps, receiver_paths
        self._count = sum(len(photons) for photons, _ in maps) if count is None else count

    def __len__(self) -> int:
        return self._count

    @cached_property
    def record(self) -> PhotonRecord:
        """The photons in scene units, where they were kept."""
        return record_of(self._maps, self.receiver_paths)


def record_of(maps: list[tuple[PhotonMap, EmissionPlan]], paths: tuple[str, ...]) -> PhotonRecord:
    """The photons of a whole shutter in scene units; ids of later segments follow those of earlier ones.

    Photons that stand for part of a segment have ids of their own, ``PART_IDS`` further for each part before.

    ``dxdt`` is D_t x' − q̇, relative to the receiver's own motion (the paper, section 2: velocity is relative).

    Args:
        maps: At least one, with the lattices that it comes from; those of parts of a segment follow that of its whole.
        paths: Prim paths of the objects.
    """
    norm = maps[0][1].normalization
    strip = _strip_of(maps[0][1])
    ids = sum(plan.id_count for photons, plan in maps if photons.part == 0 and _strip_of(plan) == strip)
    first = own = 0
    lights: dict[str, int] = {}
    rows: dict[str, list[np.ndarray]] = {}
    for photons, plan in maps:
        if _strip_of(plan) != strip:
            # Each strip goes through all segments and portions.
            first, own, strip = 0, 0, _strip_of(plan)
        if photons.part == 0:
            first, own = first + own, plan.id_count
        mask, cell = np.divmod(photons.ids, plan.id_count)
        relative = (photons.dxdt - photons.receiver_motion) / photons.duration
        values = {
            "ids": mask * ids + first + cell + photons.part * PART_IDS,
            "positions": norm.world_points(photons.position),
            "normals": photons.normal.astype(np.float64),
            "dxdu": norm.world_vectors(photons.dxdu),
            "dxdv": norm.world_vectors(photons.dxdv),
            "dxdt": norm.world_vectors(relative),
            "flux": norm.power * photons.flux.astype(np.float64),
            "emission": photons.emission.astype(np.float64),
            "bounces": photons.bounces,
            "receivers": photons.receiver,
            "lights": np.array([lights.setdefault(path, len(lights)) for path in photons.light_paths], np.int32)[
                photons.light
            ],
            "dxda": norm.world_vectors(photons.dxda),
            "dxdb": norm.world_vectors(photons.dxdb),
        }
        for name, value in values.items():
            rows.setdefault(name, []).append(value)
    columns = {name: joined(parts) for name, parts in rows.items()}
    return PhotonRecord(**columns, receiver_paths=paths, light_paths=tuple(lights))


def _strip_of(plan: EmissionPlan) -> int:
    return 0 if plan.strip is None else plan.strip.number
