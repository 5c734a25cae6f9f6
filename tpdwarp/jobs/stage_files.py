"""Whether the stage's files stay what they were while frames are rendered."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from tpdwarp.errors import FrameError, logger
from tpdwarp.io.digests import file_digest

if TYPE_CHECKING:
    from tpdwarp.usd.read.stage import StageScene


class StageFiles:
    """The files of a stage as they were when rendering began.

    A text layer was read whole when it was opened, and a file that was replaced by another stays open: frames go on
    showing what was opened, and one warning says so. A crate is read from its file frame by frame: one that is written
    over in place would give frames of which no version of the stage ever consisted.

    Args:
        source: The stage, just opened.

    Attributes:
        paths: The files.
        digest: Hash of all that the stage holds.
    """

    def __init__(self, source: StageScene) -> None:
        self._source = source
        self.paths = source.used_files()
        self._opened = {path: layer.GetFileFormat().formatId for path, layer in source.used_layers().items()}
        self._states = {path: _state(path) for path in self.paths}
        self._digests = {path: file_digest(path) for path in self.paths}
        self.digest = source.content_digest(self._digests.values())

    def check(self) -> None:
        """Looks for files that have changed.

        Raises:
            FrameError: What was rendered since the last look may mix two versions of the stage.
        """
        for path, before in list(self._states.items()):
            now = _state(path)
            if now == before:
                continue
            replaced = now is None or before is None or now[:2] != before[:2]
            if path in self._opened and (replaced or self._opened[path] == "usda"):
                self._states[path] = now
                if now is not None and self._differs(path):
                    logger.warning(f"{path}: has changed since it was opened; frames go on showing what it held then")
            elif self._differs(path):
                raise FrameError(f"{path}: was written over while frames were rendered of it (render them again)")
            else:
                self._states[path] = now

    @contextmanager
    def unchanged(self, strict: bool = False) -> Iterator[None]:
        """Refuses what was made while files changed, and if ``strict``, while USD warned of something.

        Raises:
            FrameError: That is so.
        """
        warned = self._source.warnings.of_usd
        said = len(warned)
        try:
            yield
        except Exception:
            # A stage that is written over fails with errors that say nothing of the cause.
            self.check()
            raise
        self.check()
        if strict and len(warned) > said:
            raise FrameError(f"{self._source.file}: {warned[said]} (--strict)")

    def _differs(self, path: str) -> bool:
        try:
            return file_digest(path) != self._digests[path]
        except OSError:
            return True


def _state(path: str) -> tuple[int, int, int, int] | None:
    """Which file this is, its size and when it was last written; None where there is none."""
    try:
        status = os.stat(path)
    except OSError:
        return None
    return status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns
