"""Photons that have landed, as the estimators see them: arrays in the tracer's units, one row a photon."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, fields, replace

import numpy as np

from tpdwarp.photons.power_curves import PowerCurve
from tpdwarp.photons.vectors import lengths

# Vertices that are recorded of a path; the last of them is where it ends. Chosen, not derived: more are a tangle.
MOST_VERTICES = 16


@dataclass
class TrajectoryColumns:
    """How D_t x, footprints and flux of photons change from the opening to the closing of the shutter.

    Beyond the paper, whose footprints go straight and keep their shape and flux.

    Attributes:
        dxdtt, dxdttt: Acceleration D_tt x and jerk D_ttt x, each [n, 3].
        dxdut, dxdvt: Jacobian rates D_t D_u x and D_t D_v x, each [n, 3].
        gain: Change of the flux over the whole shutter, as a part of the flux, shape [n].
        flux_bend: Second derivative of the flux over the shutter, as a part of the flux, where that is cut into pieces
            for it (:mod:`tpdwarp.trajectories.flux_pieces`), zero of others, shape [n]; no rows where none is.
    """

    dxdtt: np.ndarray
    dxdttt: np.ndarray
    dxdut: np.ndarray
    dxdvt: np.ndarray
    gain: np.ndarray
    flux_bend: np.ndarray = field(default_factory=lambda: np.zeros(0, np.float32))

    def rows(self, chosen: np.ndarray) -> TrajectoryColumns:
        """Those of some of the photons, by index or mask."""
        index = row_index(chosen)
        taken = {name: column.take(index, axis=0) if len(column) else column for name, column in vars(self).items()}
        return TrajectoryColumns(**taken)


@dataclass
class PhotonMap:
    """Photons deposited over one shutter, or a segment of it, in the tracer's units.

    Attributes:
        ids: Identity from frame to frame, shape [n] int64.
        position: Footprint centres at mid shutter, shape [n, 3].
        normal: Unit geometric normals of the receiver, on the side that was lit, shape [n, 3].
        dxdu, dxdv: D_u x and D_v x per lattice step, shape [n, 3].
        dxdt: D_t x in the world, over ``duration`` of the shutter, shape [n, 3].
        receiver_motion: Motion of the receiver's material over the same time, shape [n, 3].
        flux: Flux carried, shape [n, 3].
        emission: Lattice coordinates on the light at the middle of the segment, shape [n, 2].
        shift: Lattice steps by which a photon that rides on its surface moves over it on the light, shape [n, 2].
        receiver: Number of the object that it landed on, shape [n].
        bounces: Specular interactions of the path, shape [n].
        path: A number that tells paths apart by the bodies and facets that they meet, shape [n] uint32.
        share: Part of the flux of its cell that it carries, shape [n].
        incidence: −ω/|ω·n|, where n is ``normal``: its product with a shading normal is by how much more light falls
            on that; shape [n, 3], no rows where all receivers are flat.
        light: The light that it comes from, as index into ``light_paths``, shape [n] int16.
        light_paths: Prim paths of the lights.
        vertices: Where the path begins, meets surfaces and ends, as many as its bounces and two, shape [n,
            ``MOST_VERTICES``, 3]; no rows where they are not recorded.
        dxda, dxdb: D_a x and D_b x by the place on the light, shape [n, 3]; no rows where no light has an extent.
        image: What they span (:class:`tpdwarp.photons.light_columns.LightImage`), shape [n] int32; rows as they have.
        bend: ½ (D_uu x + D_vv x) per lattice step (:mod:`tpdwarp.trajectories.bends`), shape [n, 3]; no rows where it
            is not known.
        reach: Parts of the columns below that the footprint reaches over (likewise), shape [n, 2]; rows as bends have.
        cell_u, cell_v: D_u x and D_v x over whole cells (likewise), shape [n, 3]; rows as bends have.
        edges: Lines where the receiver ends that the footprint reaches over (:mod:`tpdwarp.footprints.receiver_edges`),
            as planes (unit normal, distance from the origin), zero where there are none, shape [n, 2, 4]; no rows where
            no photon has any.
        mirrors: Unit normals of the lines that the image of a photon was mirrored about, the one after the other
            (likewise), zero for none, shape [n, 2, 3]; no rows of photons themselves.
        light_parts: Into how many parts lights with extent are cut, each with lattices of its own.
        trajectory: How it curves, and how the footprint changes along it; None where it is straight.
        power_curves: How the power of each of the lights changes over the shutter (:mod:`.power_curves`), None of those
            that stay as they are; none where all do. Flux is the mean over the shutter, and ``trajectory.gain`` does
            not count it.
        time: Middle of the photons' part of the shutter, −½ … ½.
        duration: Length of that part.
        part: Which of the parts of a segment these photons stand for, from 1 on; 0 for the whole segment.
        finer: How many of these photons' cells lie along either side of one of the lattice.
        place: Where in that one they lie, in steps of theirs from its middle along u and v.
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
    bounces: np.ndarray
    path: np.ndarray
    share: np.ndarray
    incidence: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    light: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int16))
    light_paths: tuple[str, ...] = ()
    vertices: np.ndarray = field(default_factory=lambda: np.zeros((0, MOST_VERTICES, 3), np.float32))
    dxda: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    dxdb: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    image: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int32))
    bend: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    reach: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    cell_u: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    cell_v: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    edges: np.ndarray = field(default_factory=lambda: np.zeros((0, 2, 4), np.float32))
    mirrors: np.ndarray = field(default_factory=lambda: np.zeros((0, 2, 3), np.float32))
    light_parts: int = 1
    trajectory: TrajectoryColumns | None = None
    power_curves: tuple[PowerCurve | None, ...] = ()
    time: float = 0.0
    duration: float = 1.0
    part: int = 0
    finer: int = 1
    place: tuple[float, float] = (0.0, 0.0)

    def __len__(self) -> int:
        return len(self.ids)

    @classmethod
    def empty(cls) -> PhotonMap:
        """A map without photons."""
        three, two = np.zeros((0, 3), np.float32), np.zeros((0, 2), np.float32)
        whole = np.zeros(0, np.int32)
        paths, shares = np.zeros(0, np.uint32), np.zeros(0, np.float32)
        return cls(np.zeros(0, np.int64), *[three] * 7, two, two, whole, whole, paths, shares)

    @property
    def in_whole_cells(self) -> PhotonMap:
        """The photons with the footprints of the cells of the lattice that theirs are parts of."""
        if self.finer == 1:
            return self
        count, (u, v) = np.float32(self.finer), np.float32(self.place)
        trajectory = self.trajectory
        if trajectory is not None:
            trajectory = replace(trajectory, dxdut=count * trajectory.dxdut, dxdvt=count * trajectory.dxdvt)
        return replace(
            self,
            position=self.position - u * self.dxdu - v * self.dxdv,
            dxdu=count * self.dxdu,
            dxdv=count * self.dxdv,
            bend=count**2 * self.bend,
            trajectory=trajectory,
            finer=1,
        )

    @property
    def size(self) -> np.ndarray:
        """Length of the longer of D_u x and D_v x, shape [n]."""
        return np.maximum(lengths(self.dxdu), lengths(self.dxdv))

    def rows(self, chosen: np.ndarray) -> PhotonMap:
        """Some of the photons, by index or mask."""
        index, count = row_index(chosen), len(self)
        # Frames have hundreds of small maps, for which ``replace`` takes longer than for the rows.
        out = copy(self)
        out.trajectory = None if self.trajectory is None else self.trajectory.rows(index)
        for name, column in vars(self).items():
            if isinstance(column, np.ndarray) and len(column) == count:
                setattr(out, name, column.take(index, axis=0))
        return out


def together(maps: Sequence[PhotonMap]) -> PhotonMap:
    """The photons of several maps in one, with the columns that all of them have; all else is as in the first."""
    first = maps[0]
    found = {}
    for name in (f.name for f in fields(first) if isinstance(getattr(first, f.name), np.ndarray)):
        columns = [getattr(photons, name) for photons in maps]
        known = all(len(column) == len(photons) for column, photons in zip(columns, maps, strict=True))
        found[name] = joined(columns) if known else columns[0][:0]
    return replace(first, trajectory=None, **found)


def row_index(chosen: np.ndarray) -> np.ndarray:
    """The rows of a mask, or the index that is given: vectors are taken by index five times as fast as by mask."""
    return np.flatnonzero(chosen) if chosen.dtype == bool else chosen


def joined(parts: list[np.ndarray]) -> np.ndarray:
    """The rows of all ``parts``; where there is but one it is not copied, for ten million photons fill memory."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)
