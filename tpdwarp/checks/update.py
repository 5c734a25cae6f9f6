"""Replacing a baseline: in one step, with a record of who asked, when and why."""

from __future__ import annotations

import contextlib
import fcntl
import getpass
import json
import os
import re
import secrets
import shutil
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tpdwarp.checks.findings import CheckResult, FrameComparison
from tpdwarp.errors import InputError, logger
from tpdwarp.io.files import complete_or_absent
from tpdwarp.version import VERSION

FilePath = str | os.PathLike[str]

RECORD_FILE = "tpdwarp-check.history.jsonl"
# A line of an error takes no more.
_MOST_NAMED = 6
_UNFIT = ("not finite", "unreadable", "duplicate frame", "repeated ids")


def check_reason(reason: str) -> None:
    """Makes sure that an update says why.

    Raises:
        InputError: It does not.
    """
    if not reason.strip():
        raise InputError("--update needs --reason (a line for the baseline's record)")


def update_baseline(result: CheckResult, reason: str, drop_missing: bool = False) -> bool:
    """Makes the frames that were checked the baseline, where anything differs.

    A folder is replaced as a whole: a complete new one is made beside it, files that are no frames taken along, and
    takes its name. A line is added to ``tpdwarp-check.history.jsonl`` in the baseline's folder.

    Args:
        result: What a check found.
        reason: Why, for the record.
        drop_missing: Whether frames of the baseline that the new sequence lacks may be gone from the new baseline.

    Returns:
        Whether anything was replaced.

    Raises:
        InputError: No reason is given, a new frame is no fit baseline (unreadable, not finite, or there twice), frames
            are missing and may not be, or the baseline cannot be replaced.
    """
    check_reason(reason)
    changed = [frame for frame in result.frames if frame.findings or not frame.identical]
    if not changed:
        return False
    for frame in changed:
        for finding in frame.failures:
            if frame.path and finding.kind in _UNFIT and not finding.of_baseline:
                message = f"frame {frame.name} is no fit baseline: {finding} (nothing was replaced)"
                raise InputError(message, file=frame.path)
    missing = [frame.name for frame in result.frames if _is_missing(frame)]
    if missing and not drop_missing:
        listed = ", ".join(missing[:_MOST_NAMED]) + (", …" if len(missing) > _MOST_NAMED else "")
        message = f"lacks {len(missing)} of {len(result.frames)} frames of the baseline: {listed}"
        raise InputError(f"{message} (--drop-missing removes them; nothing was replaced)", file=result.frames_path)
    baseline = Path(result.baseline_path)
    entry = {
        "time": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "who": _who(),
        "reason": " ".join(reason.split()),
        "program": f"tpdwarp {VERSION}",
        "frames_path": result.frames_path,
        "changes": [
            {"frame": frame.name, "findings": [f"{finding.kind}: {finding}" for finding in frame.findings]}
            for frame in changed
        ],
    }
    try:
        if baseline.is_dir() or not (baseline.exists() or baseline.suffix):
            _replace_folder(baseline, result, entry)
        elif len(result.frames) == 1 and "#" not in baseline.name:
            with complete_or_absent(baseline) as temporary:
                shutil.copyfile(result.frames[0].path, temporary)
            _append(baseline.parent / RECORD_FILE, entry)
        else:
            raise InputError("--update replaces a folder or a single image (name one of these)", file=str(baseline))
    except OSError as error:
        raise InputError(f"cannot be replaced: {error.strerror}", file=str(baseline)) from error
    return True


def finish_interrupted_update(baseline: FilePath) -> None:
    """Mends what an update left behind that was killed: the old baseline gets its name back, and copies are removed.

    Folders of an update that is still under way are locked, and left alone.

    Args:
        baseline: The folder's name, whether it is there or not.
    """
    place = Path(os.path.realpath(baseline))
    pattern = re.compile(rf"\.{re.escape(place.name)}\.[0-9a-f]{{8}}\.(new|old)")
    with contextlib.suppress(OSError):
        left = [entry for entry in place.parent.iterdir() if pattern.fullmatch(entry.name)]
        for folder in sorted(left, key=lambda entry: entry.suffix, reverse=True):
            with _locked(folder) as ours:
                if not ours:
                    continue
                if folder.suffix == ".old" and not place.exists():
                    os.rename(folder, place)
                    logger.warning("%s: an update was interrupted; the baseline is the old one again", place)
                else:
                    shutil.rmtree(folder, ignore_errors=True)


def _replace_folder(baseline: Path, result: CheckResult, entry: dict[str, Any]) -> None:
    baseline = Path(os.path.realpath(baseline))
    token = secrets.token_hex(4)
    new, old = (baseline.with_name(f".{baseline.name}.{token}.{role}") for role in ("new", "old"))
    replaced = {Path(os.path.realpath(frame.baseline)) for frame in result.frames if frame.baseline}
    try:
        new.mkdir(parents=True)
        with _locked(new), _locked(baseline):
            for kept in baseline.rglob("*") if baseline.is_dir() else ():
                if kept.is_file() and Path(os.path.realpath(kept)) not in replaced:
                    target = new / kept.relative_to(baseline)
                    target.parent.mkdir(parents=True, exist_ok=True)
                    shutil.copy2(kept, target)
            for frame in {frame.path: frame for frame in result.frames if frame.path}.values():
                # A frame keeps its name in the baseline, so that version control sees a change and not a new file.
                name = Path(frame.baseline if _same_kind(frame.path, frame.baseline) else frame.path).name
                shutil.copyfile(frame.path, new / name)
            _append(new / RECORD_FILE, entry)
            _exchange(baseline, new, old)
    finally:
        # Neither has a use any more, unless the old folder could not get its name back: it is then all there is.
        shutil.rmtree(new, ignore_errors=True)
        if baseline.exists():
            shutil.rmtree(old, ignore_errors=True)


def _exchange(baseline: Path, new: Path, old: Path) -> None:
    """Gives ``new`` the name of ``baseline``, whose folder becomes ``old``; whatever happens, one of them has it."""
    try:
        if baseline.exists():
            os.rename(baseline, old)
        os.rename(new, baseline)
    finally:
        # Signals and errors come between the two as well.
        if not baseline.exists() and old.exists():
            os.rename(old, baseline)


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[bool]:
    """Holds a lock on a folder, which goes with the process; gives whether it was to be had."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        yield False
        return
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        ours = True
    except OSError:
        ours = False
    try:
        yield ours
    finally:
        os.close(handle)


def _is_missing(frame: FrameComparison) -> bool:
    return not frame.path or any(finding.kind == "missing frame" for finding in frame.findings)


def _same_kind(path: str, baseline: str) -> bool:
    return bool(baseline) and Path(path).suffix.lower() == Path(baseline).suffix.lower()


def _append(path: Path, entry: dict[str, Any]) -> None:
    with open(path, "a", encoding="utf-8") as file:
        file.write(json.dumps(entry, ensure_ascii=False) + "\n")


def _who() -> str:
    user = "unknown"
    with contextlib.suppress(OSError, KeyError, ImportError):
        user = getpass.getuser()
    return f"{user}@{socket.gethostname()}"
