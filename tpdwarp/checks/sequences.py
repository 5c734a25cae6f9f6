"""Finding the frames of two sequences and pairing them."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tpdwarp.errors import InputError
from tpdwarp.io.images import EXTENSIONS

LAYER_EXTENSIONS = (".usdc", ".usda", ".usd")
_NUMBER = re.compile(r"^(?P<before>.*?[._-]|)(?P<number>-?\d+(?:\.\d+)?)$")
_PLACEHOLDER = re.compile(r"#+(?:\.#+)?")


@dataclass(frozen=True)
class FrameFile:
    """An image or a debug layer.

    Attributes:
        path: The file.
        series: Its name without the frame number and the extension.
        frame: Its number; None where it has none.
    """

    path: str
    series: str
    frame: float | None


@dataclass(frozen=True)
class Pair:
    """What two sequences hold of one frame; at least one file in all, and more than one a side are duplicates."""

    name: str
    frame: float | None
    files: tuple[str, ...]
    baselines: tuple[str, ...]


def frame_file(path: Path) -> FrameFile:
    """``wave.0012.exr`` as frame 12 of ``wave``; ``wave.012.50.exr`` is frame 12.5."""
    found = _NUMBER.match(path.stem)
    if not found:
        return FrameFile(str(path), path.stem, None)
    return FrameFile(str(path), found["before"].rstrip("._-"), float(found["number"]))


def files_of(place: str | os.PathLike[str], extensions: Sequence[str]) -> tuple[FrameFile, ...]:
    """Files of a sequence, by series and number.

    Args:
        place: A folder, one file, or a name with ``####`` where the frame number goes.
        extensions: Those that count, in small letters.

    Raises:
        InputError: There is no such place.
    """
    path = Path(place)
    if path.is_dir():
        candidates = [entry for entry in path.iterdir() if not entry.name.startswith(".")]
    elif path.is_file():
        candidates = [path]
    elif found := _PLACEHOLDER.search(path.name):
        before, after = path.name[: found.start()], path.name[found.end() :]
        pattern = re.compile(re.escape(before) + r"-?\d+(?:\.\d+)?" + re.escape(after))
        folder = path.parent
        candidates = [entry for entry in folder.iterdir() if pattern.fullmatch(entry.name)] if folder.is_dir() else []
        if not candidates:
            raise InputError("no file has such a name", file=os.fspath(place))
    else:
        raise InputError("does not exist (give a folder, an image, or a name with ####)", file=os.fspath(place))
    files = [frame_file(entry) for entry in candidates if entry.suffix.lower() in extensions and entry.is_file()]
    return tuple(sorted(files, key=lambda file: (file.series, _order(file.frame), file.path)))


def image_pairs(frames: str | os.PathLike[str], baseline: str | os.PathLike[str]) -> list[Pair]:
    """Frames of a sequence beside those of its baseline, in order.

    Two single images are one pair, whatever they are called. Where either side has several series (or files without
    a number), names must agree; where both have one, only numbers count.

    Raises:
        InputError: A place does not exist.
    """
    mine, theirs = files_of(frames, EXTENSIONS), files_of(baseline, EXTENSIONS)
    if Path(frames).is_file() and Path(baseline).is_file() and mine and theirs:
        return [Pair(Path(mine[0].path).stem, mine[0].frame, (mine[0].path,), (theirs[0].path,))]
    if Path(frames).is_file() and mine:
        # One image against a folder: against its own frame there, and no complaint of the others.
        theirs = tuple(file for file in theirs if file.frame == mine[0].frame)
    return _paired(mine, theirs)


def _paired(mine: Sequence[FrameFile], theirs: Sequence[FrameFile]) -> list[Pair]:
    numbers_alone = all(
        len({file.series for file in side}) <= 1 and all(file.frame is not None for file in side)
        for side in (mine, theirs)
    )
    entries: dict[tuple[str, float], tuple[list[str], list[str]]] = {}
    for side, files in enumerate((mine, theirs)):
        for file in files:
            key = ("" if numbers_alone else file.series, _order(file.frame))
            entries.setdefault(key, ([], []))[side].append(file.path)
    pairs = []
    for (series, order), (files_here, files_there) in sorted(entries.items()):
        frame = order if math.isfinite(order) else None
        number = "" if frame is None else f"{frame:.12g}"
        name = " ".join(part for part in (series, number) if part)
        pairs.append(Pair(name, frame, tuple(files_here), tuple(files_there)))
    return pairs


def _order(frame: float | None) -> float:
    return -math.inf if frame is None else frame
