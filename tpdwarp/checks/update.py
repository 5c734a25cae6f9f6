"""Replacing a baseline: in one step, with a record of who asked, when and why."""

from __future__ import annotations

import contextlib
import getpass
import json
import os
import secrets
import shutil
import socket
import time
from pathlib import Path
from typing import Any

from tpdwarp.checks.findings import CheckResult
from tpdwarp.errors import InputError
from tpdwarp.io.files import complete_or_absent
from tpdwarp.version import VERSION

RECORD_FILE = "tpdwarp-check.history.jsonl"
_UNFIT = ("not finite", "unreadable", "duplicate frame", "repeated ids")


def check_reason(reason: str) -> None:
    """Makes sure that an update says why.

    Raises:
        InputError: It does not.
    """
    if not reason.strip():
        raise InputError("--update needs --reason (a line for the baseline's record)")


def update_baseline(result: CheckResult, reason: str) -> bool:
    """Makes the frames that were checked the baseline, where anything differs.

    A folder is replaced as a whole: a complete new one is made beside it, files that are no frames taken along, and
    takes its name. Frames that the new sequence does not have are gone from the new baseline. A line is added to
    ``tpdwarp-check.history.jsonl`` in the baseline's folder.

    Args:
        result: What a check found.
        reason: Why, for the record.

    Returns:
        Whether anything was replaced.

    Raises:
        InputError: No reason is given, a new frame is no fit baseline (unreadable, not finite, or there twice), or the
            baseline cannot be replaced.
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


def _replace_folder(baseline: Path, result: CheckResult, entry: dict[str, Any]) -> None:
    baseline = Path(os.path.realpath(baseline))
    token = secrets.token_hex(4)
    new, old = (baseline.with_name(f".{baseline.name}.{token}.{role}") for role in ("new", "old"))
    replaced = {Path(os.path.realpath(frame.baseline)) for frame in result.frames if frame.baseline}
    try:
        new.mkdir(parents=True)
        for kept in baseline.rglob("*") if baseline.is_dir() else ():
            if kept.is_file() and Path(os.path.realpath(kept)) not in replaced:
                target = new / kept.relative_to(baseline)
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(kept, target)
        for frame in {frame.path: frame for frame in result.frames if frame.path}.values():
            # A frame keeps the name it had in the baseline, so that version control sees a change and not a new file.
            name = Path(frame.baseline).name if _same_kind(frame.path, frame.baseline) else Path(frame.path).name
            shutil.copyfile(frame.path, new / name)
        _append(new / RECORD_FILE, entry)
        if baseline.exists():
            os.rename(baseline, old)
        try:
            os.rename(new, baseline)
        except OSError:
            if old.exists():
                os.rename(old, baseline)
            raise
        shutil.rmtree(old, ignore_errors=True)
    finally:
        shutil.rmtree(new, ignore_errors=True)


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
