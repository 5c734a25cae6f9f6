"""Rendering a stage the way its baseline was rendered."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from tpdwarp.checks.sequences import LAYER_EXTENSIONS, FrameFile, files_of
from tpdwarp.errors import InputError, logger
from tpdwarp.io.frame_names import FrameNames
from tpdwarp.io.images import EXTENSIONS, read_stored
from tpdwarp.jobs.progress import Progress
from tpdwarp.jobs.sequence import render
from tpdwarp.settings import Settings

FilePath = str | os.PathLike[str]

# A baseline may come from anywhere, and what its files ask for is rendered unseen. Each bound is some ten times what
# the slowest preset or the largest screen needs.
MOST = {"samples": 4096, "photons": 2**26, "segments": 1024, "accumulation_times": 4096, "image_width": 16384}
MOST |= {"tdpm_neighbours": 10_000, "tdpm_between": 4096, "smoothing": 100, "exposure": 1000}


@dataclass(frozen=True)
class Recipe:
    """How a baseline was rendered.

    Attributes:
        frames: Its frames.
        settings: Settings that differ from none: all that its files record and this program knows.
        name: Name for its files, with ``####`` where the number goes.
        layer: Name of its debug layer, or empty.
    """

    frames: tuple[float, ...]
    settings: dict[str, Any]
    name: str
    layer: str

    def outputs(self, folder: FilePath) -> list[Path]:
        """Files of the frames that rendering into ``folder`` writes, and of the debug layer."""
        names = FrameNames(Path(folder) / self.name)
        layer = [Path(folder) / self.layer] if self.layer else []
        return [*(Path(names.path(frame)) for frame in self.frames), *layer]


def recipe_of(baseline: FilePath) -> Recipe:
    """Reads from a baseline's frames how they were rendered.

    Raises:
        InputError: It does not exist, holds no numbered frames of one series, or they do not say; or they ask for more
            work than is done without being asked for by a person.
    """
    place = os.fspath(baseline)
    images = [file for file in files_of(baseline, EXTENSIONS) if file.frame is not None]
    if not images or len({file.series for file in images}) > 1:
        raise InputError("must hold the numbered frames of one series, to be rendered again", file=place)
    metadata = read_stored(images[0].path).metadata
    try:
        recorded = json.loads(metadata["tpdwarp:settings"])
        recorded = dict(recorded)
    except (KeyError, TypeError, ValueError, RecursionError):
        raise InputError("does not say how it was rendered (tpdwarp:settings)", file=images[0].path) from None
    known = {field.name for field in fields(Settings)}
    settings = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in recorded.items()
        if name in known and name not in ("threads", "device")
    }
    for name, most in MOST.items():
        asked = settings.get(name)
        if isinstance(asked, int | float) and not asked <= most:
            message = f"asks for {name} {asked:.6g}, more than {most} (check frames made with tpdwarp render instead)"
            raise InputError(message, file=images[0].path)
    layers = files_of(baseline, LAYER_EXTENSIONS) if Path(baseline).is_dir() else ()
    debug = [Path(file.path).name for file in layers if not file.path.endswith(".view.usda")]
    frames = tuple(file.frame for file in images if file.frame is not None)
    return Recipe(tuple(sorted(set(frames))), settings, _template(images), debug[0] if len(debug) == 1 else "")


def render_like(
    scene: FilePath, recipe: Recipe, folder: FilePath, progress: str | Progress | None = None, **changes: Any
) -> None:
    """Renders a stage by a recipe. Frames that fail are said to the program's log, and are missing.

    Args:
        scene: The stage.
        recipe: How.
        folder: Where to; frames that are there are written over.
        progress: As for :func:`tpdwarp.render`.
        **changes: Settings that are to differ from the recipe's.

    Raises:
        InputError: As for :func:`tpdwarp.render`.
    """
    result = render(
        scene,
        Path(folder) / recipe.name,
        frames=recipe.frames,
        debug_layer=Path(folder) / recipe.layer if recipe.layer else None,
        progress=progress,
        **{**recipe.settings, **changes},
    )
    for frame, reason in result.failed.items():
        logger.warning("%s: frame %g could not be rendered: %s", os.fspath(scene), frame, reason)
    for problem in result.problems:
        logger.warning("%s: %s", os.fspath(scene), problem)


def _template(files: Sequence[FrameFile]) -> str:
    """``wave.0012.exr`` as ``wave.####.exr``, ``wave.012.50.exr`` as ``wave.###.##.exr``."""
    name = Path(files[0].path).name
    stem, extension = os.path.splitext(name)
    number = re.search(r"-?\d+(\.\d+)?$", stem)
    assert number is not None
    return stem[: number.start()] + re.sub(r"[-\d]", "#", number[0]) + extension
