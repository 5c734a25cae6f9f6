"""Rows of photon maps that have footprints of one kind, taken column by column: ten million photons fill memory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields

import numpy as np

from tpdwarp.photons.photon_map import PhotonMap, TrajectoryColumns

_OF_TRAJECTORIES = {field.name for field in fields(TrajectoryColumns)}


@dataclass(frozen=True, eq=False)
class PhotonRows:
    """Some photons of a map.

    Attributes:
        photons: The map.
        rows: Which, by index, shape [n]; None for all.
        part: The part of its flux that each of them has here, shape [n]; None for all of it.
        changed: Columns in the place of those of the map, shape [n, ...] each, or one value for all of them.
    """

    photons: PhotonMap
    rows: np.ndarray | None = None
    part: np.ndarray | None = None
    changed: Mapping[str, np.ndarray | np.generic] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.photons) if self.rows is None else len(self.rows)

    def values(self, name: str) -> np.ndarray:
        """A column of all photons of the map, or of how their trajectories curve, zero where they are straight, or of
        what images were mirrored about, zero of photons themselves."""
        if name == "mirrors" and not self.has(name):
            return np.broadcast_to(np.float32(0.0), (len(self.photons), *self.photons.mirrors.shape[1:]))
        if name not in _OF_TRAJECTORIES:
            return getattr(self.photons, name)
        if self.photons.trajectory is not None:
            return getattr(self.photons.trajectory, name)
        shape = (len(self.photons),) if name == "gain" else self.photons.position.shape
        return np.broadcast_to(np.float32(0.0), shape)

    def has(self, name: str) -> bool:
        """Whether there is such a column: some have no rows where no stage asks for them."""
        return len(getattr(self.photons, name)) == len(self.photons)


def stacked(parts: Sequence[PhotonRows], name: str, *, own: bool = False) -> np.ndarray:
    """A column of all ``parts``, one below the other.

    Args:
        own: Whether it is to be written to: else that of a whole map alone is not copied.
    """
    first = parts[0].values(name)
    if len(parts) == 1 and parts[0].rows is None and not parts[0].changed and not own:
        return first
    counts = [len(part) for part in parts]
    out = np.empty((sum(counts), *first.shape[1:]), first.dtype)
    start = 0
    for part, count in zip(parts, counts, strict=True):
        here = out[start : start + count]
        if name in part.changed:
            here[:] = part.changed[name]
        elif part.rows is None:
            here[:] = part.values(name)
        else:
            # With other modes NumPy takes them twice.
            np.take(part.values(name), part.rows, axis=0, out=here, mode="clip")
        if name == "flux" and part.part is not None:
            here *= part.part[:, None]
        start += count
    return out
