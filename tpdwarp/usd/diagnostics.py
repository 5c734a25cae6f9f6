"""USD's own diagnostics, turned into this program's errors and warnings instead of lines on stderr."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

from pxr import Tf, UsdUtils

from tpdwarp.errors import InputError, WarnOnce


@contextmanager
def usd_diagnostics(warnings: WarnOnce) -> Iterator[None]:
    """While entered, USD's warnings go to ``warnings`` and its errors become :class:`InputError`.

    Raises:
        InputError: USD posted an error; the message is its first one, in one line.
    """
    delegate = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        yield
    except Tf.ErrorException as error:
        raise InputError(_first_error(error), warnings.file) from error
    finally:
        collected = delegate.TakeUncoalescedDiagnostics()
        del delegate
        for diagnostic in collected:
            # USD ends its composition warnings with the stage's address in memory, which differs on every run.
            warnings("", re.sub(r"\s*\((instantiating|recomposing) stage on .*$", "", diagnostic.commentary))


def _first_error(error: Tf.ErrorException) -> str:
    """The text of the first USD error, without the place in USD's sources that raised it."""
    found = re.search(r" in file \S+ : '(.*?)'(?:\n\tError in|\Z)", str(error), re.DOTALL)
    return found.group(1) if found else str(error)
