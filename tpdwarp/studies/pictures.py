"""Frames that a study reads or keeps as EXR: its truth, and what other renderers made."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tpdwarp.errors import InputError
from tpdwarp.io.frame_names import FrameNames
from tpdwarp.io.images import read_image, write_frame
from tpdwarp.studies.solutions import Solution
from tpdwarp.studies.truth import Truth

FilePath = str | os.PathLike[str]

# How well a truth is known, which its files carry.
NOISE = "tpdwarp:relativeNoise"


def save_truth(path: FilePath, frames: Sequence[float], truth: Truth) -> None:
    """Keeps a truth as EXR frames (all of it in single precision): beauty, and ``caustic`` beside it.

    Raises:
        InputError: Frames would share a name.
        FrameError: A file cannot be written.
    """
    names = FrameNames(path)
    names.check(frames)
    for frame, caustic, beauty in zip(frames, truth.solution.caustic, truth.solution.beauty, strict=True):
        channels = {name: beauty[..., k] for k, name in enumerate("RGB")}
        channels["A"] = np.ones(beauty.shape[:2], np.float32)
        channels |= {f"caustic.{name}": caustic[..., k] for k, name in enumerate("RGB")}
        write_frame(names.path(frame), channels, {NOISE: truth.relative_noise, "tpdwarp:frame": frame}, "float")


def read_truth(path: FilePath, frames: Sequence[float], size: tuple[int, int]) -> Truth:
    """A truth of frames on disk, with ``caustic`` among their channels.

    Raises:
        InputError: A file is missing, of another size, or without ``caustic``.
    """
    read = [_read(file, size) for file in _files(path, frames)]
    for file, (_, caustic, _) in zip(_files(path, frames), read, strict=True):
        if caustic is None:
            raise InputError("has no channels caustic.R, .G and .B (keep one with --save-truth)", file=file)
    solution = _solution([caustic for _, caustic, _ in read], [beauty for beauty, _, _ in read], 0.0)
    if not solution.caustic.mean() > 0:
        raise InputError("holds no light from photons: there is nothing to measure", file=os.fspath(path))
    return Truth(solution, max(noise for _, _, noise in read))


def read_against(
    path: FilePath, frames: Sequence[float], size: tuple[int, int], truth: Truth, seconds: float
) -> Solution:
    """Frames that another renderer made, as a solution of the study.

    Where they have no ``caustic``, the error of their caustic is that of the whole image.

    Args:
        path: EXR files, with ``####`` where the frame number goes.
        frames: Time codes.
        size: Width and height that they must have.
        truth: What they are measured against.
        seconds: CPU seconds that a frame took.

    Raises:
        InputError: A file is missing or of another size.
    """
    read = [_read(file, size) for file in _files(path, frames)]
    rest = truth.solution.beauty - truth.solution.caustic
    caustics = [beauty - rest[k] if caustic is None else caustic for k, (beauty, caustic, _) in enumerate(read)]
    return _solution(caustics, [beauty for beauty, _, _ in read], seconds)


def name_of(path: FilePath) -> str:
    """What frames of another renderer are called in a study: their folder's name and the file's beginning."""
    named = Path(path)
    return f"{named.parent.name}/{named.name.partition('#')[0].rstrip('._-')}".lstrip("/")


def _files(path: FilePath, frames: Sequence[float]) -> list[str]:
    names = FrameNames(path)
    names.check(frames)
    return [names.path(frame) for frame in frames]


def _read(path: str, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray | None, float]:
    channels, metadata = read_image(path)
    missing = [name for name in "RGB" if name not in channels]
    if missing:
        raise InputError(f"has no channel {missing[0]}", file=path)
    height, width = channels["R"].shape
    if (width, height) != tuple(size):
        expected = f"{size[0]} × {size[1]}"
        raise InputError(f"has {width} × {height} pixels, the study {expected} (see --resolution)", file=path)
    beauty = np.stack([channels[name] for name in "RGB"], axis=-1)
    layer = [channels.get(f"caustic.{name}") for name in "RGB"]
    caustic = None if any(part is None for part in layer) else np.stack(layer, axis=-1)
    return beauty, caustic, float(metadata.get(NOISE, 0.0))


def _solution(caustic: Sequence[np.ndarray], beauty: Sequence[np.ndarray], seconds: float) -> Solution:
    spent = {"render": seconds}
    return Solution(np.stack(caustic), np.stack(beauty), spent, dict(spent), 0.0, 0)
