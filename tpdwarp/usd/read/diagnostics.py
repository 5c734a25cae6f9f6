"""USD's own diagnostics, turned into this program's errors and warnings instead of lines on stderr."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

from pxr import Tf, UsdUtils

from tpdwarp.errors import InputError, WarnOnce, shortened

# Patterns are looked for in so much of what USD says.
MOST_QUOTED = 1 << 14

_NAMED = re.compile(r"@[^@]*@|<[^>]*>|'[^']*'|\"[^\"]*\"|\(/[^)]*\)")


@contextmanager
def usd_diagnostics(warnings: WarnOnce) -> Iterator[None]:
    """While entered, USD's warnings go to ``warnings``, its errors become :class:`InputError`, and those name the file.

    Warnings are said on leaving, a line a kind.

    Raises:
        InputError: USD posted an error (the message is its first one, in one line), or a name or a text is not UTF-8.
    """
    try:
        with warnings.together(), _usd_diagnostics(warnings):
            yield
    except UnicodeDecodeError as error:
        raise InputError("holds bytes that are not UTF-8 (save its names and texts as UTF-8)", warnings.file) from error


@contextmanager
def _usd_diagnostics(warnings: WarnOnce) -> Iterator[None]:
    delegate = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        yield
    except InputError as error:
        if error.file:
            raise
        raise InputError(error.message, warnings.file, error.prim) from error
    except Tf.ErrorException as error:
        raise InputError(first_error(error), warnings.file) from error
    finally:
        collected = delegate.TakeUncoalescedDiagnostics()
        del delegate
        for diagnostic in collected:
            try:
                whole = diagnostic.commentary
                if any(name in whole for name in warnings.settled):
                    continue
                text = _without_innards(whole)
            except UnicodeDecodeError:
                text = "USD warns of something whose text is not UTF-8"
            warnings.of_usd.append(text)
            # What differs from one missing file or prim to the next is between @, <, quotes or brackets.
            warnings("", text, kind=_NAMED.sub("", text))


@contextmanager
def errors_at(path: object) -> Iterator[None]:
    """While entered, USD's errors are those of the prim at ``path``; they seldom say so themselves.

    Raises:
        InputError: USD posted an error; the file is still to be named.
    """
    try:
        yield
    except Tf.ErrorException as error:
        raise InputError(first_error(error), prim=str(path)) from error


def first_error(error: Tf.ErrorException) -> str:
    """The text of the first USD error, without the place in USD's sources that raised it."""
    text = str(error).strip()
    if len(text) > MOST_QUOTED:
        text = text[:MOST_QUOTED] + "'"
    found = re.search(r" in file \S+ : '(.*?)'(?:\n\tError in|\Z)", text, re.DOTALL)
    return _without_innards(found.group(1) if found else text)


def _without_innards(text: str) -> str:
    """USD's text in one line, without addresses in memory, which differ on every run, and its grammar's rules."""
    # A parser quotes the line it stumbles over, which may be a whole file.
    text = text[:MOST_QUOTED]
    text = re.sub(r"\s*\((instantiating|recomposing) stage on .*$", "", text)
    text = re.sub(r"(?:,|@)@?anon:0x[0-9a-f]+[^@]*@", "", text)
    text = re.sub(r"parse error matching \S*pxrInternal.*?(?= at ')", "parse error", text, flags=re.DOTALL)
    return shortened(re.sub(r"\b0x[0-9a-f]{6,}\b|\bpxrInternal\w*::", "", text))
