"""Hashes of what files hold."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from pathlib import Path

DIGESTS = "tpdwarp.sums.json"
_BLOCK = 1 << 20


def file_digest(path: str) -> str:
    """SHA-256 of what a file holds, in hexadecimal digits.

    Raises:
        OSError: It cannot be read.
    """
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        while block := file.read(_BLOCK):
            digest.update(block)
    return digest.hexdigest()


def note_digests(folder: str) -> None:
    """Writes the hashes of the files in ``folder`` beside them; where that cannot be done, there are none."""
    digests = {path.name: file_digest(str(path)) for path in sorted(Path(folder).iterdir()) if path.is_file()}
    with contextlib.suppress(OSError):
        temporary = Path(folder) / f".{os.getpid()}.{DIGESTS}"
        temporary.write_text(json.dumps(digests))
        os.replace(temporary, Path(folder) / DIGESTS)


def has_its_digests(folder: str) -> bool:
    """Whether the files in ``folder`` are those that were noted, as far as any were."""
    try:
        digests = json.loads((Path(folder) / DIGESTS).read_text())
        return all(file_digest(os.path.join(folder, name)) == digest for name, digest in digests.items())
    except FileNotFoundError:
        # A file that was noted is gone, or nothing was noted.
        return not (Path(folder) / DIGESTS).exists()
    except (OSError, ValueError, AttributeError):
        return False
