"""What one look of a camera gives: batches of queries for the gather, and for the film what geometry was seen."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tpdwarp.footprints.irradiance import QueryArrays, has_shading_normals
from tpdwarp.view.visibility import PathFlag, VisiblePoints

# What is counted of camera paths.
COUNTED = {
    "views slowed down": PathFlag.TOO_FAST,
    "views of no finite motion": PathFlag.NOT_FINITE,
    "view branches below cutoff": PathFlag.CULLED,
}


@dataclass
class QueryBatch:
    """Visible points on diffuse surfaces that are gathered together.

    Attributes:
        queries: Where they are.
        pixels: Pixel of each, shape [n]: its place in the image, or in the list of pixels looked at.
        weights: Irradiance times this is radiance at the camera, shape [n, 3].
        first: Samples whose first path ends there, shape [n], or parts of samples; none where a later one does.
        window: Middle and length of the part of the shutter they stand for.
        times: When in the shutter (−½ … ½) each stands there, and the middle of its own window, shape [n, 2]; None
            where all look over the same one.
        moves: Whether they move.
    """

    queries: QueryArrays
    pixels: np.ndarray
    weights: np.ndarray
    first: np.ndarray
    window: tuple[float, float] = (0.0, 1.0)
    times: np.ndarray | None = None
    moves: bool = False

    def scaled(self, share: float) -> QueryBatch:
        """The same points, each of which stands for a ``share`` of what it stood for."""
        weights = (share * self.weights).astype(np.float32)
        return replace(self, weights=weights, first=(share * self.first).astype(np.float32))


@dataclass(frozen=True, eq=False)
class SeenPoints:
    """What one pass of camera paths saw: direct light and first surfaces, for the film.

    Attributes:
        points: The paths.
        pixels: Pixel of each, shape [n].
        shares: The part of a sample that each of them stands for, shape [n], or all of them.
    """

    points: VisiblePoints
    pixels: np.ndarray
    shares: np.ndarray | float = 1.0

    def counts(self) -> dict[str, int]:
        """How many paths were not seen as they are, by what is wrong with them."""
        flags = self.points.arrays.flags.numpy()
        numbers = {name: int(np.count_nonzero(flags & flag)) for name, flag in COUNTED.items()}
        return {name: number for name, number in numbers.items() if number}

    def scaled(self, share: float) -> SeenPoints:
        """The same paths, each of which stands for a ``share`` of what it stood for."""
        return replace(self, shares=share * self.shares)


class Rows:
    """Visible points as host arrays, collected pass by pass."""

    def __init__(self) -> None:
        self._columns: dict[str, list[np.ndarray]] = {}

    def add(
        self, points: VisiblePoints, chosen: np.ndarray, items: np.ndarray, slices: np.ndarray, moves: bool
    ) -> None:
        """Adds the ``chosen`` rows of a pass, with their motion or not.

        Args:
            items: The sample of each row, or its part of one, shape [n].
            slices: The time slice that each looks in.
        """
        if not len(chosen):
            return
        values = columns_of(points.queries, chosen, moves)
        values["weight"] = points.arrays.weight.numpy()[chosen]
        values["item"] = items[chosen]
        values["slice"] = slices[values["item"]]
        values["first"] = np.full(len(chosen), int(points.first), np.int32)
        for name, rows in values.items():
            self._columns.setdefault(name, []).append(rows)

    def joined(self, wanted: np.ndarray) -> dict[str, np.ndarray]:
        """The rows of ``wanted`` [items], what lies together in the image together; {} if none."""
        joined = {name: np.concatenate(parts) for name, parts in self._columns.items()}
        if not joined:
            return {}
        items = joined["item"]
        rows = np.flatnonzero(wanted[items])
        return chosen_rows(joined, rows[np.argsort(items[rows], kind="stable")]) if len(rows) else {}


def columns_of(queries: QueryArrays, rows: np.ndarray, moves: bool) -> dict[str, np.ndarray]:
    """Where some queries are and what they lie on, on the host, with their motion or not."""
    names = ["position", "normal", "receiver", *(["motion"] if moves else [])]
    if has_shading_normals(queries):
        names.append("shading_normal")
    return {name: getattr(queries, name).numpy()[rows] for name in names}


def chosen_rows(rows: dict[str, np.ndarray], which: np.ndarray) -> dict[str, np.ndarray]:
    """Some rows of each column."""
    return {name: values[which] for name, values in rows.items()}
