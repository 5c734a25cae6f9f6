"""Light from all around: seen where nothing else is, and cast directly from directions of equal luminance."""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.scene.description import DomeAtShutter, Interaction, Texture, Wrap
from tpdwarp.scene.device.geometry import Surfaces
from tpdwarp.scene.device.intersection import is_plane_left, occluded, plane_of
from tpdwarp.scene.device.presence import presence_at
from tpdwarp.scene.device.ray_tree import first_met
from tpdwarp.scene.device.textures import TextureArrays, filtered, packed_textures
from tpdwarp.scene.normalization import Normalization
from tpdwarp.view.lights import FAR

# Parts of nearly equal luminance that a dome is cut into; of uniform ones each is 6° across. Chosen, not derived.
PARTS = 1024
# Shadow rays of one camera sample. Chosen, not derived: under a uniform dome half of them go up, and four samples a
# pixel of them err by about 1/√32 of what varies.
DOME_RAYS = wp.constant(16)
# Layers of glass that a shadow ray passes; more hide the dome.
MOST_LAYERS = wp.constant(16)
DIELECTRIC = wp.constant(int(Interaction.DIELECTRIC))
# Beyond a layer of glass a shadow ray begins so much farther on, in scenes of unit size: some roundings.
STEP = wp.constant(1.0e-5)
# An angle as a part of a whole turn and of half of one: 1/(2π) and 1/π.
PART_OF_TURN, PART_OF_HALF_TURN = wp.constant(0.15915494), wp.constant(0.31830989)
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


@wp.struct
class DomeArrays:
    """Domes in the tracer's units.

    ``axes`` has rows x, y, z of each, whose picture (a texture of the same number) is to be multiplied by ``unit``.
    ``directions`` point at parts of equal luminance, neighbours by turns side by side, which give ``irradiances`` at
    normal incidence.
    """

    axes: wp.array(dtype=wp.mat33)
    units: wp.array(dtype=wp.float32)
    pictures: TextureArrays
    directions: wp.array(dtype=wp.vec3)
    irradiances: wp.array(dtype=wp.vec3)


def dome_arrays(domes: Sequence[DomeAtShutter], normalization: Normalization, launcher: Launcher) -> DomeArrays:
    """The kernel's view of ``domes``, of which there is at least one."""
    unit = 1.0 / (normalization.power * normalization.scale**2)
    # Half precision ends at 65504: pictures are stored as parts of their brightest value.
    peaks = [max(float(dome.radiance.max()), 1e-30) for dome in domes]
    textures = tuple(
        Texture({(0, 0): (dome.radiance / peak).astype(np.float16)}, (Wrap.REPEAT, Wrap.CLAMP))
        for dome, peak in zip(domes, peaks, strict=True)
    )
    parts = [strata(dome) for dome in domes]
    out = DomeArrays()
    out.axes = launcher.array(np.array([dome.axes for dome in domes], np.float32).reshape(-1, 3, 3), wp.mat33)
    out.units = launcher.array(np.array(peaks, np.float32) * np.float32(unit), wp.float32)
    out.pictures = packed_textures(textures, launcher)
    directions, irradiances = (np.concatenate(rows).astype(np.float32) for rows in zip(*parts, strict=True))
    out.directions = launcher.array(directions, wp.vec3)
    out.irradiances = launcher.array(np.float32(unit) * irradiances, wp.vec3)
    return out


