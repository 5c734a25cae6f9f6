"""The account of energy: where the flux that was sent went."""

from __future__ import annotations

from dataclasses import dataclass, field

# Photons without which a light beside others counts as starved. Chosen, not derived: 32 cells along either side.
FEWEST_OF_SEVERAL = 1024
# What such lights are counted as.
STARVED = f"lights with fewer than {FEWEST_OF_SEVERAL} photons"
# The error that is foreseen of light with extent in a bad number of parts, as it is counted.
COARSE_PARTS = "foreseen error of light with extent in so many parts, per mille"

# The cause by which flux of branches counts as lost that are too faint to be followed.
BELOW_CUTOFF = "branch below cutoff"


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
        """Flux given up for any cause [W]."""
        return sum(self.lost.values())

    def add(self, other: EnergyAccount) -> None:
        """Adds another account to this one."""
        for name in ("sent", "deposited", "escaped", "absorbed"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        for mine, theirs in ((self.lost, other.lost), (self.counts, other.counts)):
            for cause, value in theirs.items():
                mine[cause] = mine.get(cause, 0) + value

    def subtract(self, other: EnergyAccount) -> None:
        """Takes another account, of photons that this one counts too, out of this one."""
        for name in ("sent", "deposited", "escaped", "absorbed"):
            setattr(self, name, getattr(self, name) - getattr(other, name))
        for mine, theirs in ((self.lost, other.lost), (self.counts, other.counts)):
            for cause, value in theirs.items():
                mine[cause] = mine.get(cause, 0) - value

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
