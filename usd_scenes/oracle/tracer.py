"""A brute-force photon tracer through moving surfaces, float64, for any time of each ray.

At every specular surface one branch is followed. Positions, directions and the Fresnel factor of the chosen branches
come back together with the *path* taken, which can be given to a later trace to keep to the same primitives and
branches: the smooth function whose derivatives photon differentials are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from tpdwarp.scene.description import Interaction

from .optics import dot, facing, reflectance, reflected, refracted, unit
from .surfaces import Surface

Choices = str | Sequence[str]
PER_SURFACE = ("surfaces", "primitives", "barycentrics", "points", "distances", "transmitted")


@dataclass(frozen=True, eq=False)
class Path:
    """Where photons went. ``b`` counts surfaces met, the diffuse receiver included.

    Attributes:
        positions: Points on the diffuse receivers, shape [n, 3]; NaN where none was reached.
        directions: Unit directions of travel on arrival, shape [n, 3].
        normals: Unit geometric normals of the receivers, against the rays, shape [n, 3].
        throughput: Product of the Fresnel factors of the branches taken, shape [n]; mirrors count as 1, tints as none.
        landed: Whether a diffuse receiver was reached, shape [n].
        bounces: Specular surfaces met before the receiver, shape [n].
        surfaces: Index of the surface met, shape [b, n]; −1 after the end.
        primitives: Triangle (or root of an analytic surface) met, shape [b, n].
        barycentrics: Of the hits on meshes, shape [b, n, 3]; NaN elsewhere.
        points: Hit points, shape [b, n, 3].
        distances: Distance from the point before, shape [b, n].
        transmitted: Whether the refracted branch was taken, shape [b, n].
    """

    positions: np.ndarray
    directions: np.ndarray
    normals: np.ndarray
    throughput: np.ndarray
    landed: np.ndarray
    bounces: np.ndarray
    surfaces: np.ndarray
    primitives: np.ndarray
    barycentrics: np.ndarray
    points: np.ndarray
    distances: np.ndarray
    transmitted: np.ndarray

    @classmethod
    def empty(cls, count: int, depth: int) -> Path:
        """A path of no surfaces for ``count`` rays of at most ``depth`` surfaces."""
        return cls(
            positions=np.full((count, 3), np.nan),
            directions=np.full((count, 3), np.nan),
            normals=np.full((count, 3), np.nan),
            throughput=np.ones(count),
            landed=np.zeros(count, dtype=bool),
            bounces=np.zeros(count, dtype=int),
            surfaces=np.full((depth, count), -1),
            primitives=np.full((depth, count), -1),
            barycentrics=np.full((depth, count, 3), np.nan),
            points=np.full((depth, count, 3), np.nan),
            distances=np.full((depth, count), np.nan),
            transmitted=np.zeros((depth, count), dtype=bool),
        )

    def rays(self, chosen: np.ndarray) -> Path:
        """The paths of some rays, chosen by mask or index."""
        return Path(**{f.name: getattr(self, f.name)[_index(f.name, chosen)] for f in fields(self)})

    def put(self, chosen: np.ndarray, other: Path) -> None:
        """Writes the paths of ``other`` into the rays ``chosen`` [k] of this one."""
        for f in fields(self):
            getattr(self, f.name)[_index(f.name, chosen)] = getattr(other, f.name)

    def first(self, depth: int) -> Path:
        """The paths up to their ``depth``-th surface, to be traced along."""
        return replace(self, **{name: getattr(self, name)[:depth] for name in PER_SURFACE})


def _index(name: str, chosen: np.ndarray) -> np.ndarray | tuple[slice, np.ndarray]:
    return (slice(None), chosen) if name in PER_SURFACE else chosen


def trace(
    scene: Sequence[Surface],
    origins: np.ndarray,
    directions: np.ndarray,
    t: np.ndarray | float,
    choices: Choices = "auto",
    max_bounces: int = 16,
    along: Path | None = None,
) -> Path:
    """Follows photons to the first diffuse surface.

    Args:
        scene: Surfaces; light is assumed to start outside all of them.
        origins: Shape [n, 3].
        directions: Shape [n, 3]; need not be unit.
        t: Time of each ray, shape [n], or one time. Each distinct time costs a pass.
        choices: Branch at the k-th dielectric or mirror met: ``refract`` (the photon ends where light is totally
            reflected), ``reflect``, or ``auto`` (refract, or reflect where it must). One for all, or one a bounce, of
            which the last is repeated.
        max_bounces: Specular surfaces after which a photon is given up.
        along: A path to keep to: the same surfaces, triangles continued beyond their edges, and branches, ray by ray.

    Returns:
        The paths; positions are NaN where a photon did not land.
    """
    origins = np.array(origins, dtype=np.float64).reshape(-1, 3)
    directions = unit(np.array(directions, dtype=np.float64).reshape(-1, 3))
    times = np.broadcast_to(np.asarray(t, dtype=np.float64), len(origins))
    depth = max_bounces + 1 if along is None else along.surfaces.shape[0]
    path = Path.empty(len(origins), depth)
    for time in np.unique(times):
        rays = np.flatnonzero(times == time)
        part = None if along is None else along.rays(rays)
        path.put(rays, _trace_at(scene, origins[rays], directions[rays], float(time), choices, depth, part))
    return path


def _trace_at(
    scene: Sequence[Surface],
    origins: np.ndarray,
    directions: np.ndarray,
    t: float,
    choices: Choices,
    depth: int,
    along: Path | None,
) -> Path:
    """Follows rays of one time."""
    path = Path.empty(len(origins), depth)
    alive = np.arange(len(origins))
    positions, directions = origins.copy(), directions.copy()
    for b in range(depth):
        surface_ids, primitives, distances = _next_hits(scene, positions, directions, t, path, along, b, alive)
        hit = surface_ids >= 0
        alive, surface_ids, primitives, distances = alive[hit], surface_ids[hit], primitives[hit], distances[hit]
        if len(alive) == 0:
            break
        positions[alive] += distances[:, None] * directions[alive]
        path.surfaces[b, alive], path.primitives[b, alive] = surface_ids, primitives
        path.points[b, alive], path.distances[b, alive] = positions[alive], distances
        goes_on = np.zeros(len(origins), dtype=bool)
        for index, surface in enumerate(scene):
            rays = alive[surface_ids == index]
            if len(rays) == 0:
                continue
            geometric, shading, barycentrics = surface.frame(positions[rays], path.primitives[b, rays], t)
            path.barycentrics[b, rays] = barycentrics
            if surface.interaction == Interaction.DIFFUSE:
                path.positions[rays], path.directions[rays] = positions[rays], directions[rays]
                path.normals[rays] = facing(geometric, directions[rays])
                path.landed[rays] = np.isfinite(positions[rays]).all(axis=1)
                continue
            choice = choices if isinstance(choices, str) else choices[min(b, len(choices) - 1)]
            forced = None if along is None else along.transmitted[b, rays]
            outgoing, factor, transmitted = _scatter(surface, directions[rays], geometric, shading, choice, forced)
            directions[rays] = outgoing
            path.throughput[rays] *= factor
            path.transmitted[b, rays] = transmitted
            path.bounces[rays] += 1
            goes_on[rays] = np.isfinite(outgoing).all(axis=1)
        alive = alive[goes_on[alive]]
    return path


def _next_hits(
    scene: Sequence[Surface],
    positions: np.ndarray,
    directions: np.ndarray,
    t: float,
    path: Path,
    along: Path | None,
    b: int,
    alive: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Surface, primitive and distance of the b-th hit of the rays ``alive`` [k]; surface −1 where there is none."""
    o, d = positions[alive], directions[alive]
    if along is not None:
        surface_ids, primitives = along.surfaces[b, alive], along.primitives[b, alive]
        distances = np.full(len(alive), np.nan)
        for index, surface in enumerate(scene):
            rows = surface_ids == index
            if rows.any():
                distances[rows] = surface.distances(
                    primitives[rows], o[rows], d[rows], t, along.distances[b, alive][rows]
                )
        return surface_ids, primitives, distances
    surface_ids, primitives = np.full(len(alive), -1), np.full(len(alive), -1)
    distances = np.full(len(alive), np.inf)
    for index, surface in enumerate(scene):
        leaving = np.full(len(alive), -1)
        if b > 0:
            leaving = np.where(path.surfaces[b - 1, alive] == index, path.primitives[b - 1, alive], -1)
        found, primitive = surface.intersect(o, d, t, leaving)
        nearer = found < distances
        surface_ids[nearer], primitives[nearer], distances[nearer] = index, primitive[nearer], found[nearer]
    return surface_ids, primitives, distances


def _scatter(
    surface: Surface,
    directions: np.ndarray,
    geometric: np.ndarray,
    shading: np.ndarray,
    choice: str,
    forced: np.ndarray | None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Directions [n, 3] after a specular surface, Fresnel factors [n], and whether light went through [n]."""
    normals = facing(shading, directions)
    mirrored = reflected(directions, normals)
    if surface.interaction == Interaction.MIRROR:
        return mirrored, np.ones(len(directions)), np.zeros(len(directions), dtype=bool)
    eta = np.where(dot(geometric, directions) < 0, 1 / surface.ior, surface.ior)
    through = refracted(directions, normals, eta)
    reflects = reflectance(np.abs(dot(directions, normals)), eta)
    if forced is not None:
        transmitted = forced
    elif choice == "reflect":
        transmitted = np.zeros(len(directions), dtype=bool)
    elif choice == "refract":
        transmitted = np.ones(len(directions), dtype=bool)
    elif choice == "auto":
        transmitted = np.isfinite(through).all(axis=1)
    else:
        raise ValueError(f"a branch is refract, reflect or auto, not {choice!r}")
    outgoing = np.where(transmitted[:, None], through, mirrored)
    return outgoing, np.where(transmitted, 1 - reflects, reflects), transmitted
