#!/usr/bin/env python3
"""Makes all figures of the paper in docs/figures, or those named by number.

    .venv/bin/python scripts/figures/all.py          # all, in a few minutes
    .venv/bin/python scripts/figures/all.py 6 9
"""

from __future__ import annotations

import argparse
import importlib
import re
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from usd_scenes.drawing.sheets import DOCS, publish

FOLDER = Path(__file__).resolve().parent
# Modules of this folder by the number of their figure.
FIGURES = {int(re.match(r"fig(\d+)_", path.name)[1]): path.stem for path in sorted(FOLDER.glob("fig*_*.py"))}


def main() -> None:
    """Makes the figures that the command line asks for."""
    parser = argparse.ArgumentParser(description="Makes the figures of the paper.")
    parser.add_argument("figure", nargs="*", type=int, metavar="|".join(map(str, FIGURES)), help="which (default: all)")
    parser.add_argument("--out", type=Path, default=DOCS, metavar="FOLDER", help="where to (default: docs/figures)")
    options = parser.parse_args()
    for number in options.figure or FIGURES:
        print(publish(importlib.import_module(FIGURES[number]).make(), options.out), flush=True)


if __name__ == "__main__":
    main()
