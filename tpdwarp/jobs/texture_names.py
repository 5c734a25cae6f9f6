"""Names of the textures of receivers: which goes where, by receiver, tile and frame."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path

from tpdwarp.errors import InputError
from tpdwarp.io.frame_names import FrameNames
from tpdwarp.usd.read.numbered_files import COLUMNS, FIRST, UDIM, Tile


def udim(tile: Tile) -> int:
    """The UDIM number of a unit square of (s, t)."""
    return FIRST + tile[0] + COLUMNS * tile[1]


class TextureNames:
    """Names of a sequence of textures.

    ``caustic.####.exr`` gives ``caustic.0012.exr`` for one receiver of one tile. Where there are several receivers,
    their names stand before the frame (``caustic.Floor.0012.exr``); where one has several tiles, so do their UDIM
    numbers (``caustic.Floor.1001.0012.exr``), unless ``<UDIM>`` in the name says where they go.

    Args:
        template: The path, with one place for the frame number or none.
        tiles: The tiles of each receiver, by its path.

    Raises:
        InputError: The template has more than one place for the frame, or a receiver has tiles without a number.
    """

    def __init__(self, template: str | os.PathLike[str], tiles: dict[str, Sequence[Tile]]) -> None:
        self._tiles = {path: tuple(found) for path, found in tiles.items()}
        folder, name = os.path.split(os.fspath(template))
        labels = labels_of(list(tiles)) if len(tiles) > 1 else {path: "" for path in tiles}
        self._names: dict[str, str] = {}
        for path, found in self._tiles.items():
            numbered = UDIM in name
            if numbered or found not in ((), ((0, 0),)):
                odd = next((tile for tile in found if not (0 <= tile[0] < COLUMNS and 0 <= tile[1] < 900)), None)
                if odd is not None:
                    raise InputError(
                        f"has texture coordinates in the square {odd}, which no UDIM number names (move them)", "", path
                    )
            parts = [labels[path]] if labels[path] else []
            if not numbered and found not in ((), ((0, 0),)):
                parts.append(UDIM)
            self._names[path] = os.path.join(folder, _with_parts(name, parts))

    def check(self, frames: Sequence[float]) -> None:
        """Makes sure that every frame gets a name of its own.

        Raises:
            InputError: Frames would share a name.
        """
        for name in self._names.values():
            FrameNames(name).check(frames)

    def path(self, receiver: str, tile: Tile, frame: float) -> str:
        """The file of one tile of a receiver."""
        return self.pattern(receiver, frame).replace(UDIM, str(udim(tile)))

    def pattern(self, receiver: str, frame: float) -> str:
        """The files of all tiles of a receiver, with ``<UDIM>`` where their number goes."""
        return FrameNames(self._names[receiver]).path(frame)

    def paths(self, frame: float) -> list[str]:
        """All files of a frame."""
        return [self.path(path, tile, frame) for path, tiles in self._tiles.items() for tile in tiles]


def light_layer_path(template: str | os.PathLike[str]) -> Path:
    """The layer that binds textures: ``caustic.light.usda`` for ``caustic.####.exr``."""
    path = Path(template)
    stem = re.sub(r"[._-]?(?:#+(?:\.#+)?|<UDIM>)", "", path.stem)
    return path.with_name(f"{stem or 'caustic'}.light.usda")


def labels_of(paths: Sequence[str]) -> dict[str, str]:
    """The shortest names that tell receivers apart: their prims' own, with those above where these are the same."""
    parts = {path: [re.sub(r"\W+", "_", part).strip("_") for part in path.strip("/").split("/")] for path in paths}
    length = dict.fromkeys(paths, 1)
    while True:
        labels = {path: "_".join(parts[path][-length[path] :]) for path in paths}
        alike = [p for p in paths if list(labels.values()).count(labels[p]) > 1 and length[p] < len(parts[p])]
        if not alike:
            return labels
        for path in alike:
            length[path] += 1


def _with_parts(name: str, parts: Sequence[str]) -> str:
    """A file's name with ``parts`` before its frame number, or before its extension."""
    if not parts:
        return name
    text = ".".join(parts)
    place = re.search(r"#+", name)
    if place is None:
        stem, extension = os.path.splitext(name)
        return f"{stem}.{text}{extension}"
    return f"{name[: place.start()]}{text}.{name[place.start() :]}"
