"""Photons as the world sees them after tracing: plain arrays in scene units, and the account of their energy."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True, eq=False)
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
        bounces: Specular interactions on the way, shape [n] int32.
        receivers: Index into ``receiver_paths``, shape [n] int32.
        receiver_paths: Prim paths of the meshes.
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

    def __len__(self) -> int:
        return len(self.ids)


@dataclass
class EnergyAccount:
    """Where the flux went, in watts summed over the three channels: sent = deposited + escaped + absorbed + lost.

    Attributes:
        sent: Flux that met a specular surface first. Light that meets a diffuse surface first is direct light.
        deposited: Flux left on diffuse surfaces.
        escaped: Flux that left the scene after a specular interaction.
        absorbed: Flux taken by tinted mirrors.
        lost: Flux given up, by cause.
        counts: Photons emitted, landed, and other tallies.
    """

    sent: float = 0.0
    deposited: float = 0.0
    escaped: float = 0.0
    absorbed: float = 0.0
    lost: dict[str, float] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)

    @property
    def lost_total(self) -> float:
        return sum(self.lost.values())

    def add(self, other: EnergyAccount) -> None:
        """Adds another account to this one."""
        for name in ("sent", "deposited", "escaped", "absorbed"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        for mine, theirs in ((self.lost, other.lost), (self.counts, other.counts)):
            for cause, value in theirs.items():
                mine[cause] = mine.get(cause, 0) + value

    def as_dict(self) -> dict[str, object]:
        """The account as plain JSON values."""
        return {
            "sent": self.sent,
            "deposited": self.deposited,
            "escaped": self.escaped,
            "absorbed": self.absorbed,
            "lost": dict(self.lost),
            "counts": dict(self.counts),
        }
