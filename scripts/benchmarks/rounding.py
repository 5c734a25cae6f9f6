"""Rounding: photons traced in single precision against the float64 oracle, as the tests measure it."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def run() -> list[dict[str, object]]:
    """Median and worst relative error of each quantity on each scene, as the table of docs/rounding.md."""
    with tempfile.TemporaryDirectory() as folder:
        found = Path(folder) / "rounding.json"
        subprocess.run([sys.executable, "-m", "tests.rounding", "--json", str(found)], cwd=ROOT, check=True)
        return json.loads(found.read_text(encoding="utf-8"))
