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
    # Refraction keeps what the wave's light carries in: the strip has the flux that comes through the surface.
    assert found["splatted"].std() > 0.1 * found["splatted"].mean()
    # Photons are counted in rows of whole cells: a strip of 1 holds one more or less of some 45.
    assert found["difference"] < 0.05


@pytest.mark.parametrize("module", [tpdwarp.jobs.live_scene], ids=lambda module: module.__name__)
def test_examples_of_docstrings_say_what_comes_out(module, monkeypatch):
    monkeypatch.chdir(ROOT)
    result = doctest.testmod(module)
    assert result.attempted > 0 and result.failed == 0
