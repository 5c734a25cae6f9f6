"""Errors and warnings that a user reads: one line, naming file, prim and what to do."""

from __future__ import annotations

import logging

logger = logging.getLogger("tpdwarp")

# Libraries quote whole files and stacks of calls; what they mean stands in front.
LONGEST_QUOTE = 240


def shortened(text: str) -> str:
    """What a library says, in one line of at most 240 characters."""
    line = " ".join(text[: 20 * LONGEST_QUOTE].split())
    return line if len(line) <= LONGEST_QUOTE else line[: LONGEST_QUOTE - 2] + " …"


class InputError(Exception):
    """Input that cannot be used (exit code 2). ``str()`` is ``FILE: /Prim/Path: what is wrong (and what to do)``.

    Args:
        message: What is wrong, and what to do about it, in one line.
        file: The file concerned, or empty.
        prim: The prim path concerned (with ``.attribute`` where one is to blame), or empty.
    """

    def __init__(self, message: str, file: str = "", prim: str = "") -> None:
        self.file, self.prim, self.message = str(file), str(prim), " ".join(message.split())
        super().__init__(": ".join(part for part in (self.file, self.prim, self.message) if part))


class FrameError(Exception):
    """One frame that could not be rendered or written (exit code 1); the sequence goes on."""


class WarnOnce:
    """Reports each unsupported thing once, by prim, to the ``tpdwarp`` logger.

    Args:
        file: The file every message names.
        silent: Whether messages are kept and not reported.
    """

    def __init__(self, file: str, silent: bool = False) -> None:
        self.file, self._silent = str(file), silent
        self.messages: list[str] = []
        self._known: set[str] = set()

    def __call__(self, prim: str, message: str) -> None:
        line = ": ".join(part for part in (self.file, str(prim), " ".join(message.split())) if part)
        if line not in self._known:
            self._known.add(line)
            self.messages.append(line)
            if not self._silent:
                logger.warning(line)
