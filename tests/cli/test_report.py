import logging

from tpdwarp.cli.report import report, summary_lines, warnings_shown
from tpdwarp.errors import logger
from tpdwarp.jobs.progress import Progress
from tpdwarp.jobs.results import FrameOutcome, SequenceResult
from tpdwarp.photons.energy import EnergyAccount


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


def test_the_summary_tells_energy_warnings_by_kind_and_why_frames_were_rendered_anew():
    energy = EnergyAccount(sent=4.0, deposited=3.0, escaped=0.5, absorbed=0.3, lost={"bounces": 0.2})
    outcomes = (FrameOutcome(1, "written", energy=energy, tries=2), FrameOutcome(2, "failed", reason="no"))
    result = SequenceResult(outcomes, 2.0, anew={"damaged": 3, "of other settings": 1})
    assert summary_lines(result, {"textures are not read": 7, "is not supported": 1}) == [
        "rendered anew: 3 damaged, 1 of other settings",
        "tried more than once: 1",
        "energy: 75.0% deposited, 12.5% escaped, 7.5% absorbed, 5.0% lost",
        "warnings: 7 × textures are not read; 1 × is not supported",
        "1 of 2 frames done, 1 failed, 2.0 s",
    ]


def test_warnings_of_one_kind_are_counted_whatever_they_are_about():
    listener = Listener()
    with warnings_shown(listener, "error") as kinds:
        for prim in ("A", "B"):
            logger.warning(f"s.usda: /World/{prim}: has no points: it is left out")
        logger.warning("s.usda: the camera is the first")
        logger.error("a.json: full")
    assert kinds == {"has no points: it is left out": 2, "the camera is the first": 1}
    assert listener.lines == ["error: a.json: full"]
