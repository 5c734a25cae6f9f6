"""Asset paths that name many files: one for each frame, one for each tile of texture coordinates, or both."""

from __future__ import annotations

import glob
import math
import os
import re

from pxr import Ar, Sdf, Usd, UsdShade

UDIM = "<UDIM>"
# UDIM counts the squares of ten columns from 1001 on.
COLUMNS, FIRST = 10, 1001
# What stands for a tile's number beside USD's <UDIM>: Arnold's and Houdini's spelling of it.
_OTHER_UDIM = re.compile(r"<udim>|%\(UDIM\)d", re.IGNORECASE)
# Mari's names of tiles in MaterialX: u1_v1 for the first.
_UV_TILE = re.compile(r"<uvtile>", re.IGNORECASE)
# Places of frame numbers with the digits they are padded to: <frame>, <frame:4>, <f4> (Arnold, RenderMan, Maya),
# {0Nframe} (MaterialX), $F4 and ${F4} (Houdini), %04d (OpenImageIO, ffmpeg) and #### (usdrecord, Nuke).
_FRAME = re.compile(
    r"<(?:frame|f):?(?P<angles>\d*)>|\{(?P<braces>\d*)frame\}|\$(?:F(?P<dollar>\d*)(?![A-Za-z0-9_])|\{F(?P<shell>\d*)\})"
    r"|%(?P<percent>\d*)d|(?P<hashes>#+)",
    re.IGNORECASE,
)
# Where the name does not say how frames are padded, these numbers of digits are tried in this order.
_PADDINGS = (1, 4, 3, 5, 6, 2)

Tile = tuple[int, int]


def files_at(attribute: Usd.Attribute, time: float) -> dict[Tile, str]:
    """Paths of the files an asset attribute names at a time code, by the unit square of (s, t) that each covers.

    Frame numbers are time codes of the stage, rounded down. What cannot be found is named as it is authored.
    """
    value = attribute.Get(time)
    if not isinstance(value, Sdf.AssetPath) or not value.path:
        return {}
    if value.resolvedPath and not is_tiled_path(value.path):
        return {(0, 0): value.resolvedPath}
    layers = [spec.layer for spec in attribute.GetPropertyStack(time)]
    for name in _at_frame(value.path, math.floor(time + 1e-6)):
        found = _tiles(name, layers[0]) if layers else {}
        if found:
            return found
    return {} if is_tiled_path(value.path) else {(0, 0): value.resolvedPath or value.path}


def file_at(attribute: Usd.Attribute, time: float) -> str:
    """Path of the one file that an asset attribute names at a time code; empty where it names none."""
    return next(iter(files_at(attribute, time).values()), "") if attribute else ""


def is_tiled(attribute: Usd.Attribute, time: float) -> bool:
    """Whether an asset attribute names a file for each tile."""
    value = attribute.Get(time)
    return isinstance(value, Sdf.AssetPath) and is_tiled_path(value.path)


def is_tiled_path(path: str) -> bool:
    """Whether a path has a place for the number of a tile."""
    return UDIM in path or bool(_OTHER_UDIM.search(path) or _UV_TILE.search(path))


def changes_by_frame(attribute: Usd.Attribute, time: float) -> bool:
    """Whether an asset attribute names a file for each frame, by a name with a place for the frame's number."""
    value = attribute.Get(time) if attribute.GetTypeName() == Sdf.ValueTypeNames.Asset else None
    return isinstance(value, Sdf.AssetPath) and not value.resolvedPath and bool(_FRAME.search(value.path))


def all_files(path: str) -> list[str]:
    """The files on disk that an absolute path names, for whatever frame and tile; the path itself where it has none."""
    if os.path.exists(path):
        return [path]
    parts, end = [], 0
    for place in re.finditer(rf"{UDIM}|{_OTHER_UDIM.pattern}|{_UV_TILE.pattern}|{_FRAME.pattern}", path, re.IGNORECASE):
        parts += [glob.escape(path[end : place.start()]), _wild(place[0])]
        end = place.end()
    return sorted(glob.glob("".join(parts) + glob.escape(path[end:]))) if parts else [path]


def _wild(token: str) -> str:
    if _UV_TILE.fullmatch(token):
        return "u[0-9]*_v[0-9]*"
    return "[0-9]" * 4 if is_tiled_path(token) else "[0-9]*"


def _at_frame(path: str, frame: int) -> list[str]:
    """A path as it is, and with the frame's number in its places by the paddings that it may have."""
    if not _FRAME.search(path):
        return [path]

    def numbered(place: re.Match[str], padding: int) -> str:
        digits = len(place["hashes"]) if place["hashes"] else next(filter(None, place.groups()), "")
        return f"{frame:0{int(digits or padding)}d}"

    names = (_FRAME.sub(lambda place, padding=padding: numbered(place, padding), path) for padding in _PADDINGS)
    return list(dict.fromkeys((path, *names)))


def _tiles(path: str, layer: Sdf.Layer) -> dict[Tile, str]:
    """The files that there are for a path of one frame, as a layer names it."""
    path = _OTHER_UDIM.sub(UDIM, path)
    if UDIM in path:
        found = UsdShade.UdimUtils.ResolveUdimTilePaths(path, layer)
        return {((int(tile) - FIRST) % COLUMNS, (int(tile) - FIRST) // COLUMNS): str(file) for file, tile in found}
    anchored = Sdf.ComputeAssetPathRelativeToLayer(layer, path)
    if _UV_TILE.search(anchored):
        before, after = _UV_TILE.split(anchored, 1)
        number = re.compile(rf"{re.escape(before)}u(\d+)_v(\d+){re.escape(after)}")
        places = ((file, number.fullmatch(file)) for file in all_files(anchored))
        return {(int(place[1]) - 1, int(place[2]) - 1): file for file, place in places if place}
    resolved = Ar.GetResolver().Resolve(anchored)
    return {(0, 0): str(resolved)} if resolved else {}
