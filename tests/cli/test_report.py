import logging

from tpdwarp.cli.report import report, warnings_shown
from tpdwarp.errors import logger
from tpdwarp.jobs.progress import Progress
from tpdwarp.jobs.results import FrameOutcome, SequenceResult


class Listener(Progress):
    def __init__(self):
        self.lines = []

    def message(self, line):
        self.lines.append(line)


def test_warnings_go_through_the_progress_in_one_line_each():
    listener = Listener()
    with warnings_shown(listener):
        logger.warning("first\n  second")
        logger.info("not for people")
    logger.warning("too late")
    assert listener.lines == ["warning: first second"]


def test_tracebacks_of_frames_are_shown_only_for_debugging(monkeypatch):
    for value, shown in (("0", False), ("1", True)):
        monkeypatch.setenv("TPDWARP_DEBUG", value)
        listener = Listener()
        with warnings_shown(listener):
            logger.debug("frame 2", exc_info=ValueError("bad"))
        assert bool(listener.lines) == shown
    assert "ValueError: bad" in listener.lines[0]
    assert logger.level == logging.NOTSET


def test_what_failed_beside_frames_is_an_error_too(capsys):
    result = SequenceResult((FrameOutcome(1, "written"),), 1.0, ("a.json: No space left on device",))
    assert report(result, quiet=True) == 1
    assert capsys.readouterr() == ("", "error: a.json: No space left on device\n")


def test_success_is_one_line_or_none(capsys):
    result = SequenceResult((FrameOutcome(1, "written"), FrameOutcome(2, "skipped")), 1.25)
    assert report(result, quiet=False) == 0
    assert capsys.readouterr().out == "1 of 2 frames done, 1 skipped, 1.2 s\n"
    assert report(result, quiet=True) == 0
    assert capsys.readouterr().out == ""
