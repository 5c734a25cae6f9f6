"""Warp's cache of compiled kernels: shared by processes, mended where it is damaged, replaced where it cannot be used.

Objects are machine code that is run as it is, and a truncated one ends the process or, worse, does not. Beside each
compiled module lie the hashes of its files; a module that differs from them is compiled anew.
"""

from __future__ import annotations

import atexit
import contextlib
import glob
import os
import re
import shutil
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from typing import Any

import warp as wp

from tpdwarp.compiler_lock import Compilers, lock_of
from tpdwarp.errors import logger, shortened
from tpdwarp.io.digests import has_its_digests, note_digests
from tpdwarp.io.files import host_name, is_running

# The kernels of all methods took 8 MB, a precompiled header 5 MB; LLVM ends the process when a disk is full.
ROOM_BYTES = 64 << 20

_BUILD = re.compile(r"(wp_.+)_p([0-9]+)_t[0-9]+")


class NowhereToCompileError(OSError):
    """No folder takes compiled kernels, the user's own one in the temporary folder included."""


class KernelCache:
    """The cache that this process uses; one a process, as Warp has one."""

    def __init__(self) -> None:
        self._compilers = Compilers()
        self._swept: set[str] = set()
        self._roomy: set[str] = set()

    def start_warp(self, quietly: Callable[[], AbstractContextManager[None]]) -> None:
        """Starts Warp; with a cache in the temporary folder where its own cannot be made.

        Args:
            quietly: Makes what is entered while Warp starts, to keep it from printing.
        """
        try:
            with quietly():
                wp.init()
        except OSError as error:
            self._fall_back(str(error.filename or "the kernel cache"), error.strerror or str(error), started=False)
            with quietly():
                wp.init()
        folder = wp.config.kernel_cache_dir
        if folder not in self._swept:
            self._swept.add(folder)
            self._sweep(folder)

    def load(self, module: wp.Module, device: Any, block_dim: int) -> None:
        """Loads a module of kernels, compiled by this process or another.

        Raises:
            Exception: It cannot be compiled anywhere.
        """
        loaded = module.execs.get((device.context, block_dim))
        if loaded is not None and loaded.module_hash == module.get_module_hash(block_dim):
            return
        folder = self._folder(module, block_dim)
        if os.path.isdir(folder) and not has_its_digests(folder):
            self._discard(folder, "is damaged")
        was_cached = os.path.isdir(folder)
        try:
            self._load(module, device, block_dim)
        except NowhereToCompileError:
            raise
        except Exception as error:
            said = shortened(str(error))
            logger.debug("kernel cache", exc_info=error)
            if was_cached:
                self._discard(folder, f"cannot be loaded ({said})")
            elif isinstance(error, OSError):
                self._fall_back(wp.config.kernel_cache_dir, error.strerror or said)
            else:
                raise
            # What failed once is remembered, and not tried again.
            module.mark_modified()
            self._load(module, device, block_dim)

    def _load(self, module: wp.Module, device: Any, block_dim: int) -> None:
        if not os.path.isdir(self._folder(module, block_dim)):
            self._require_room()
        folder = self._folder(module, block_dim)
        with self._compilers.compiled_once(folder):
            if os.path.isdir(folder):
                module.load(device, block_dim)
                return
            try:
                with _own_headers():
                    module.load(device, block_dim)
            except BaseException:
                for left in glob.glob(f"{glob.escape(folder)}_p{os.getpid()}_t*"):
                    shutil.rmtree(left, ignore_errors=True)
                raise
            note_digests(folder)

    def _require_room(self) -> None:
        """Leaves a cache into which kernels cannot be compiled; looked at once, with room for all of them."""
        folder = wp.config.kernel_cache_dir
        if folder not in self._roomy:
            reason = _no_room(folder)
            if reason:
                self._fall_back(folder, reason)
                self._require_room()
            else:
                self._roomy.add(folder)

    def _folder(self, module: wp.Module, block_dim: int) -> str:
        return os.path.join(wp.config.kernel_cache_dir, module.get_module_identifier(block_dim))

    def _discard(self, folder: str, what: str) -> None:
        """Removes what is damaged, or leaves the cache where that cannot be done."""
        shutil.rmtree(folder, ignore_errors=True)
        if os.path.isdir(folder):
            self._fall_back(wp.config.kernel_cache_dir, f"{os.path.basename(folder)} {what}")
        else:
            logger.warning(f"{folder}: {what} and is compiled anew")

    def _fall_back(self, folder: str, reason: str, started: bool = True) -> None:
        own = own_folder()
        if started and os.path.dirname(wp.config.kernel_cache_dir) == own:
            raise NowhereToCompileError(f"kernels cannot be compiled: {folder}: {reason} (set WARP_CACHE_PATH)")
        logger.warning(f"{folder}: cannot keep compiled kernels ({reason}); they are kept in {own}")
        wp.config.kernel_cache_dir = own
        if started:
            # Gives the version of Warp a folder of its own, as its start does.
            wp.config.kernel_cache_dir = os.path.join(own, wp.config.version)
            os.makedirs(wp.config.kernel_cache_dir, exist_ok=True)

    def _sweep(self, folder: str) -> None:
        """Removes what processes that were killed while compiling have left behind."""
        with contextlib.suppress(OSError), os.scandir(folder) as entries:
            for entry in entries:
                found = _BUILD.fullmatch(entry.name)
                if found and not is_running(int(found[2])):
                    # Who compiles on another host sharing the cache holds it: processes there cannot be looked for.
                    lock = lock_of(os.path.join(folder, found[1]))
                    if lock.acquire():
                        shutil.rmtree(entry.path, ignore_errors=True)
                        lock.release()
        for left in glob.glob(os.path.join(glob.escape(tempfile.gettempdir()), f"tpdwarp-headers-{host_name()}-*")):
            number = left.rsplit("-", 1)[-1]
            if number.isdigit() and not is_running(int(number)):
                shutil.rmtree(left, ignore_errors=True)


def own_folder() -> str:
    """A folder of this user's alone in the temporary folder, for kernels.

    Kernels are code that is run: a folder that somebody else could have made or may write to is not taken.
    """
    folder = os.path.join(tempfile.gettempdir(), f"tpdwarp-kernels-{os.getuid()}")
    with contextlib.suppress(OSError):
        os.mkdir(folder, 0o700)
    with contextlib.suppress(OSError):
        status = os.lstat(folder)
        if stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid() and not status.st_mode & 0o022:
            return folder
    folder = tempfile.mkdtemp(prefix="tpdwarp-kernels-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def _no_room(folder: str) -> str:
    """Why kernels cannot be compiled into ``folder``; empty where they can."""
    try:
        os.makedirs(folder, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as probe:
            os.posix_fallocate(probe.fileno(), 0, ROOM_BYTES)
    except OSError as error:
        return error.strerror or str(error)
    return ""


@contextlib.contextmanager
def _own_headers() -> Iterator[None]:
    """Has Warp make its precompiled headers in a folder that says whose they are, so that they can be swept."""
    before = tempfile.tempdir
    folder = os.path.join(tempfile.gettempdir(), f"tpdwarp-headers-{host_name()}-{os.getpid()}")
    made = not os.path.isdir(folder)
    try:
        os.makedirs(folder, mode=0o700, exist_ok=True)
        tempfile.tempdir = folder
    except OSError:
        made = False
    if made:
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
    try:
        yield
    finally:
        tempfile.tempdir = before
