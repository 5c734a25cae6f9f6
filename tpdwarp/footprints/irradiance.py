"""Where irradiance is wanted, and what comes back: the arrays that every estimator takes and gives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import warp as wp

from tpdwarp.device import Launcher


@wp.struct
class QueryArrays:
    """Points at which irradiance is wanted, in the tracer's units; one row a query.

    ``position`` is where the point stands when it is looked at, ``motion`` its displacement over the whole shutter
    (that of the surface point a pixel sees), ``normal`` faces the viewer, ``receiver`` is its object (−1: no query).
    ``shading_normal`` faces the viewer, too, and may be a mean of several; it has no rows where receivers are flat.
    """

    position: wp.array(dtype=wp.vec3)
    motion: wp.array(dtype=wp.vec3)
    normal: wp.array(dtype=wp.vec3)
    shading_normal: wp.array(dtype=wp.vec3)
    receiver: wp.array(dtype=wp.int32)


def has_shading_normals(queries: QueryArrays) -> bool:
    """Whether queries have shading normals of their own."""
    return queries.shading_normal is not None and queries.shading_normal.shape[0] > 0


def rows_of(queries: QueryArrays, rows: np.ndarray, launcher: Launcher) -> QueryArrays:
    """Some of the queries, by index, shape [m]."""
    out = QueryArrays()
    for name in ("position", "normal", "motion", "shading_normal"):
        array = getattr(queries, name)
        given = array is not None and array.shape[0] > 0
        some = launcher.array(launcher.rows_of(array, rows), wp.vec3) if given else launcher.zeros(0, wp.vec3)
        setattr(out, name, some)
    out.receiver = launcher.array(launcher.rows_of(queries.receiver, rows), wp.int32)
    return out


@wp.struct
class IrradianceArrays:
    """Irradiance [W per square tracer unit], flux-weighted sum of D_t x, sum of weights, overlapping footprints."""

    irradiance: wp.array(dtype=wp.vec3)
    motion: wp.array(dtype=wp.vec3)
    weight: wp.array(dtype=wp.float32)
    photons: wp.array(dtype=wp.int32)


@dataclass(frozen=True)
class Lookup:
    """When queries look, and what is wanted beside irradiance.

    Attributes:
        time: When the queries stand where they are, in the shutter (−½ … ½).
        window: Middle and length of the part of the shutter that they stand for (it holds ``time``). What a pixel sees
            correlates with when it sees it, so its samples share the shutter out between them.
        own_times: Time, and middle of the window, of each query in the place of those, shape [n, 2]; all windows are as
            long. None where all look at the same time.
        query_moves: Whether queries carry their motion.
        with_motion: Whether the flux-weighted D_t x and the number of footprints are wanted.
    """

    time: float = 0.0
    window: tuple[float, float] = (0.0, 1.0)
    query_moves: bool = False
    with_motion: bool = False
    own_times: np.ndarray | None = None

    @property
    def is_whole(self) -> bool:
        """Whether queries stand still and look over the whole shutter."""
        return self.window == (0.0, 1.0) and not self.query_moves

    def of_rows(self, rows: np.ndarray) -> Lookup:
        """The same for some of the queries, by index."""
        return self if self.own_times is None else replace(self, own_times=self.own_times[rows])

    def windows(self) -> np.ndarray:
        """Time, and middle and length of the window, of each query, or in one row those of all; shape [n, 3]."""
        if self.own_times is None:
            return np.array([(self.time, *self.window)])
        return np.column_stack([self.own_times, np.full(len(self.own_times), self.window[1])])


@dataclass
class Irradiance:
    """Irradiance at queries, in the tracer's units.

    Attributes:
        irradiance: W per square unit, shape [n, 3].
        motion: Sum of D_t x over the whole shutter weighted by ``weight``, [n, 3]; None unless asked for.
        weight: Sum of weights, [n].
        photons: Footprints overlapping, [n].
    """

    irradiance: np.ndarray
    motion: np.ndarray | None = None
    weight: np.ndarray | None = None
    photons: np.ndarray | None = None

    def add(self, more: Irradiance, rows: np.ndarray | slice = slice(None)) -> None:
        """Adds the light of other footprints, all that is asked for; its irradiance to those ``rows``."""
        self.irradiance[rows] += more.irradiance
        if self.motion is not None:
            self.motion += more.motion
            self.weight += more.weight
            self.photons += more.photons


def scattered(parts: Sequence[tuple[np.ndarray, Irradiance]]) -> Irradiance:
    """The irradiance at queries of which each is in one of several ``parts``: their rows, and what was found there."""
    rows = np.concatenate([rows for rows, _ in parts])
    place = np.argsort(rows)

    def column(name: str) -> np.ndarray | None:
        columns = [getattr(found, name) for _, found in parts]
        return None if columns[0] is None else np.concatenate(columns)[place]

    return Irradiance(*map(column, ("irradiance", "motion", "weight", "photons")))
