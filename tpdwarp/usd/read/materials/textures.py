"""Textures, of which the mean colour is rendered."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from pxr import Ar, Sdf, Usd, UsdShade

# A tile set may hold hundreds of tiles; the mean of these stands for all.
MOST_TILES = 16


class Textures:
    """Mean colours of a stage's textures, each file read once."""

    def __init__(self) -> None:
        self._means: dict[tuple[str, str], np.ndarray | None] = {}

    def mean(self, attribute: Usd.Attribute, time: float, encoding: str) -> np.ndarray | None:
        """Mean colour of the texture an asset attribute names, shape [4] (linear R, G, B and A).

        Args:
            attribute: The asset attribute.
            time: Time code.
            encoding: ``sRGB``, ``raw``, or ``auto``: sRGB where it has three channels or more of eight bits.

        Returns:
            None where no file can be read.
        """
        value = attribute.Get(time)
        if not isinstance(value, Sdf.AssetPath) or not value.path:
            return None
        if UsdShade.UdimUtils.IsUdimIdentifier(value.path):
            layers = [spec.layer for spec in attribute.GetPropertyStack(time)]
            tiles = UsdShade.UdimUtils.ResolveUdimTilePaths(value.path, layers[0]) if layers else []
            paths = [str(path) for path, _ in tiles][:MOST_TILES]
        else:
            paths = [value.resolvedPath or value.path]
        means = []
        for path in paths:
            key = path, encoding
            if key not in self._means:
                self._means[key] = _mean(path, encoding)
            if self._means[key] is not None:
                means.append(self._means[key])
        return np.mean(means, axis=0) if means else None


def _mean(path: str, encoding: str) -> np.ndarray | None:
    # Here and not above: most stages have no textures.
    from tpdwarp.io.images import mean_color

    if Path(path).is_file():
        return mean_color(path, encoding)
    if not Ar.IsPackageRelativePath(path):
        return None
    # Within a package (.usdz) files have no name of their own.
    asset = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(path))
    if not asset:
        return None
    with tempfile.NamedTemporaryFile(suffix=Path(path.rstrip("]")).suffix) as copy:
        with asset:
            copy.write(asset.GetBuffer())
        copy.flush()
        return mean_color(copy.name, encoding)
