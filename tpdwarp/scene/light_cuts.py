"""Into how many parts lights with extent are cut: as many in all scenes of an animation.

A part keeps its number then, and its lattice, keyframes and ids with it, however its light is scaled meanwhile.

Beyond the paper, whose lights are points or parallel.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tpdwarp.scene.description import Extent, ExtentShape, SceneAtShutter

# A prism that stands for a cylinder has no fewer faces: one of six is as wide as that within a tenth, from anywhere.
# Chosen, not derived.
FEWEST_FACES = 6

Grid = tuple[int, int]


@dataclass(frozen=True)
class LightCuts:
    """Into how many parts each light is cut.

    Attributes:
        count: About how many.
        grids: Pieces of rectangles along their sides, faces around cylinders and pieces along them, by their paths.
    """

    count: int = 1
    grids: Mapping[str, Grid] = field(default_factory=dict)

    @classmethod
    def of(cls, count: int, scenes: Sequence[SceneAtShutter]) -> LightCuts:
        """Those that suit lights as large as they ever are in ``scenes``."""
        return cls(count, {path: grid_of(extent, count) for path, extent in _largest(scenes).items()})

    def foreseeing(self, scene: SceneAtShutter) -> LightCuts:
        """The same with those lights of ``scene`` that none of the others had."""
        new = {path: extent for path, extent in _largest([scene]).items() if path not in self.grids}
        if not new:
            return self
        found = {path: grid_of(extent, self.count) for path, extent in new.items()}
        return replace(self, grids={**self.grids, **found})


def grid_of(extent: Extent, count: int) -> Grid:
    """The pieces of a rectangle along its sides, of which there are about ``count``; or the faces around a cylinder, 1
    where it is thin, and the pieces along it, of which about ``count`` face any one side."""
    a, b = np.linalg.norm(extent.spans, axis=1)
    if extent.shape == ExtentShape.CYLINDER:
        length = 2.0 * float(a)
        side = math.sqrt(math.pi * extent.radius * length / count)
        around, along = round(2.0 * math.pi * extent.radius / side), max(1, round(length / side))
        return (around, along) if around >= FEWEST_FACES else (1, count)
    across = round(max(1.0, min(math.sqrt(count * a / b), count)))
    return across, max(1, round(count / across))


def _largest(scenes: Sequence[SceneAtShutter]) -> dict[str, Extent]:
    """Rectangles and cylinders of scenes, as long along each of their axes as they are in any of them."""
    found: dict[str, Extent] = {}
    for scene in scenes:
        for light in scene.lights:
            extent = light.extent
            if extent is None or extent.shape not in (ExtentShape.RECT, ExtentShape.CYLINDER):
                continue
            lengths = np.linalg.norm(extent.spans, axis=1)
            radius, known = extent.radius, found.get(light.path)
            if known is not None:
                lengths = np.maximum(lengths, np.linalg.norm(known.spans, axis=1))
                radius = max(radius, known.radius)
            found[light.path] = Extent(extent.shape, radius, np.eye(2, 3) * lengths[:, None])
    return found
