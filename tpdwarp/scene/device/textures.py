"""Textures on the device: pictures with their halves, and filtered look-ups in them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.io.resampling import part_reaching, pyramid
from tpdwarp.scene.description import Material, MeshAtShutter, Texture, Wrap
from tpdwarp.scene.device.intersection import Hit

REPEAT = wp.constant(int(Wrap.REPEAT))
CLAMP = wp.constant(int(Wrap.CLAMP))
MIRROR = wp.constant(int(Wrap.MIRROR))
BORDER = wp.constant(int(Wrap.BORDER))
# Look-ups along the longer side of what a sample sees; where that is longer still beside the other, it is blurred.
# Chosen, not derived: as many as graphics cards take.
MOST_TAPS = wp.constant(16)
# Less than this of a surface is nothing of it, and all but this is all of it. Half a step of eight bits.
LEAST_SHARE = wp.constant(2.0e-3)
# What differs over a surface, by its name in the description of a material.
MAPS = (
    "texture", "cutout", "normal_map", "diffuse_map", "transmittance_map", "roughness_map", "emission_map", "metal_map",
)  # fmt: skip
# A surface seen at less than this cosine is filtered as if at it. Chosen, not derived.
STEEPEST = wp.constant(1.0e-3)


@wp.struct
class TextureArrays:
    """Texture coordinates of triangles, and the textures of materials.

    ``texture_of``, ``cutout_of`` and the like are −1 for a material without one; ``presences``, ``thresholds``,
    ``diffuse_shares``, ``metals``, ``transmittances``, ``absorptions`` (by the tracer's unit of length) and
    ``emissions`` (in its unit of radiance) are as in :class:`tpdwarp.scene.description.Material`, and so are
    ``thin_walls`` (1 for a sheet), ``lamps`` and ``roughnesses``; ``medium_absorptions`` are those of nested media. A
    texture has a grid of tiles (its columns, rows and first tile), a tile its levels (the first of them and their
    number; none where it is missing), a level its width, height and first texel. Rows of texels go from t = 1 down. Of
    a cut-out with a threshold the first level is the picture, and the others hold what part of each texel reaches it.
    """

    coordinates: wp.array(dtype=wp.vec2)
    coordinate_indices: wp.array(dtype=wp.vec3i)
    texture_of: wp.array(dtype=wp.int32)
    cutout_of: wp.array(dtype=wp.int32)
    normal_map_of: wp.array(dtype=wp.int32)
    diffuse_map_of: wp.array(dtype=wp.int32)
    transmittance_map_of: wp.array(dtype=wp.int32)
    roughness_map_of: wp.array(dtype=wp.int32)
    emission_map_of: wp.array(dtype=wp.int32)
    metal_map_of: wp.array(dtype=wp.int32)
    presences: wp.array(dtype=wp.float32)
    thresholds: wp.array(dtype=wp.float32)
    diffuse_shares: wp.array(dtype=wp.float32)
    metals: wp.array(dtype=wp.float32)
    transmittances: wp.array(dtype=wp.vec3)
    absorptions: wp.array(dtype=wp.vec3)
    emissions: wp.array(dtype=wp.vec3)
    radiance_unit: float
    thin_walls: wp.array(dtype=wp.int32)
    lamps: wp.array(dtype=wp.int32)
    roughnesses: wp.array(dtype=wp.float32)
    medium_absorptions: wp.array(dtype=wp.vec3)
    grids: wp.array(dtype=wp.vec3i)
    wraps: wp.array(dtype=wp.vec2i)
    borders: wp.array(dtype=wp.vec3)
    tiles: wp.array(dtype=wp.vec2i)
    levels: wp.array(dtype=wp.vec3i)
    texels: wp.array(dtype=wp.vec3h)


class TextureStore:
    """The textures of an animation on the device, made anew only where a frame has others than the last."""

    def __init__(self, launcher: Launcher) -> None:
        self._launcher = launcher
        self._textures: tuple[Texture, ...] = ()
        self._arrays = TextureArrays()

    def arrays(
        self,
        meshes: Sequence[MeshAtShutter],
        materials: Sequence[Material],
        scale: float = 1.0,
        power: float = 1.0,
        media: Sequence[Material] = (),
    ) -> TextureArrays:
        """The kernel's view of the textures.

        Args:
            meshes: The meshes of a scene, in the order of its triangles.
            materials: Its materials, in the order of the kernel's.
            scale: The tracer's units of length in a scene unit.
            power: The tracer's unit of power.
            media: What nested media are made of.
        """
        launcher = self._launcher
        used = [texture for m in materials for name in MAPS if (texture := getattr(m, name)) is not None]
        numbers = {texture: k for k, texture in enumerate(dict.fromkeys(used))}
        if tuple(numbers) != self._textures:
            thresholds = {m.cutout: m.threshold for m in materials if m.cutout is not None}
            self._arrays = packed_textures(tuple(numbers), launcher, thresholds)
            self._textures = tuple(numbers)
        arrays = TextureArrays()
        for name in ("grids", "wraps", "borders", "tiles", "levels", "texels"):
            setattr(arrays, name, getattr(self._arrays, name))
        coordinates, indices, count = [np.zeros((0, 2))], [np.zeros((0, 3), np.int32)], 0
        for mesh in meshes:
            own = mesh.coordinate_indices
            indices.append(np.full((len(mesh.triangles), 3), -1) if own is None else np.where(own < 0, -1, own + count))
            if mesh.coordinates is not None:
                coordinates.append(mesh.coordinates)
                count += len(mesh.coordinates)
        arrays.coordinates = launcher.array(np.concatenate(coordinates).astype(np.float32), wp.vec2)
        arrays.coordinate_indices = launcher.array(np.concatenate(indices).astype(np.int32), wp.vec3i)
        for name in MAPS:
            textures = [getattr(material, name) for material in materials]
            of = np.array([-1 if texture is None else numbers[texture] for texture in textures], np.int32)
            setattr(arrays, f"{name}_of", launcher.array(of, wp.int32))
        for name in ("presence", "threshold", "diffuse_share", "metal"):
            values = np.array([getattr(material, name) for material in materials], np.float32)
            setattr(arrays, f"{name}s", launcher.array(values, wp.float32))
        for name, own in (("thin_walls", "thin_walled"), ("lamps", "lamp")):
            values = np.array([getattr(material, own) for material in materials], np.int32)
            setattr(arrays, name, launcher.array(values, wp.int32))
        widths = np.array([material.roughness for material in materials], np.float32)
        arrays.roughnesses = launcher.array(widths, wp.float32)
        inside = np.array([material.absorption for material in media]).reshape(-1, 3) / scale
        arrays.medium_absorptions = launcher.array(inside.astype(np.float32), wp.vec3)
        radiance = 1.0 / (scale**2 * power)
        arrays.radiance_unit = radiance
        units = {"transmittance": 1.0, "absorption": 1.0 / scale, "emission": radiance}
        for name, unit in units.items():
            colors = unit * np.array([getattr(material, name) for material in materials])
            setattr(arrays, f"{name}s", launcher.array(colors.astype(np.float32), wp.vec3))
        return arrays


def packed_textures(
    textures: tuple[Texture, ...], launcher: Launcher, thresholds: Mapping[Texture, float] | None = None
) -> TextureArrays:
    """The pictures of textures, by their numbers; without coordinates and materials.

    Args:
        textures: The textures.
        launcher: Their device.
        thresholds: Those of cut-outs, which are all there or not at all; 0 for those that are there in part.
    """
    thresholds = thresholds or {}
    grids, wraps, borders, tiles, levels, texels = [], [], [], [], [], [np.zeros((0, 3), np.float16)]
    texel_count = 0
    for texture in textures:
        columns, rows = (max(place[k] for place in texture.tiles) + 1 for k in (0, 1))
        grids.append((columns, rows, len(tiles)))
        wraps.append(tuple(map(int, texture.wrap)))
        borders.append(texture.border)
        for row in range(rows):
            for column in range(columns):
                pixels = texture.tiles.get((column, row))
                halves = [] if pixels is None else pyramid(pixels)
                if halves and (threshold := thresholds.get(texture, 0.0)) > 0:
                    halves[1:] = pyramid(part_reaching(pixels, threshold))
                tiles.append((len(levels), len(halves)))
                for level in halves:
                    levels.append((level.shape[1], level.shape[0], texel_count))
                    texels.append(level.reshape(-1, 3).astype(np.float16))
                    texel_count += len(texels[-1])
    arrays = TextureArrays()
    arrays.grids = launcher.array(np.array(grids, np.int32).reshape(-1, 3), wp.vec3i)
    arrays.wraps = launcher.array(np.array(wraps, np.int32).reshape(-1, 2), wp.vec2i)
    arrays.borders = launcher.array(np.array(borders, np.float32).reshape(-1, 3), wp.vec3)
    arrays.tiles = launcher.array(np.array(tiles, np.int32).reshape(-1, 2), wp.vec2i)
    arrays.levels = launcher.array(np.array(levels, np.int32).reshape(-1, 3), wp.vec3i)
    arrays.texels = launcher.array(np.concatenate(texels), wp.vec3h)
    return arrays


@wp.func
def on_plane(side: wp.vec3, w: wp.vec3, n: wp.vec3) -> wp.vec3:
    """What ``side``, seen along ω, covers of the plane with normal n."""
    cosine = wp.dot(w, n)
    if wp.abs(cosine) < STEEPEST:
        cosine = wp.sign(cosine) * STEEPEST
    return side - w * (wp.dot(side, n) / cosine)


@wp.func
def _wrapped(i: int, count: int, mode: int) -> int:
    """The texel of a row of ``count`` that stands at place ``i``; −1 for the border."""
    if i >= 0 and i < count:
        return i
    if mode == BORDER:
        return -1
    if mode == REPEAT:
        return (i % count + count) % count
    if mode == MIRROR:
        k = (i % (2 * count) + 2 * count) % (2 * count)
        return wp.min(k, 2 * count - 1 - k)
    return wp.clamp(i, 0, count - 1)


@wp.func
def _texel(textures: TextureArrays, texture: int, level: wp.vec3i, x: int, y: int, wrap: wp.vec2i) -> wp.vec3:
    column = _wrapped(x, level[0], wrap[0])
    row = _wrapped(y, level[1], wrap[1])
    if column < 0 or row < 0:
        return textures.borders[texture]
    half = textures.texels[level[2] + row * level[0] + column]
    return wp.vec3(float(half[0]), float(half[1]), float(half[2]))


@wp.func
def _bilinear(textures: TextureArrays, texture: int, level: wp.vec3i, st: wp.vec2, wrap: wp.vec2i) -> wp.vec3:
    x = st[0] * float(level[0]) - 0.5
    y = (1.0 - st[1]) * float(level[1]) - 0.5
    column = int(wp.floor(x))
    row = int(wp.floor(y))
    a = x - wp.floor(x)
    b = y - wp.floor(y)
    above = (1.0 - a) * _texel(textures, texture, level, column, row, wrap)
    above += a * _texel(textures, texture, level, column + 1, row, wrap)
    below = (1.0 - a) * _texel(textures, texture, level, column, row + 1, wrap)
    below += a * _texel(textures, texture, level, column + 1, row + 1, wrap)
    return (1.0 - b) * above + b * below


@wp.func
def filtered(
    textures: TextureArrays, texture: int, st: wp.vec2, across: wp.vec2, down: wp.vec2, threshold: float
) -> wp.vec3:
    """The mean colour about (s, t) over the parallelogram with sides ``across`` and ``down`` (in s and t).

    The shorter side chooses between the picture's halves, the longer is sampled at several places. Of a cut-out with a
    ``threshold`` above 0 (:func:`packed_textures`) it is the part that reaches it.
    """
    grid = textures.grids[texture]
    wrap = textures.wraps[texture]
    first = grid[2]
    place = st
    if grid[0] > 1 or grid[1] > 1:
        column = int(wp.floor(st[0]))
        row = int(wp.floor(st[1]))
        if column < 0 or row < 0 or column >= grid[0] or row >= grid[1]:
            return textures.borders[texture]
        first += row * grid[0] + column
        wrap = wp.vec2i(CLAMP, CLAMP)
        place = st - wp.vec2(float(column), float(row))
    tile = textures.tiles[first]
    if tile[1] == 0:
        return textures.borders[texture]
    finest = textures.levels[tile[0]]
    size = wp.vec2(float(finest[0]), float(finest[1]))
    longer = across
    long = wp.length(wp.cw_mul(across, size))
    short = wp.length(wp.cw_mul(down, size))
    if short > long:
        longer = down
        swap = long
        long = short
        short = swap
    begin = tile[0]
    last = tile[1] - 1
    if threshold > 0.0:
        if long <= 1.0:
            there = _bilinear(textures, texture, finest, place, wrap)[0] >= threshold
            return wp.where(there, wp.vec3(1.0, 1.0, 1.0), wp.vec3(0.0, 0.0, 0.0))
        begin += 1
        last -= 1
    taps = wp.clamp(int(wp.ceil(long / wp.max(short, 1.0))), 1, MOST_TAPS)
    width = wp.max(wp.max(short, long / float(MOST_TAPS)), 1.0)
    level = wp.min(wp.log2(width), float(last))
    coarse = int(wp.floor(level))
    blend = level - float(coarse)
    fine = textures.levels[begin + coarse]
    next = textures.levels[begin + wp.min(coarse + 1, last)]
    total = wp.vec3(0.0, 0.0, 0.0)
    for k in range(taps):
        at = place + ((float(k) + 0.5) / float(taps) - 0.5) * longer
        color = _bilinear(textures, texture, fine, at, wrap)
        if blend > 0.0:
            color = (1.0 - blend) * color + blend * _bilinear(textures, texture, next, at, wrap)
        total += color
    return total / float(taps)


@wp.func
def is_mapped(textures: TextureArrays, texture: int, hit: Hit) -> bool:
    """Whether a texture says what is at ``hit``: there is one (−1: none), and coordinates for it."""
    return texture >= 0 and textures.coordinate_indices[hit.triangle][0] >= 0


@wp.func
def looked_up(textures: TextureArrays, texture: int, hit: Hit, across: wp.vec3, down: wp.vec3) -> wp.vec3:
    """A texture over the parallelogram of ``across`` and ``down`` about ``hit``, which is mapped there."""
    index = textures.coordinate_indices[hit.triangle]
    st0 = textures.coordinates[index[0]]
    along1 = textures.coordinates[index[1]] - st0
    along2 = textures.coordinates[index[2]] - st0
    st = st0 + hit.beta[1] * along1 + hit.beta[2] * along2
    d_across = along1 * wp.dot(hit.g1, across) + along2 * wp.dot(hit.g2, across)
    d_down = along1 * wp.dot(hit.g1, down) + along2 * wp.dot(hit.g2, down)
    return filtered(textures, texture, st, d_across, d_down, 0.0)


@wp.func
def textured_color(
    textures: TextureArrays, material: int, hit: Hit, color: wp.vec3, across: wp.vec3, down: wp.vec3
) -> wp.vec3:
    """The texture's colour over the parallelogram of ``across`` and ``down`` about ``hit``; ``color`` without one."""
    texture = textures.texture_of[material]
    if not is_mapped(textures, texture, hit):
        return color
    return wp.max(looked_up(textures, texture, hit, across, down), wp.vec3(0.0, 0.0, 0.0))


@wp.func
def mirror_tint(
    textures: TextureArrays, material: int, hit: Hit, tint: wp.vec3, across: wp.vec3, down: wp.vec3
) -> wp.vec3:
    """What a mirror reflects over the parallelogram of ``across`` and ``down`` about ``hit``, at most all of it."""
    return wp.min(textured_color(textures, material, hit, tint, across, down), wp.vec3(1.0, 1.0, 1.0))


@wp.func
def transmittance_at(textures: TextureArrays, material: int, hit: Hit, across: wp.vec3, down: wp.vec3) -> wp.vec3:
    """What a dielectric lets through of what it refracts there."""
    map = textures.transmittance_map_of[material]
    if not is_mapped(textures, map, hit):
        return textures.transmittances[material]
    return looked_up(textures, map, hit, across, down)


@wp.func
def roughness_at(textures: TextureArrays, material: int, hit: Hit, across: wp.vec3, down: wp.vec3) -> float:
    """Width α of the microfacet distribution there; 0 for smooth."""
    map = textures.roughness_map_of[material]
    if not is_mapped(textures, map, hit):
        return textures.roughnesses[material]
    return looked_up(textures, map, hit, across, down)[0]


@wp.func
def diffuse_share_at(textures: TextureArrays, material: int, hit: Hit, across: wp.vec3, down: wp.vec3) -> float:
    """Share of a dielectric or mirror that is diffuse there; nearly none is none, and nearly all is all of it."""
    map = textures.diffuse_map_of[material]
    if not is_mapped(textures, map, hit):
        return textures.diffuse_shares[material]
    return _share(looked_up(textures, map, hit, across, down)[0])


@wp.func
def metal_at(textures: TextureArrays, material: int, hit: Hit, across: wp.vec3, down: wp.vec3) -> float:
    """Share of what is diffuse there that is rough metal; nearly none is none, and nearly all is all of it."""
    map = textures.metal_map_of[material]
    if not is_mapped(textures, map, hit):
        return textures.metals[material]
    return _share(looked_up(textures, map, hit, across, down)[0])


@wp.func
def _share(share: float) -> float:
    """A share that is looked up: all or none of a surface where it nearly is."""
    if share < LEAST_SHARE:
        return 0.0
    if share > 1.0 - LEAST_SHARE:
        return 1.0
    return share


@wp.func
def emission_at(textures: TextureArrays, material: int, hit: Hit, across: wp.vec3, down: wp.vec3) -> wp.vec3:
    """Radiance that a diffuse surface gives off there, in the tracer's unit."""
    map = textures.emission_map_of[material]
    if not is_mapped(textures, map, hit):
        return textures.emissions[material]
    return textures.radiance_unit * looked_up(textures, map, hit, across, down)


@wp.func
def mapped_normal(
    textures: TextureArrays, material: int, hit: Hit, n: wp.vec3, across: wp.vec3, down: wp.vec3
) -> wp.vec3:
    """The normal that the material's normal map makes of ``n``, over the same part of it; ``n`` without one.

    Its frame is n and, across n, the directions in which s and t grow while the other stays.
    """
    texture = textures.normal_map_of[material]
    if not is_mapped(textures, texture, hit):
        return n
    index = textures.coordinate_indices[hit.triangle]
    along1 = textures.coordinates[index[1]] - textures.coordinates[index[0]]
    along2 = textures.coordinates[index[2]] - textures.coordinates[index[0]]
    ds = along1[0] * hit.g1 + along2[0] * hit.g2
    dt = along1[1] * hit.g1 + along2[1] * hit.g2
    side = wp.sign(wp.dot(ds, wp.cross(dt, hit.n_g)))
    along_s = side * wp.cross(dt, hit.n_g)
    along_t = side * wp.cross(hit.n_g, ds)
    along_s = along_s - n * wp.dot(n, along_s)
    along_t = along_t - n * wp.dot(n, along_t)
    # Coordinates of no extent have no frame.
    if wp.min(wp.length_sq(along_s), wp.length_sq(along_t)) == 0.0:
        return n
    map = looked_up(textures, texture, hit, across, down)
    found = map[0] * wp.normalize(along_s) + map[1] * wp.normalize(along_t) + map[2] * n
    return wp.where(wp.length_sq(found) > 0.0, wp.normalize(found), n)


@wp.func
def absorbed_within(textures: TextureArrays, material: int, distance: float) -> wp.vec3:
    """What Beer's law leaves of light after ``distance`` inside a dielectric."""
    return left_after(textures.absorptions[material], distance)


@wp.func
def absorbed_in_media(textures: TextureArrays, inside: int, distance: float) -> wp.vec3:
    """What Beer's law leaves of light after ``distance`` in the media of the mask ``inside``: the highest holds."""
    absorption = wp.vec3(0.0, 0.0, 0.0)
    for medium in range(textures.medium_absorptions.shape[0]):
        if (inside & (1 << medium)) != 0:
            absorption = textures.medium_absorptions[medium]
    return left_after(absorption, distance)


@wp.func
def left_after(absorption: wp.vec3, distance: float) -> wp.vec3:
    """exp(−absorption · distance), by channel."""
    return wp.vec3(
        wp.exp(-distance * absorption[0]), wp.exp(-distance * absorption[1]), wp.exp(-distance * absorption[2])
    )
