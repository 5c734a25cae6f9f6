"""Texture files: their mean colours, and pictures of them for what is spread over a surface."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pxr import Ar, Usd

from tpdwarp.io.resampling import area_averaged
from tpdwarp.scene.description import Texture, Wrap
from tpdwarp.usd.read.materials.coordinates import Coordinates
from tpdwarp.usd.read.numbered_files import Tile, files_at, is_tiled

# A tile set may hold hundreds of tiles; the mean of these stands for all.
MOST_TILES = 16
# Pictures of more pixels along a side are brought down to it: 25 MB each in half precision. Chosen, not derived:
# twice the width of a default frame.
LARGEST_SIDE = 2048
WRAPS = {
    "repeat": Wrap.REPEAT,
    "periodic": Wrap.REPEAT,
    "clamp": Wrap.CLAMP,
    "mirror": Wrap.MIRROR,
    "black": Wrap.BORDER,
    "constant": Wrap.BORDER,
}
# The largest number of half precision.
LARGEST_HALF = 65504.0

Tiles = dict[Tile, np.ndarray]


@dataclass(frozen=True, eq=False)
class Image:
    """A value that differs over a surface.

    Attributes:
        tiles: Values by unit square of (s, t), rows from t = 1 down, each shape [h, w, c].
        wrap: How it goes on along s and t.
        border: The value beyond edges that neither repeat nor hold, shape [c].
        coordinates: Where s and t come from.
        tiled: Whether its file is one of a set, a file for each tile (UDIM).
    """

    tiles: Tiles
    wrap: tuple[Wrap, Wrap]
    border: np.ndarray
    coordinates: Coordinates
    tiled: bool = False

    @property
    def most(self) -> float:
        """Its largest value."""
        return max(float(tile.max()) for tile in self.tiles.values())

    @property
    def least(self) -> float:
        """Its smallest value."""
        return min(float(tile.min()) for tile in self.tiles.values())

    @property
    def mean(self) -> np.ndarray:
        """Its mean, shape [c]."""
        return np.mean([tile.mean(axis=(0, 1), dtype=np.float64) for tile in self.tiles.values()], axis=0)

    def mapped(self, function: Callable[[np.ndarray], np.ndarray]) -> Image:
        """The image of a function of its values (channels last)."""
        tiles = {place: _half(function(tile.astype(np.float32))) for place, tile in self.tiles.items()}
        return replace(self, tiles=tiles, border=np.atleast_1d(function(self.border)))

    def chosen(self, function: Callable[[np.ndarray], np.ndarray]) -> Image:
        """The image of some of its channels (the last axis), which are taken as they are."""
        tiles = {place: function(tile) for place, tile in self.tiles.items()}
        return replace(self, tiles=tiles, border=np.atleast_1d(function(self.border)))

    def texture(self) -> Texture:
        """The image as a colour of a material; a grey one of one channel is spread over three."""
        colored = self.chosen(_as_color)
        return Texture(colored.tiles, self.wrap, tuple(map(float, colored.border)))


def combined(
    function: Callable[[Sequence[np.ndarray]], np.ndarray | None], arguments: Sequence[np.ndarray | Image]
) -> Image | None:
    """The image of a function of several values, some of them images; None where these do not fit each other."""
    images = [argument for argument in arguments if isinstance(argument, Image)]
    first = images[0]
    alike = all(
        (other.tiles.keys(), other.wrap, other.coordinates) == (first.tiles.keys(), first.wrap, first.coordinates)
        for other in images
    )
    if not alike:
        return None

    def applied(values: list[np.ndarray]) -> np.ndarray | None:
        height, width = (max(v.shape[k] for v in values if v.ndim == 3) for k in (0, 1))
        found = function([_enlarged(v, height, width) if v.ndim == 3 else v for v in values])
        if found is None:
            return None
        return _half(np.broadcast_to(found, (height, width, found.shape[-1])))

    tiles = {
        place: applied([a.tiles[place].astype(np.float32) if isinstance(a, Image) else a for a in arguments])
        for place in first.tiles
    }
    border = function([a.border if isinstance(a, Image) else a for a in arguments])
    if border is None or any(tile is None for tile in tiles.values()):
        return None
    return replace(first, tiles=tiles, border=border)


class Textures:
    """A stage's textures, each file read once; of what changes with time, once while it is shown."""

    def __init__(self) -> None:
        self._means: dict[tuple[str, str], np.ndarray | None] = {}
        self._pictures: dict[tuple[str, str], tuple[np.ndarray, tuple[str, str]] | None] = {}
        self._named: dict[str, set[str]] = {}

    def mean(self, attribute: Usd.Attribute, time: float, encoding: str) -> np.ndarray | None:
        """Mean colour of the texture an asset attribute names, shape [4] (linear R, G, B and A).

        Args:
            attribute: The asset attribute.
            time: Time code.
            encoding: ``sRGB``, ``raw``, or ``auto``: sRGB where it has three channels or more of eight bits.

        Returns:
            None where no file can be read.
        """
        means = []
        for path in list(self._files(attribute, time).values())[:MOST_TILES]:
            key = path, encoding
            if key not in self._means:
                self._means[key] = _mean(path, encoding)
            if self._means[key] is not None:
                means.append(self._means[key])
        return np.mean(means, axis=0) if means else None

    def image(
        self, attribute: Usd.Attribute, time: float, encoding: str, wrap: tuple[str, str], coordinates: Coordinates
    ) -> Image | None:
        """The texture an asset attribute names, of four channels (linear R, G, B and A); None where none can be read.

        Args:
            attribute, time, encoding: As in :meth:`mean`.
            wrap: Wrap modes along s and t; the file's own, or else black, for others than those known.
            coordinates: Where s and t come from.
        """
        tiles: Tiles = {}
        modes = wrap
        for place, path in self._files(attribute, time).items():
            key = path, encoding
            if key not in self._pictures:
                self._pictures[key] = _picture(path, encoding)
            if (found := self._pictures[key]) is not None:
                tiles[place], of_file = found
                modes = tuple(mode if mode in WRAPS else own for mode, own in zip(wrap, of_file, strict=True))
        if not tiles:
            return None
        s, t = (WRAPS.get(mode, Wrap.BORDER) for mode in modes)
        return Image(tiles, (s, t), np.zeros(4), coordinates, is_tiled(attribute, time))

    def _files(self, attribute: Usd.Attribute, time: float) -> dict[Tile, str]:
        """The files an attribute names; the pictures of those that it named at another time are let go."""
        files = files_at(attribute, time)
        name, paths = str(attribute.GetPath()), set(files.values())
        earlier = self._named.get(name, paths) - paths
        self._named[name] = paths
        if earlier:
            self._pictures = {key: picture for key, picture in self._pictures.items() if key[0] not in earlier}
        return files


