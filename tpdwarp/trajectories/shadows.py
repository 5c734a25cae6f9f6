"""Cells that the shadow of something opaque passes over between two instants, and are lit at both.

A stick that passes before a lens shadows a stripe of the light that the lens bends, and keyframes show where it is at
three times. Photons say nothing of it: what meets something opaque first is no caustic. So its edges are projected onto
the light, and pass over the cells on their way: those of what is nearer to the light than all that is specular, and
those beside cells that are dark at one instant and lit at another.

Beyond the paper.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tpdwarp.photons.lattice_shape import specular_faces, turned
from tpdwarp.photons.lattices import EmissionPlan, Lattice
from tpdwarp.scene.description import LightAtShutter, MeshAtShutter, SceneAtShutter
from tpdwarp.scene.light_places import split_lights
from tpdwarp.scene.normalization import Normalization
from tpdwarp.trajectories.retraced import Window, grown
from tpdwarp.trajectories.swept import mark_ways

# Cells that ride by less within the shutter do not move beneath what is at rest.
LARGEST_SHIFT = 0.5
# What comes from farther, in sizes of the window, has gone within a part of the shutter. Chosen, not derived.
FARTHEST = 2.0


def shadowed_ways(
    scene: SceneAtShutter,
    plan: EmissionPlan,
    number: int,
    window: Window,
    part: float,
    shifts: np.ndarray,
    dark: np.ndarray,
    duration: float,
    share: float,
) -> np.ndarray:
    """Which cells of ``window`` edges of shadows pass over around an instant, shape [u, v].

    Args:
        scene: At that instant, over ``duration`` of the shutter.
        plan, number: Which of its lattices.
        part: When, −½ … ½: cells lie where they ride to along ``shifts`` over the whole shutter, shape [u, v, 2].
        dark: Cells that are lit at other times but not then, shape [u, v].
        share: How long before and after it is asked, as a part of the shutter.
    """
    passed = window.grid(dtype=bool)
    lattice = plan.lattices[number]
    lights = [light for light in split_lights(scene, plan.cuts).lights if light.path == lattice.light]
    still = np.abs(shifts).max() <= LARGEST_SHIFT and not any(light.moves for light in lights)
    shading = [mesh for mesh in scene.meshes if not specular_faces(mesh).all() and (mesh.moves or not still)]
    if not lights or not shading:
        return passed
    light, norm = lights[0], plan.normalization
    nearest = min(
        (np.nanmin(_places(mesh, 0.0, light, lattice, norm)[:, 2]) for mesh in scene.meshes if mesh.specular),
        default=np.inf,
    )
    near = grown(dark)
    for mesh in shading:
        ends = [_places(mesh, side, light, lattice, norm) for side in (-0.5, 0.5)]
        moved = share / duration * (ends[1] - ends[0])[:, :2]
        # What passes beside the window may come into it.
        beside = np.nanmax(np.abs(moved), axis=0, initial=0.0) + share * np.abs(shifts).max(axis=(0, 1))
        beside = np.minimum(beside, FARTHEST * window.size)
        places, ways, edges = _along_edges(mesh.triangles[~specular_faces(mesh)], ends, window, beside)
        # Where these places ride to in the middle of the shutter, and how they go on among cells that ride.
        riding = shifts[window.at(np.floor(places[:, :2]).astype(np.int64))].astype(np.float64)
        cells = np.floor(places[:, :2] - part * riding).astype(np.int64)
        counts = window.holds(cells) & near[window.at(cells)] | (places[:, 2] < nearest)
        # What slides along an edge is at the same place on the light.
        ways, edges = (ways[:, :2] / duration - riding)[counts], edges[counts]
        ways -= np.sum(ways * edges, axis=1, keepdims=True) * edges
        mark_ways(passed, cells[counts] - window.first, share * ways)
    return passed


def _places(
    mesh: MeshAtShutter, side: float, light: LightAtShutter, lattice: Lattice, normalization: Normalization
) -> np.ndarray:
    """Where on a lattice vertices lie as their scene's shutter opens (−½) or closes (½), in cells, and how far along
    the light, shape [v, 3]; NaN of what a patch of directions does not show."""
    points = mesh.points if mesh.motions is None else mesh.points + np.float32(side) * mesh.motions
    points = normalization.points(points).astype(np.float64)
    if lattice.axes is None:
        axes = light.axes + side * light.axes_motion
        local = points @ turned(axes / np.linalg.norm(axes, axis=1, keepdims=True), lattice.turn).T
        uv, along = local[:, :2], -local[:, 2]
    else:
        local = points - normalization.points((light.position + side * light.position_motion)[None])[0]
        along = np.linalg.norm(local, axis=1)
        local = local @ lattice.axes.T
        shown = local[:, 2:] > np.finfo(np.float32).tiny
        uv = np.arctan(np.divide(local[:, :2], local[:, 2:], out=np.full((len(local), 2), np.nan), where=shown))
    return np.column_stack([(uv - lattice.origin) / lattice.step, along])


def _along_edges(
    triangles: np.ndarray, ends: Sequence[np.ndarray], window: Window, beside: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places along what edges of triangles have near ``window``, at most a cell apart, their ways, both [n, 3], and
    unit directions of the edges on the lattice, shape [n, 2].

    Args:
        beside: How far beside it they may lie, in cells, shape [2].
        ends: Where vertices lie before and after their way, shape [v, 3] each.
    """
    middle, way = 0.5 * (ends[0] + ends[1]), ends[1] - ends[0]
    low, high = window.first - 1.0 - beside, window.first + window.size + 1.0 + beside
    corners = middle[triangles, :2]
    # Comparisons with NaN are false.
    triangles = triangles[np.all((corners.max(axis=1) >= low) & (corners.min(axis=1) <= high), axis=1)]
    edges = np.sort(triangles[:, ((0, 1), (1, 2), (2, 0))].reshape(-1, 2), axis=1).astype(np.int64)
    a, b = np.divmod(np.unique(edges[:, 0] * len(middle) + edges[:, 1]), len(middle))
    start, away = middle[a, :2], middle[b, :2] - middle[a, :2]
    # What is parallel to a side lies between that and the other one all along, or nowhere.
    away = np.where(away == 0.0, np.finfo(np.float64).tiny, away)
    with np.errstate(over="ignore"):
        passes = np.stack([(side - start) / away for side in (low, high)])
    first = passes.min(axis=0).max(axis=1).clip(0.0, 1.0)
    last = passes.max(axis=0).min(axis=1).clip(0.0, 1.0)
    met = last > first
    a, b, first, last = a[met], b[met], first[met], last[met]
    length = (last - first) * np.abs(away[met]).max(axis=1)
    counts = np.ceil(length).astype(np.int64) + 1
    edge = np.repeat(np.arange(len(a)), counts)
    step = np.arange(len(edge)) - np.repeat(np.cumsum(counts) - counts, counts)
    along = first[edge] + (last - first)[edge] * step / np.maximum(counts[edge] - 1, 1)
    places, ways = (values[a[edge]] + along[:, None] * (values[b] - values[a])[edge] for values in (middle, way))
    directions = away[met] / np.linalg.norm(away[met], axis=1, keepdims=True).clip(np.finfo(np.float64).tiny)
    return places, ways, directions[edge]
