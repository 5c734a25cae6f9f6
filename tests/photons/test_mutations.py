"""Check 25: the oracle comparison notices a term that is missing from the algebra, so it tests what it says."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import tpdwarp

PACKAGE = Path(tpdwarp.__file__).parent
ROOT = Path(__file__).resolve().parents[2]
SCRIPT = """
import json, tpdwarp
from tests.photons.moving_scenes import SCENES
from tests.photons.oracle_comparison import compare
from tests.photons.traced import traced
ratios = compare(traced(SCENES["a turning cylinder"](), 500), "surface").ratios
print(json.dumps({"package": tpdwarp.__file__, **ratios}))
"""
MUTATIONS = {
    "nothing": None,
    "n·q̇ in transfer": ("differentials.py", "wp.dot(n_g, y - motion)", "wp.dot(n_g, y)"),
    "the drift in D_t n": ("beam.py", "normal_variation(s, hit, incident.dxdt - hit.motion) + s.rate", "s.rate"),
    "the sign of D_t x": ("tracing.py", "out.dxdt[i] = beam.dxdt", "out.dxdt[i] = -beam.dxdt"),
    "the receiver's own motion": ("record.py", "photons.dxdt - photons.receiver_motion", "photons.dxdt"),
}


def ratios_without(removed: str, folder: Path) -> dict[str, float]:
    """Errors of each column in units of their tolerance, by a copy of the package that lacks something."""
    copy = folder / "tpdwarp"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    if MUTATIONS[removed]:
        name, there, instead = MUTATIONS[removed]
        file = copy / "photons" / name
        text = file.read_text()
        assert text.count(there) == 1
        file.write_text(text.replace(there, instead))
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)])}
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    assert Path(found.pop("package")).parent == copy
    return found


def test_an_unchanged_copy_agrees_with_the_oracle(tmp_path):
    assert max(ratios_without("nothing", tmp_path).values()) <= 1


@pytest.mark.parametrize("removed", [name for name in MUTATIONS if name != "nothing"])
def test_the_oracle_notices_what_is_missing_and_only_in_the_time_column(removed, tmp_path):
    ratios = ratios_without(removed, tmp_path)
    assert ratios.pop("dxdt") > 10
    assert max(ratios.values()) <= 1
