"""Names of strangers do nothing to a terminal."""

import contextlib
import io

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tpdwarp.io.terminal import printable, printable_lines, say


@given(st.text(alphabet=st.characters(exclude_categories=())))
def test_printable_text_has_nothing_that_cannot_be_seen_and_says_what_it_was(text):
    shown = printable(text)
    assert shown.isprintable()
    if "\\" not in text:
        escaped = shown.encode("ascii", "backslashreplace").decode("unicode_escape")
        assert escaped == text


@pytest.mark.parametrize("text", ["wave.0001.exr", "Wellen/größe 波.exr", "a — b … ×"])
def test_what_can_be_seen_is_left_alone(text):
    assert printable(text) == text


def test_lines_keep_their_breaks_and_colours_only():
    assert printable_lines("\x1b[31mred\x1b[0m\x1b]0;title\x07\nnext") == "\x1b[31mred\x1b[0m\\x1b]0;title\\x07\nnext"


def test_a_stream_that_is_absent_closed_or_full_is_no_error():
    closed = io.StringIO()
    closed.close()
    say("x", None)
    say("x", closed)
    # What is buffered is tried again when the file is closed.
    with contextlib.suppress(OSError), open("/dev/full", "w") as full:
        say("x", full)
