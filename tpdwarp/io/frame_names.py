"""File names of frames: where the frame number goes and how it is written."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence

from tpdwarp.errors import InputError
from tpdwarp.io.files import file_name

_PLACEHOLDER = re.compile(r"#+(?:\.#+)?")
_MOST_DECIMALS = 9


def frame_text(frame: float) -> str:
    """A frame as people write it: ``12``, ``12.5``, or ``default`` for the default time (NaN)."""
    return "default" if math.isnan(frame) else f"{frame:.12g}"


class FrameNames:
    """Names of a sequence's files, after usdrecord's habit.

    ``wave.####.exr`` gives ``wave.0012.exr``, ``wave.###.##.exr`` gives ``wave.012.50.exr``; the width counts the
    minus sign of a negative frame. Only the file's name holds a placeholder, its folders are taken as they are.

    Args:
        template: The path, with one placeholder or none.

    Raises:
        InputError: There is more than one placeholder, or no name at all.
    """

    def __init__(self, template: str | os.PathLike[str]) -> None:
        self.template = file_name(template)
        self._folder, name = os.path.split(self.template)
        found = list(_PLACEHOLDER.finditer(name))
        if len(found) > 1:
            raise InputError("has more than one place for the frame number (keep one ####)", file=self.template)
        self._numbered = bool(found)
        start, stop = found[0].span() if found else (len(name), len(name))
        self._before, self._after = name[:start], name[stop:]
        whole, _, decimals = name[start:stop].partition(".")
        self._decimals = len(decimals)
        self._width = len(whole) + (1 + len(decimals) if decimals else 0)

    def check(self, frames: Sequence[float]) -> None:
        """Makes sure that every frame gets a name of its own.

        Raises:
            InputError: Frames would share a name, or a frame has more decimals than the placeholder.
        """
        if not self._numbered:
            if len(frames) > 1:
                stem, extension = os.path.splitext(self.template)
                raise InputError(
                    f"{len(frames)} frames need a place for their number (for instance {stem}.####{extension}, "
                    "or choose one with --frames)",
                    file=self.template,
                )
            return
        for frame in frames:
            if math.isnan(frame):
                raise InputError("the default time has no frame number (leave out the ####)", file=self.template)
            needed = _decimals_of(frame)
            if needed > self._decimals:
                name = f"{self._before}####.{'#' * needed}{self._after}"
                raise InputError(f"frame {frame_text(frame)} needs decimals in the name ({name})", file=self.template)

    def path(self, frame: float) -> str:
        """The file of ``frame``."""
        number = f"{frame:0{self._width}.{self._decimals}f}" if self._numbered else ""
        return os.path.join(self._folder, self._before + number + self._after)


def _decimals_of(frame: float) -> int:
    written = f"{frame:.{_MOST_DECIMALS}f}".rstrip("0")
    return len(written.partition(".")[2])
