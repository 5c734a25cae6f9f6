"""Solutions kept on disk under a hash of all that they depend on, so that a study can be cut short and taken up."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from tpdwarp.errors import logger, shortened
from tpdwarp.io.files import check_writable, complete_or_absent
from tpdwarp.studies.solutions import Solution
from tpdwarp.version import VERSION

# What only parses, prints, compares or studies does not change a frame.
_ASIDE = ("cli", "studies", "checks", "html")


def default_folder() -> Path:
    """Where solutions are kept unless the user says otherwise: the user's cache folder."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "tpdwarp" / "study"


class Store:
    """Solutions by what they depend on.

    Args:
        folder: Where they are kept.
        scene: Hash of the scene's content.

    Raises:
        InputError: The folder cannot be written.
    """

    def __init__(self, folder: str | os.PathLike[str], scene: str) -> None:
        self.folder = Path(folder)
        check_writable(self.folder / "solution.npz")
        self._common = {"scene": scene, "program": program_hash()}

    def path(self, what: dict[str, Any]) -> Path:
        """The file of the solution of ``what``, plain JSON values."""
        text = json.dumps({**self._common, **what}, sort_keys=True)
        return self.folder / f"{hashlib.sha256(text.encode()).hexdigest()[:32]}.npz"

    def load(self, path: Path) -> Solution | None:
        """The solution at ``path``; None where there is none, or none that can be read, of which the log is told."""
        if not path.exists():
            return None
        try:
            with np.load(path) as stored:
                notes = json.loads(str(stored["notes"]))
                return Solution(stored["caustic"], stored["beauty"], **notes)
        except Exception as error:
            # Damaged archives raise nearly anything (zlib.error, RuntimeError, MemoryError), and one cure is for all.
            logger.warning("%s: is damaged and made anew (%s)", path, shortened(f"{type(error).__name__}: {error}"))
            return None

    def save(self, path: Path, solution: Solution) -> None:
        """Keeps a solution; it appears only when complete.

        Raises:
            FrameError: It cannot be written.
            OSError: Likewise.
        """
        notes = {name: getattr(solution, name) for name in ("cpu_seconds", "seconds", "landed", "memory")}
        with complete_or_absent(path) as temporary:
            np.savez_compressed(
                temporary, caustic=solution.caustic, beauty=solution.beauty, notes=np.array(json.dumps(notes))
            )


def program_hash() -> str:
    """Hash of the parts of the program that make frames."""
    root = Path(__file__).resolve().parents[1]
    digest = hashlib.sha256(VERSION.encode())
    for path in sorted(root.rglob("*.py")):
        if path.relative_to(root).parts[0] not in _ASIDE:
            digest.update(path.relative_to(root).as_posix().encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()
