"""The script that injects faults finds none that costs a frame."""

import subprocess
import sys
from pathlib import Path

import pytest

import tpdwarp

ROOT = Path(tpdwarp.__file__).parent.parent


@pytest.mark.slow
def test_injected_faults_cost_no_frame():
    done = subprocess.run(
        [sys.executable, ROOT / "scripts" / "faults.py", "--kills", "10"], capture_output=True, text=True, timeout=3600
    )
    assert done.returncode == 0, done.stdout + done.stderr
