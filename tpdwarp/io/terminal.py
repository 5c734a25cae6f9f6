"""Text for people: what stages, file names and libraries say, made safe to print.

Names come from strangers. Printed raw, an escape sequence drives the terminal, a line break forges a line of progress,
and a mark that turns the direction of writing makes one file look like another.
"""

from __future__ import annotations

import re
from typing import TextIO

# Colours of this program's own tables.
_STYLE = re.compile(r"(\x1b\[[0-9;]*m)")


def printable(text: str) -> str:
    """``text`` in one line, with what cannot be seen written as Python would: ``\\n``, ``\\x1b``, ``\\u202e``."""
    return "".join(character if character.isprintable() else _escaped(character) for character in text)


def printable_lines(text: str) -> str:
    """``text`` with its line breaks and this program's colours, but without anything else that cannot be seen."""
    return "\n".join(
        "".join(part if _STYLE.fullmatch(part) else printable(part) for part in _STYLE.split(line))
        for line in text.split("\n")
    )


def say(text: str, stream: TextIO | None) -> None:
    """Prints a line (or several) at once; a stream that is closed or full keeps nobody from working.

    Args:
        text: The line; see :func:`printable_lines`.
        stream: Where to; None where a process has no such stream.

    Raises:
        BrokenPipeError: The reader of the stream has left.
    """
    if stream is None:
        return
    try:
        print(printable_lines(text), file=stream, flush=True)
    except BrokenPipeError:
        raise
    except (OSError, ValueError):
        # A full disk, or a stream that was closed: the frames are what matters.
        pass


def _escaped(character: str) -> str:
    return character.encode("unicode_escape").decode("ascii")
