"""Keeping a long sequence's pictures on disk, so that memory does not grow with its length."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Mapping

from tpdwarp.errors import FrameError

_Place = tuple[int, int]


class PictureStore:
    """A temporary file that pictures are moved to; it is gone with the last mapping that reads from it."""

    def __init__(self) -> None:
        # Closed, and with that deleted, with the last mapping that refers to it; no block could span that.
        self._file = tempfile.TemporaryFile(prefix="tpdwarp-check-")  # noqa: SIM115

    def keep(self, pictures: Mapping[str, bytes]) -> Mapping[str, bytes]:
        """The same pictures, read from the file each time they are asked for.

        Raises:
            FrameError: There is no room for them.
        """
        places: dict[str, _Place] = {}
        try:
            end = self._file.seek(0, os.SEEK_END)
            for name, data in pictures.items():
                places[name] = (end, len(data))
                end += self._file.write(data)
            self._file.flush()
        except OSError as error:
            message = f"{tempfile.gettempdir()}: the report's pictures find no room: {error.strerror}"
            raise FrameError(message) from error
        return StoredPictures(self, places)

    def read(self, place: _Place) -> bytes:
        self._file.seek(place[0])
        return self._file.read(place[1])


class StoredPictures(Mapping[str, bytes]):
    """Pictures in a store, by name."""

    def __init__(self, store: PictureStore, places: Mapping[str, _Place]) -> None:
        self._store, self._places = store, places

    def __getitem__(self, name: str) -> bytes:
        return self._store.read(self._places[name])

    def __contains__(self, name: object) -> bool:
        return name in self._places

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)
