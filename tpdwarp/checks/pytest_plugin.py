"""A pytest plug-in: tests that render a stage and hold it against a baseline, in three lines.

    def test_wave(tpdwarp_frames):
        tpdwarp_frames("wave.usdc", frames="1:6", exposure=1.0)

Baselines lie in ``baselines/<module>/<test>/`` beside the test's file. They are made, and replaced, with
``pytest --tpdwarp-update --tpdwarp-reason "why"``. A failure shows what differs, and where the report is.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from tpdwarp.checks.findings import CheckResult
    from tpdwarp.checks.limits import Limits

FilePath = str | os.PathLike[str]


def pytest_addoption(parser: pytest.Parser) -> None:
    """Adds the plug-in's options."""
    group = parser.getgroup("tpdwarp", "frames and their baselines")
    group.addoption(
        "--tpdwarp-update", action="store_true", help="Make what is rendered the baseline, where it differs."
    )
    group.addoption("--tpdwarp-reason", default="", metavar="TEXT", help="Why; --tpdwarp-update needs it.")
    group.addoption("--tpdwarp-reports", metavar="DIR", help="Folder for the reports. [each test's temporary folder]")
    parser.addini("tpdwarp_baselines", "Folder of the baselines, beside each test's file.", default="baselines")


def pytest_configure(config: pytest.Config) -> None:
    """Refuses an update without a reason before anything is rendered."""
    if config.getoption("--tpdwarp-update") and not config.getoption("--tpdwarp-reason").strip():
        raise pytest.UsageError("--tpdwarp-update needs --tpdwarp-reason (a line for the baselines' records)")


def assert_frames_match(
    frames: FilePath,
    baseline: FilePath,
    *,
    limits: FilePath | Limits | None = None,
    report: FilePath | None = None,
) -> CheckResult:
    """Fails the test where frames differ from their baseline beyond its limits.

    Args:
        frames, baseline, limits, report: As for :func:`tpdwarp.check`.

    Returns:
        What the check found.

    Raises:
        AssertionError: They differ; the message is the check's table, and where the report is.
        InputError: They cannot be compared.
    """
    __tracebackhide__ = True
    from tpdwarp.checks.run import check

    result = check(frames, baseline, limits=limits, report=report)
    if not result.ok:
        pytest.fail(_message(result), pytrace=False)
    return result


@pytest.fixture
def tpdwarp_frames(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[..., CheckResult]:
    """Renders a stage and checks it: ``tpdwarp_frames(scene, baseline=None, limits=None, name="frame", **settings)``.

    ``settings`` are the arguments of :func:`tpdwarp.render`; a relative ``scene`` or ``baseline`` lies beside the
    test's file. A test that checks several stages gives each a ``baseline``.
    """

    def render_and_check(
        scene: FilePath,
        baseline: FilePath | None = None,
        limits: FilePath | Limits | None = None,
        name: str = "frame",
        **settings: Any,
    ) -> CheckResult:
        __tracebackhide__ = True
        from tpdwarp.checks.run import check
        from tpdwarp.checks.update import update_baseline
        from tpdwarp.jobs.sequence import render

        beside = request.path.parent
        module = beside / request.config.getini("tpdwarp_baselines") / request.path.stem
        expected = beside / baseline if baseline else module / _file_name(request.node.name)
        frames = tmp_path / f"{_file_name(expected.name)}-frames"
        rendered = render(beside / scene, frames / f"{name}.####.exr", **settings)
        if not rendered.ok:
            reasons = [f"frame {frame:g}: {reason}" for frame, reason in rendered.failed.items()]
            pytest.fail("\n".join(["frames could not be rendered", *reasons, *rendered.problems]), pytrace=False)
        reports = request.config.getoption("--tpdwarp-reports")
        folder = Path(reports) if reports else tmp_path
        report = folder / f"{_file_name(f'{request.path.stem}-{request.node.name}-{expected.name}')}.html"
        update = request.config.getoption("--tpdwarp-update")
        if not update and not expected.is_dir():
            pytest.fail(f'{expected}: there is no baseline (run with --tpdwarp-update --tpdwarp-reason "why")', False)
        result = check(frames, expected, limits=limits, report=report, new=update)
        if update:
            # All frames that the test asks for are there, so that others are no longer asked for.
            update_baseline(result, request.config.getoption("--tpdwarp-reason"), drop_missing=True)
        elif not result.ok:
            pytest.fail(_message(result), pytrace=False)
        return result

    return render_and_check


def _message(result: CheckResult) -> str:
    from tpdwarp.checks.table import table_lines

    report = [f"report: {Path(result.report).resolve()}"] if result.report else []
    return "\n".join([f"{result.frames_path} differs from {result.baseline_path}", *table_lines(result), *report])


def _file_name(text: str) -> str:
    return re.sub(r"[^\w.-]+", "_", text).strip("_")