def _as_color(value: np.ndarray) -> np.ndarray:
    return np.repeat(value[..., :1], 3, axis=-1) if value.shape[-1] < 3 else value[..., :3]


def _enlarged(pixels: np.ndarray, height: int, width: int) -> np.ndarray:
    """A picture with its pixels repeated to a size."""
    rows, columns = (np.arange(n) * old // n for n, old in zip((height, width), pixels.shape[:2], strict=True))
    return pixels if pixels.shape[:2] == (height, width) else pixels[rows][:, columns]


def _mean(path: str, encoding: str) -> np.ndarray | None:
    # Here and not above: most stages have no textures.
    from tpdwarp.io.images import mean_color

    with _on_disk(path) as file:
        return None if file is None else mean_color(file, encoding)


def _picture(path: str, encoding: str) -> tuple[np.ndarray, tuple[str, str]] | None:
    """A file's pixels [h, w, 4] in half precision and its own wrap modes; None where it cannot be read."""
    from tpdwarp.io.images import read_texture

    with _on_disk(path) as file:
        found = None if file is None else read_texture(file, encoding)
    if found is None:
        return None
    return _half(_brought_down(found.pixels, LARGEST_SIDE / max(found.pixels.shape[:2]))), found.wrap_modes


def picture_of(path: str, most_rows: int) -> np.ndarray | None:
    """A file's linear colours, with ``most_rows`` rows at most, shape [h, w, 3]; None where it cannot be read."""
    from tpdwarp.io.images import read_texture

    with _on_disk(path) as file:
        found = None if file is None else read_texture(file)
    return None if found is None else _brought_down(found.pixels[..., :3], most_rows / len(found.pixels))


def _brought_down(pixels: np.ndarray, scale: float) -> np.ndarray:
    """A picture made smaller by ``scale``; as it is where that is above 1."""
    if scale >= 1:
        return pixels
    return area_averaged(pixels, *(max(1, round(side * scale)) for side in pixels.shape[:2]))


def _half(pixels: np.ndarray) -> np.ndarray:
    return np.clip(pixels, -LARGEST_HALF, LARGEST_HALF).astype(np.float16)


@contextmanager
def _on_disk(path: str) -> Iterator[str | None]:
    """The path of a file that holds an asset's bytes; None where there is no such asset."""
    if os.path.isfile(path):
        yield path
        return
    if not Ar.IsPackageRelativePath(path):
        yield None
        return
    # Within a package (.usdz) files have no name of their own.
    asset = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(path))
    if not asset:
        yield None
        return
    with tempfile.NamedTemporaryFile(suffix=Path(path.rstrip("]")).suffix) as copy:
        with asset:
            copy.write(asset.GetBuffer())
        copy.flush()
        yield copy.name
