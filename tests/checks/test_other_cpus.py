"""One baseline serves other processors: what rounds differently differs, and raises no alarm; a script has them all."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.slow
def test_another_processors_rounding_passes_at_default_limits():
    command = [sys.executable, "scripts/check_other_cpus.py", "--scenes", "wave", "--builds", "sse2,fused"]
    command += ["--width", "64", "--photons", "1024", "--seeds", "0"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    rows = [line.split() for line in done.stdout.splitlines() if line.startswith("wave ")]
    fused = rows[-1]
    assert "fused" in fused and all("0," in row for row in rows)
    # Were nothing different, nothing would have been shown.
    *_, rmse, _, _, photons = fused
    assert photons == "differ" and float(rmse) > 0
