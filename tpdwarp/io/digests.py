"""Hashes of what files hold."""

from __future__ import annotations

import hashlib

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
