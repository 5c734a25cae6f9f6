"""Frames whose files are there already: which may stay, and why others are rendered anew."""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from tpdwarp.errors import InputError, logger, shortened
from tpdwarp.io.images import read_image, read_metadata
from tpdwarp.jobs.fingerprint import Fingerprint
from tpdwarp.photons.energy import EnergyAccount

STATISTICS = "tpdwarp:statistics"

# PNG's last chunk with its checksum, and JPEG's marker of the end of an image.
_ENDINGS = {".png": b"IEND\xaeB`\x82", ".jpg": b"\xff\xd9", ".jpeg": b"\xff\xd9"}


@dataclass(frozen=True)
class KeptFrame:
    """What a frame that may stay says of its rendering, as far as its format holds it.

    Attributes:
        photons: Photons landed.
        energy: Where the flux went.
        seconds: Seconds by stage.
    """

    photons: int = 0
    energy: EnergyAccount | None = None
    seconds: Mapping[str, float] = field(default_factory=dict)


class ExistingFrames:
    """Judges files by what they say of themselves and by reading them whole.

    A file stays only where its fingerprint is that of the frame that would be rendered now and all its pixels can be
    read. Of each reason to render frames anew the first is reported at once, to the ``tpdwarp`` logger.

    Args:
        fingerprint: That of the sequence.

    Attributes:
        anew: How many frames are rendered anew, by reason.
    """

    def __init__(self, fingerprint: Fingerprint) -> None:
        self._fingerprint = fingerprint
        self.anew: Counter[str] = Counter()

    def kept(self, path: str, frame: float) -> KeptFrame | None:
        """What is known of the frame at ``path``; None where there is none that may stay."""
        if not os.path.lexists(path):
            return None
        reason, metadata = self._judged(path, frame)
        if not reason:
            return kept_frame(metadata)
        kind = reason.partition(" (")[0]
        self.anew[kind] += 1
        if self.anew[kind] == 1:
            logger.warning(f"{path}: is {reason} and rendered anew, as others of its kind will be")
        return None

    def _judged(self, path: str, frame: float) -> tuple[str, Mapping[str, Any]]:
        try:
            metadata = read_metadata(path)
            reason = self._fingerprint.difference(frame, metadata)
            if not reason:
                read_image(path)
                reason = "" if _has_its_end(path) else "damaged (its end is missing)"
            return reason, metadata
        except (InputError, OSError, MemoryError, ValueError) as error:
            return f"damaged ({shortened(getattr(error, 'message', str(error)))})", {}


def statistics_text(photons: int, energy: EnergyAccount, seconds: Mapping[str, float]) -> str:
    """What a frame's file carries for statistics of a sequence that is rendered in several runs, as JSON."""
    return json.dumps({"photons": photons, "energy": energy.as_dict(), "seconds": dict(seconds)})


def _has_its_end(path: str) -> bool:
    """Whether a file ends as its format does, where its reader is content without."""
    ending = _ENDINGS.get(os.path.splitext(path)[1].lower(), b"")
    with open(path, "rb") as file:
        file.seek(-len(ending), os.SEEK_END)
        return file.read() == ending


def kept_frame(metadata: Mapping[str, Any]) -> KeptFrame:
    """What a file's attributes say of its rendering; nothing where they are not those of this program."""
    try:
        found = json.loads(metadata[STATISTICS])
        return KeptFrame(int(found["photons"]), EnergyAccount(**found["energy"]), dict(found["seconds"]))
    except (KeyError, TypeError, ValueError):
        return KeptFrame()
