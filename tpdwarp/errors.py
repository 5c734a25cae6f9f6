"""Errors and warnings that a user reads: one line, naming file, prim and what to do."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from contextlib import contextmanager

logger = logging.getLogger("tpdwarp")

# Libraries quote whole files and stacks of calls; what they mean stands in front.
LONGEST_QUOTE = 240


def shortened(text: str) -> str:
    """What a library says, in one line of at most 240 characters."""
    line = " ".join(text[: 20 * LONGEST_QUOTE].split())
    return line if len(line) <= LONGEST_QUOTE else line[: LONGEST_QUOTE - 2] + " …"


# Options of the command line that are no other spelling of their argument in Python.
_ARGUMENTS = {
    "aov": "aovs",
    "imageWidth": "image_width",
    "renderSettingsPrimPath": "render_settings",
    "skip-existing-frames": "skip_existing",
    "truth": "truth_file",
}
_FLAG = re.compile(r"(?<![\w-])--(?!tpdwarp-)([A-Za-z][A-Za-z-]*)")
_speaks_flags = False


@contextmanager
def flags_spoken() -> Iterator[None]:
    """While entered, errors name options as the command line does; else by their arguments in Python."""
    global _speaks_flags
    before, _speaks_flags = _speaks_flags, True
    try:
        yield
    finally:
        _speaks_flags = before


def spoken(message: str) -> str:
    """A message whose options are written as flags (``--frame-timeout``), as its reader knows them."""
    if _speaks_flags:
        return message
    return _FLAG.sub(lambda flag: _ARGUMENTS.get(flag[1], flag[1].replace("-", "_")), message)


class InputError(Exception):
    """Input that cannot be used (exit code 2). ``str()`` is ``FILE: /Prim/Path: what is wrong (and what to do)``.

    Options are written as the command line's flags; who calls from Python reads the names of arguments.

    Args:
        message: What is wrong, and what to do about it, in one line.
        file: The file concerned, or empty.
        prim: The prim path concerned (with ``.attribute`` where one is to blame), or empty.
    """

    def __init__(self, message: str, file: str = "", prim: str = "") -> None:
        self.file, self.prim, self.message = str(file), str(prim), spoken(" ".join(message.split()))
        super().__init__(": ".join(part for part in (self.file, self.prim, self.message) if part))


class FrameError(Exception):
    """One frame that could not be rendered or written (exit code 1); the sequence goes on."""


class WarnOnce:
    """Reports each kind of unsupported thing once, with its first prim and a count, to the ``tpdwarp`` logger.

    Two warnings are of one kind where their text is the same, or the ``kind`` given instead. Within :meth:`together`
    they are held back until all of them are counted; a kind that was said is not said again for prims found later.

    Args:
        file: The file every message names.
        silent: Whether messages are kept and not reported.

    Attributes:
        messages: What was reported.
        of_usd: Those that are USD's own, of what it could not compose or read.
        settled: Names of files that USD complains of and that are read in another way: what names one is dropped.
    """

    def __init__(self, file: str, silent: bool = False) -> None:
        self.file, self._silent = str(file), silent
        self.of_usd: list[str] = []
        self.settled: set[str] = set()
        self._kinds: dict[str, _Kind] = {}
        self._held: list[_Kind] | None = None

    def __call__(self, prim: str, message: str, kind: str = "") -> None:
        text = " ".join(message.split())
        key = kind or text
        known = self._kinds.get(key)
        if known is not None:
            known.found.add((str(prim), text))
            return
        found = self._kinds[key] = _Kind(str(prim), text)
        if self._held is not None:
            self._held.append(found)
        elif not self._silent:
            logger.warning(self._line(found))

    @property
    def messages(self) -> list[str]:
        """One line for each kind found so far, in the order of their first prims."""
        return [self._line(kind) for kind in self._kinds.values()]

    @contextmanager
    def together(self) -> Iterator[None]:
        """While entered, warnings are counted, to be said on leaving; entered twice, the outermost says them."""
        if self._held is not None:
            yield
            return
        self._held = []
        try:
            yield
        finally:
            held, self._held = self._held, None
            for kind in held if not self._silent else ():
                logger.warning(self._line(kind))

    def _line(self, kind: _Kind) -> str:
        others = len(kind.found) - 1
        count = f" and {others} more" if others else ""
        named = kind.first + count if kind.first else ""
        return ": ".join(part for part in (self.file, named, kind.text if named else kind.text + count) if part)


class _Kind:
    """One kind of warning: its first prim and text, and all that was found of it."""

    def __init__(self, first: str, text: str) -> None:
        self.first, self.text, self.found = first, text, {(first, text)}
