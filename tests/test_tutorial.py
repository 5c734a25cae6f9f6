"""What is shown to researchers runs: the tutorial, and the examples of docstrings."""

from __future__ import annotations

import doctest
import runpy
from pathlib import Path

import pytest

import tpdwarp.jobs.live_scene

ROOT = Path(__file__).resolve().parent.parent


def test_the_tutorial_splats_what_the_program_computes(capsys):
    found = runpy.run_path(str(ROOT / "scripts" / "tutorial.py"))
    assert "differ by" in capsys.readouterr().out
    assert found["splatted"].std() > 0.1 * found["splatted"].mean()
    # The kernels' variances differ by (1/4 − 1/12) h², by which the curvature k² of a wave of length 1.3 is smoothed;
    # cells are h = .03 wide.
    assert found["difference"] < 0.5 * (1 / 4 - 1 / 12) * 0.03**2 * (2 * 3.1416 / 1.3) ** 2


@pytest.mark.parametrize("module", [tpdwarp.jobs.live_scene], ids=lambda module: module.__name__)
def test_examples_of_docstrings_say_what_comes_out(module, monkeypatch):
    monkeypatch.chdir(ROOT)
    result = doctest.testmod(module)
    assert result.attempted > 0 and result.failed == 0
