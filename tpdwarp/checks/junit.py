"""The result of a check as JUnit XML, in the part of the format that GitLab, Jenkins and GitHub's actions all show."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

from tpdwarp.checks.findings import CheckResult, Finding
from tpdwarp.io.files import complete_or_absent

# XML 1.0 has no way to write these; a parser that meets one drops the whole file.
_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def as_junit(result: CheckResult) -> ElementTree.ElementTree:
    """A result as JUnit XML: one suite, one test a frame, warnings among its output."""
    suite_name = f"tpdwarp check {Path(result.baseline_path).name}"
    # What is not in Jenkins' schema (a file to each test, for one) is left out: its xUnit plug-in drops files for that.
    counts = {"tests": str(len(result.frames)), "failures": str(len(result.failed)), "errors": "0"}
    root = ElementTree.Element("testsuites", name="tpdwarp check", time=f"{result.seconds:.3f}", **counts)
    suite = ElementTree.SubElement(root, "testsuite", name=_clean(suite_name), time=f"{result.seconds:.3f}", **counts)
    for frame in result.frames:
        name = f"frame {frame.name}" if frame.frame is not None and not frame.name.startswith("photons") else frame.name
        case = ElementTree.SubElement(
            suite,
            "testcase",
            name=_clean(name),
            classname=_clean(suite_name.replace(".", "_")),
            time=f"{frame.seconds:.3f}",
        )
        if frame.failures:
            kinds = ", ".join(dict.fromkeys(finding.kind for finding in frame.failures))
            first = _clean(str(frame.failures[0]))
            failure = ElementTree.SubElement(case, "failure", type=_clean(kinds), message=first)
            failure.text = _clean(_lines(frame.failures, f"frame {frame.path}", f"baseline {frame.baseline}"))
            if result.report:
                failure.text += _clean(f"\nreport {result.report}")
        warnings = [finding for finding in frame.findings if finding.severity == "warn"]
        if warnings:
            ElementTree.SubElement(case, "system-out").text = _clean(_lines(warnings))
    return ElementTree.ElementTree(root)


def write_junit(path: str | os.PathLike[str], result: CheckResult) -> None:
    """Writes a result as JUnit XML; the file appears only when complete.

    Raises:
        FrameError: The file cannot be written.
    """
    tree = as_junit(result)
    ElementTree.indent(tree)
    with complete_or_absent(path) as temporary:
        tree.write(temporary, encoding="utf-8", xml_declaration=True)


def _lines(findings: Sequence[Finding], *more: str) -> str:
    return "\n".join([*(f"{finding.kind}: {finding}" for finding in findings), *more])


def _clean(text: str) -> str:
    return _FORBIDDEN.sub("\ufffd", text)
