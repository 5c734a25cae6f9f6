"""What a frame's pixels depend on, in a form that its file carries."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from tpdwarp.io.frame_names import frame_text
from tpdwarp.io.images import FINGERPRINT
from tpdwarp.jobs.holdouts import Holdouts
from tpdwarp.settings import Settings
from tpdwarp.version import VERSION

# Neither the number of threads nor the kind of device is meant to change a pixel (beyond rounding).
_MACHINE = ("threads", "device")
_DIGITS = 32


@dataclass(frozen=True)
class Fingerprint:
    """What all frames of a sequence depend on.

    Attributes:
        settings: The settings as JSON values.
        stage: Hash of what the stage's layers and textures hold.
        holdouts: The images that hide parts of the frames; None for none.
    """

    settings: Mapping[str, Any]
    stage: str
    holdouts: Holdouts | None = None

    @classmethod
    def of(cls, settings: Settings, stage: str) -> Fingerprint:
        """The fingerprint of frames rendered with ``settings`` of a stage whose content has the hash ``stage``."""
        holdouts = Holdouts(settings.holdout) if settings.holdout else None
        return cls(plain_settings(settings.as_dict()), stage, holdouts)

    def text(self, frame: float) -> str:
        """What a frame's file carries: ``frame=12 program=0.1.0 settings=… stage=…``."""
        return " ".join(f"{name}={value}" for name, value in self._parts(frame).items())

    def difference(self, frame: float, metadata: Mapping[str, Any]) -> str:
        """Why a file is not the one that would be rendered now; empty where it is.

        Args:
            frame: Which frame is wanted.
            metadata: What its file says of itself.
        """
        text = found_in(metadata)
        if text is None:
            return "without a fingerprint"
        found = dict(part.partition("=")[::2] for part in text.split())
        wanted = self._parts(frame)
        differing = [name for name, value in wanted.items() if found.get(name) != value]
        if not differing:
            return ""
        name = differing[0]
        if name == "settings":
            return f"of other settings{self._changes(metadata)}"
        if name in ("frame", "program"):
            return f"of another {name} ({found.get(name)}, now {wanted[name]})"
        return f"of another {name}"

    def _parts(self, frame: float) -> dict[str, str]:
        settings = json.dumps(self.settings, sort_keys=True)
        held = {} if self.holdouts is None else {"holdout": self.holdouts.digest(frame)[:_DIGITS]}
        return {
            "program": VERSION,
            "stage": self.stage[:_DIGITS],
            "settings": hashlib.sha256(settings.encode()).hexdigest()[:_DIGITS],
            "frame": frame_text(frame) if math.isnan(frame) else repr(float(frame)),
            **held,
        }

    def _changes(self, metadata: Mapping[str, Any]) -> str:
        """``(photons 64, now 128)`` where the file holds its settings."""
        try:
            before = plain_settings(json.loads(metadata["tpdwarp:settings"]))
        except (KeyError, TypeError, ValueError, AttributeError):
            return ""
        changed = [
            f"{name} {_word(before.get(name))}, now {_word(value)}"
            for name, value in self.settings.items()
            if before.get(name) != value
        ]
        return f" ({'; '.join(changed)})" if changed else ""


def plain_settings(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Those of ``settings`` that pixels depend on, as JSON gives them back."""
    return json.loads(json.dumps({name: value for name, value in settings.items() if name not in _MACHINE}))


def found_in(metadata: Mapping[str, Any]) -> str | None:
    """The fingerprint that an image's attributes hold; None where they hold none.

    JPEG and TIFF have no attributes of one's own; theirs stands in the image's description.
    """
    text = metadata.get(FINGERPRINT)
    if text is None:
        name, _, text = str(metadata.get("ImageDescription", "")).partition(" ")
        if name != FINGERPRINT:
            return None
    return str(text)


def _word(value: Any) -> str:
    return "none" if value is None else ",".join(map(str, value)) if isinstance(value, list) else str(value)
