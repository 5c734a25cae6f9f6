"""Photons of the frames that are done, kept beside a debug layer until all its frames are: whatever ends a render, what
it traced need not be traced again."""

from __future__ import annotations

import contextlib
import os
import shutil
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from tpdwarp.io.files import complete_or_absent, sweep_temporaries
from tpdwarp.io.frame_names import frame_text
from tpdwarp.jobs.existing_frames import STATISTICS, KeptFrame, kept_frame
from tpdwarp.jobs.fingerprint import Fingerprint
from tpdwarp.photons.paths import PhotonPaths
from tpdwarp.photons.record import PhotonRecord
from tpdwarp.photons.thinning import thinned_alone

_FINGERPRINT = "fingerprint"
# What the names of columns of paths begin with.
_PATH = "path_"
_COLUMNS = tuple(field.name for field in fields(PhotonRecord))
_TEXTS = ("receiver_paths", "light_paths")
# What reading an archive that is cut, of another program or not an archive at all may raise.
_DAMAGED = (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile, MemoryError)


@dataclass(frozen=True, eq=False)
class KeptPhotons:
    """The photons of a frame, and paths of some of them where these were kept."""

    photons: PhotonRecord
    paths: PhotonPaths | None


class PhotonParts:
    """One NumPy archive a frame in the folder ``shot.debug.usdc.parts`` beside ``shot.debug.usdc``.

    An archive counts only where it says that it was made from the same stage with the same settings by the same version
    of the program. The same frames make the same layer whichever of them were traced by whom, for the photons are those
    traced, in double precision.

    Args:
        layer: The debug layer.
        fingerprint: What the sequence is made from.
        curves: At most so many photons a frame will be in the layer; others need not be kept.

    Attributes:
        folder: Where the archives lie.
    """

    def __init__(self, layer: str | os.PathLike[str], fingerprint: Fingerprint, curves: int | None) -> None:
        self.folder = Path(f"{os.fspath(layer)}.parts")
        self._fingerprint, self._curves = fingerprint, curves

    def store(self, frame: float, photons: PhotonRecord, statistics: str, paths: PhotonPaths | None = None) -> None:
        """Keeps the photons of a frame.

        Args:
            frame: Which frame.
            photons: Its photons.
            statistics: What :func:`tpdwarp.jobs.existing_frames.statistics_text` says of it.
            paths: Paths of some of them.

        Raises:
            FrameError: They cannot be written.
            OSError: Likewise.
        """
        kept = thinned_alone(photons, self._curves)
        columns = {name: np.asarray(getattr(kept, name)) for name in _COLUMNS}
        if paths is not None:
            columns |= {f"{_PATH}{name}": np.asarray(getattr(paths.photons, name)) for name in _COLUMNS}
            columns |= {f"{_PATH}counts": paths.counts, f"{_PATH}points": paths.points}
        self.folder.mkdir(exist_ok=True)
        with complete_or_absent(self.path(frame)) as temporary, open(temporary, "wb") as file:
            np.savez(file, **columns, **{_FINGERPRINT: self._text(frame), "statistics": statistics})

    def load(self, frame: float) -> KeptPhotons | None:
        """The photons of a frame; None where they are not there, damaged, or not those of this sequence."""
        with contextlib.suppress(*_DAMAGED), np.load(self.path(frame), allow_pickle=False) as archive:
            if str(archive[_FINGERPRINT]) == self._text(frame):
                paths = None
                if f"{_PATH}counts" in archive:
                    counts, points = archive[f"{_PATH}counts"], archive[f"{_PATH}points"]
                    paths = PhotonPaths(_record(archive, _PATH), counts, points)
                return KeptPhotons(_record(archive, ""), paths)
        return None

    def kept(self, frame: float) -> KeptFrame | None:
        """What is known of a frame whose photons :meth:`load` would give; None where it would give none."""
        if self.load(frame) is None:
            return None
        return kept_frame({STATISTICS: self.texts([frame]).get(frame_text(frame))})

    def texts(self, frames: Sequence[float]) -> dict[str, str]:
        """The statistics that were stored with ``frames``, by the text of the frame."""
        found = {}
        for frame in frames:
            with contextlib.suppress(*_DAMAGED), np.load(self.path(frame), allow_pickle=False) as archive:
                found[frame_text(frame)] = str(archive["statistics"])
        return found

    def remove(self) -> None:
        """Removes all archives: the layer is complete."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def sweep(self) -> None:
        """Removes what killed renders have left half written."""
        sweep_temporaries(self.folder)

    def path(self, frame: float) -> Path:
        """The archive of a frame."""
        return self.folder / f"{frame_text(frame)}.npz"

    def _text(self, frame: float) -> str:
        return f"{self._fingerprint.text(frame)} curves={self._curves}"


def _record(archive: Mapping[str, np.ndarray], prefix: str) -> PhotonRecord:
    columns = {name: archive[f"{prefix}{name}"] for name in _COLUMNS}
    texts = {name: tuple(map(str, columns.pop(name).tolist())) for name in _TEXTS}
    return PhotonRecord(**columns, **texts)
