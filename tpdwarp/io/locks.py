"""Locks between processes, held on files and freed by the system when their holder ends."""

from __future__ import annotations

import contextlib
import errno
import os

from tpdwarp.stopping import work_begins

try:
    import fcntl
except ImportError:  # Elsewhere than on POSIX systems
    fcntl = None  # type: ignore[assignment]

_HELD = (errno.EAGAIN, errno.EACCES, errno.EWOULDBLOCK)


class FileLock:
    """A lock on a file of its own, which exists only while somebody holds it, or after a holder was killed.

    Args:
        path: The file.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = os.fspath(path)
        self._descriptor: int | None = None

    def acquire(self) -> bool:
        """Takes the lock; False where another process, or another lock of this one, holds it.

        True where the file system has no locks or the file cannot be made: who cannot lock must not wait.
        """
        if fcntl is None:
            return True
        work_begins()
        try:
            while True:
                held = self._tried()
                if held is not None:
                    return held
        except BaseException:
            # A signal, after the file was made perhaps: what nobody holds does not stay behind.
            self._abandon()
            raise

    def release(self) -> None:
        """Frees the lock and removes its file; does nothing where it is not held.

        It may be called again where a signal has cut it short.
        """
        if self._descriptor is not None:
            with contextlib.suppress(OSError):
                if self._is_at_its_path():
                    os.unlink(self.path)
            self._close()

    def _tried(self) -> bool | None:
        """Whether it could be taken; None where it is to be tried again."""
        # Kept before anything else can happen to it.
        try:
            self._descriptor = os.open(self.path, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW, 0o666)
        except OSError:
            return True
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno not in _HELD:
                self.release()
                return True
            self._close()
            return False
        # Between opening and locking, its holder may have removed the file, and another made a new one.
        if self._is_at_its_path():
            return True
        self._close()
        return None

    def _abandon(self) -> None:
        """Removes the file if nobody holds it."""
        with contextlib.suppress(OSError):
            if self._descriptor is None:
                self._descriptor = os.open(self.path, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW)
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self.release()
        self._close()

    def _close(self) -> None:
        if self._descriptor is not None:
            with contextlib.suppress(OSError):
                os.close(self._descriptor)
            self._descriptor = None

    def _is_at_its_path(self) -> bool:
        try:
            return os.path.samestat(os.fstat(self._descriptor), os.lstat(self.path))
        except OSError:
            return False
