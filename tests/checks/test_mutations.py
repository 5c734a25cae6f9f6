"""Deliberate faults are caught at calibrated limits, and honest renders pass, as a script shows at full length."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
RENDERED = ("shutter off by half a frame", "one photon in fifty lost", "light 1 % dimmer", "D_t x forgotten")
TRACED = ("D_t x of the wrong sign", "stale ids")


@pytest.fixture(scope="module")
def lines():
    """What the script prints of each fault and of honest renders."""
    command = [sys.executable, "scripts/check_mutations.py", "--few", "--width", "64", "--seeds", "2", "--renders", "3"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode in (0, 1), done.stderr
    return done.stdout.splitlines()


def test_every_fault_is_caught(lines):
    caught = {line.partition("  ")[0] for line in lines if re.search(r"  +caught by ", line)}
    missed = [line for line in lines if line.endswith("WRONG")]
    assert missed == [] and len(caught) >= 30
    assert {*RENDERED, *TRACED} <= caught


def test_what_makes_faults_makes_none_of_its_own(lines):
    honest = [line for line in lines if line.startswith("no fault")]
    assert len(honest) == 4 and all(line.endswith("  passes") for line in honest)


def test_honest_renders_raise_no_alarm(lines):
    assert "2 honest renders, other seeds: 0 alarms" in lines
    assert "3 honest renders, other thread counts: 0 alarms" in lines