def strata(dome: DomeAtShutter) -> tuple[np.ndarray, np.ndarray]:
    """Directions [n, 3] to parts of a dome of nearly equal luminance, and the irradiance [n, 3] that each gives.

    The brightest part of the picture is cut in two where its luminance is halved, across its longer side, until there
    are enough (median cut, Debevec 2005). Parts side by side in the order are so in the picture.
    """
    height, width = dome.radiance.shape[:2]
    edges = np.linspace(0.5 * math.pi, -0.5 * math.pi, height + 1)
    solid = (np.sin(edges[:-1]) - np.sin(edges[1:])) * (2.0 * math.pi / width)
    energy = dome.radiance.astype(np.float64) * solid[:, None, None]
    latitude = np.arcsin(0.5 * (np.sin(edges[:-1]) + np.sin(edges[1:])))[:, None]
    longitude = math.pi * (1.0 - 2.0 * (np.arange(width) + 0.5) / width)[None, :]
    local = np.stack(
        np.broadcast_arrays(
            np.sin(longitude) * np.cos(latitude), np.sin(latitude), np.cos(longitude) * np.cos(latitude)
        ),
        axis=-1,
    )
    luminance = energy @ LUMINANCE
    # Sums from the corner: weighted directions and energy of any rectangle are four look-ups.
    table = np.zeros((height + 1, width + 1, 7))
    stacked = np.concatenate([luminance[..., None], local * luminance[..., None], energy], axis=-1)
    table[1:, 1:] = stacked.cumsum(axis=0).cumsum(axis=1)
    boxes = _parts(table[..., 0], (0, height, 0, width, 1.0))
    if not boxes:
        return np.zeros((0, 3)), np.zeros((0, 3))
    top, bottom, left, right, share = np.array(boxes).T
    top, bottom, left, right = (side.astype(int) for side in (top, bottom, left, right))
    sums = table[bottom, right] - table[top, right] - table[bottom, left] + table[top, left]
    lengths = np.linalg.norm(sums[:, 1:4], axis=1, keepdims=True)
    # Light from all sides of a box has no direction of its own.
    clear = lengths > 1e-12 * float(luminance.sum())
    middle = local[(top + bottom) // 2 % height, (left + right) // 2 % width]
    directions = np.where(clear, sums[:, 1:4] / np.where(clear, lengths, 1.0), middle)
    return directions @ dome.axes, np.maximum(sums[:, 4:], 0.0) * share[:, None]


Box = tuple[int, int, int, int, float]


def _parts(table: np.ndarray, whole: Box) -> list[Box]:
    """Rectangles (top, bottom, left, right) of nearly equal luminance, each with the share of its light it stands for.

    Args:
        table: Sums of luminance from the corner.
        whole: The rectangle that is cut.
    """

    def luminance(box: Box) -> float:
        top, bottom, left, right, share = box
        return share * float(table[bottom, right] - table[top, right] - table[bottom, left] + table[top, left])

    # What is cut remembers its halves, so that they can be read in order.
    boxes, halves = [whole], {}
    queue = [(-luminance(whole), 0)]
    least = 1e-12 * max(-queue[0][0], 1e-300)
    while queue and len(queue) < PARTS:
        _, number = heapq.heappop(queue)
        halves[number] = []
        for half in _cut(table, *boxes[number]):
            # What is dark needs no ray.
            if luminance(half) > least:
                halves[number].append(len(boxes))
                heapq.heappush(queue, (-luminance(half), len(boxes)))
                boxes.append(half)
    ordered, stack = [], [0]
    while stack:
        number = stack.pop()
        if number in halves:
            stack += halves[number][::-1]
        elif luminance(boxes[number]) > 0:
            ordered.append(boxes[number])
    return ordered


def _cut(table: np.ndarray, top: int, bottom: int, left: int, right: int, share: float) -> list[Box]:
    """The two halves of a rectangle of equal luminance; a single pixel twice, with half of its light each."""
    if bottom - top == 1 and right - left == 1:
        return [(top, bottom, left, right, 0.5 * share)] * 2
    # Rows are as high as columns are wide.
    if bottom - top >= right - left:
        rows = np.arange(top, bottom + 1)
        at = top + _half(table[rows, right] - table[rows, left])
        return [(top, at, left, right, share), (at, bottom, left, right, share)]
    columns = np.arange(left, right + 1)
    at = left + _half(table[bottom, columns] - table[top, columns])
    return [(top, bottom, left, at, share), (top, bottom, at, right, share)]


def _half(sums: np.ndarray) -> int:
    """Where a row of sums from one end comes nearest to its half; neither end."""
    inner = sums[1:-1] - 0.5 * (sums[0] + sums[-1])
    return 1 + int(np.argmin(np.abs(inner)))


@wp.func
def place_in_picture(local: wp.vec3) -> wp.vec2:
    """Coordinates (s, t) in a picture by latitude and longitude, of a direction in the dome's own axes."""
    return wp.vec2(
        0.5 - PART_OF_TURN * wp.atan2(local[0], local[2]),
        0.5 + PART_OF_HALF_TURN * wp.asin(wp.clamp(local[1], -1.0, 1.0)),
    )


@wp.func
def dome_radiance(domes: DomeArrays, w: wp.vec3) -> wp.vec3:
    """Radiance that arrives against the direction ω."""
    total = wp.vec3(0.0, 0.0, 0.0)
    none = wp.vec2(0.0, 0.0)
    for k in range(domes.units.shape[0]):
        total += domes.units[k] * filtered(domes.pictures, k, place_in_picture(domes.axes[k] * w), none, none, 0.0)
    return total


@wp.func
def dome_radiance_about(domes: DomeArrays, w: wp.vec3, solid_angle: float) -> wp.vec3:
    """Mean radiance over so much of the sky about the direction against which it arrives."""
    total = wp.vec3(0.0, 0.0, 0.0)
    side = wp.sqrt(solid_angle)
    for k in range(domes.units.shape[0]):
        local = domes.axes[k] * w
        round = wp.sqrt(wp.max(1.0 - local[1] * local[1], 0.0))
        across = wp.vec2(wp.min(PART_OF_TURN * side / wp.max(round, 1.0e-6), 1.0), 0.0)
        down = wp.vec2(0.0, PART_OF_HALF_TURN * side)
        total += domes.units[k] * filtered(domes.pictures, k, place_in_picture(local), across, down, 0.0)
    return total


@wp.func
def hidden_from_dome(
    surfaces: Surfaces, textures: TextureArrays, partial: bool, x: wp.vec3, w: wp.vec3, offset: wp.vec3
) -> bool:
    """Whether anything but glass stands between x and what lies far along ω; what is there by less than half is not."""
    if not occluded(surfaces, x, w, offset, FAR):
        return False
    side = wp.normalize(offset)
    reach = wp.length(offset)
    start = float(0.0)
    for _layer in range(MOST_LAYERS):
        met = first_met(surfaces.tree, x + offset + start * w, w, FAR)
        if met.triangle < 0:
            return False
        clear = surfaces.interaction[surfaces.material_of[met.triangle]] == DIELECTRIC
        if partial and not clear:
            beta = wp.vec3(met.u, met.v, 1.0 - met.u - met.v)
            clear = presence_at(surfaces, textures, met.triangle, beta) < 0.5
        if not clear and not is_plane_left(plane_of(surfaces, met.triangle), x, side, reach):
            return True
        start += met.distance + STEP
    return True


@wp.func
def dome_irradiance(
    surfaces: Surfaces,
    textures: TextureArrays,
    partial: bool,
    domes: DomeArrays,
    x: wp.vec3,
    n: wp.vec3,
    n_g: wp.vec3,
    offset: wp.vec3,
    place: float,
) -> wp.vec3:
    """Irradiance from the domes, by a few of their parts evenly spread; ``place`` in 0 … 1 chooses which."""
    total = wp.vec3(0.0, 0.0, 0.0)
    count = domes.directions.shape[0]
    if count == 0:
        return total
    for k in range(DOME_RAYS):
        chosen = int((float(k) + place) * float(count) / float(DOME_RAYS))
        w = domes.directions[wp.min(chosen, count - 1)]
        cosine = wp.dot(n, w)
        if cosine > 0.0 and wp.dot(n_g, w) > 0.0:
            if not hidden_from_dome(surfaces, textures, partial, x, w, offset):
                total += cosine * domes.irradiances[wp.min(chosen, count - 1)]
    return total * (float(count) / float(DOME_RAYS))
