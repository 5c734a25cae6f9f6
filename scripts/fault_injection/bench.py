"""What faults are injected into."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scripts.fault_injection.program import Ended


@dataclass(frozen=True)
class Bench:
    """What faults are injected into.

    Attributes:
        scene: A stage as a crate.
        folder: Where to work; each fault has a folder of its own in it.
        reference: Frames of a render that was left alone.
    """

    scene: Path
    folder: Path
    reference: Mapping[str, dict[str, np.ndarray]]

    def new(self, name: str) -> Path:
        """An empty folder."""
        folder = self.folder / name
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        return folder

    def rendered(self, name: str) -> Path:
        """A folder with the frames of the reference, as the program wrote them."""
        folder = self.new(name)
        for path in (self.folder / "reference").glob("*.exr"):
            shutil.copy2(path, folder)
        return folder


def how_ended(ended: Ended) -> str:
    """How a run ended, in a cell of the table."""
    said = ended.err.strip().splitlines()
    return f"code {ended.code}" + (f": {said[-1]}" if said else "")
