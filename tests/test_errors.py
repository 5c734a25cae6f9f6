"""Warnings are said once a kind, with the first prim and how many there are."""

import logging

from tpdwarp.errors import WarnOnce


def test_a_kind_is_one_line_with_its_first_prim_and_a_count(caplog):
    warnings = WarnOnce("a.usd")
    with caplog.at_level(logging.WARNING, "tpdwarp"), warnings.together():
        for k in range(47):
            warnings(f"/World/{k}", "is not read")
            warnings(f"/World/{k}", "is not read")
        warnings("/Other", "is left out")
    lines = ["a.usd: /World/0 and 46 more: is not read", "a.usd: /Other: is left out"]
    assert [record.getMessage() for record in caplog.records] == warnings.messages == lines


def test_a_kind_that_was_said_is_counted_and_not_said_again(caplog):
    warnings = WarnOnce("a.usd")
    with caplog.at_level(logging.WARNING, "tpdwarp"):
        warnings("/A", "is not read")
        with warnings.together():
            warnings("/B", "is not read")
    assert len(caplog.records) == 1
    assert warnings.messages == ["a.usd: /A and 1 more: is not read"]


def test_texts_that_differ_may_be_of_one_kind():
    warnings = WarnOnce("a.usd")
    warnings("", "could not open @a.usd@", kind="could not open")
    warnings("", "could not open @b.usd@", kind="could not open")
    assert warnings.messages == ["a.usd: could not open @a.usd@ and 1 more"]


def test_warnings_held_back_are_said_when_an_error_ends_it(caplog):
    warnings = WarnOnce("a.usd")
    with caplog.at_level(logging.WARNING, "tpdwarp"):
        try:
            with warnings.together():
                warnings("/A", "is not read")
                raise ValueError
        except ValueError:
            pass
    assert len(caplog.records) == 1
