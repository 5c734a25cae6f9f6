"""Limits of a check: how far frames may be from their baseline, in a small TOML file beside it."""

from __future__ import annotations

import math
import os
import sys
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from tpdwarp.errors import InputError, shortened
from tpdwarp.io.files import check_writable, complete_or_absent

LIMITS_FILE = "tpdwarp-check.toml"
SEVERITIES = ("fail", "warn", "ignore")


@dataclass(frozen=True)
class GroupLimits:
    """Limits of one channel group (the beauty or an AOV); infinity turns a limit off.

    The defaults are for the same program with the same settings on another machine: half floats round by up to
    5e-4 of a value, and compilers order sums differently, so that now and then a camera ray falls on the other side of
    an edge. Other seeds need calibrated limits.

    Attributes:
        fail_absolute, fail_relative: A pixel fails where a channel differs by more than both; relative to the mean of
            the two values.
        fail_percent: The most pixels that may fail, in percent.
        warn_absolute, warn_relative, warn_percent: The same for warnings.
        hard: Largest difference allowed anywhere, as a part of the baseline's largest value.
        rmse: Root of the mean squared difference, as a part of the baseline's root of the mean square.
        coarse: The same of images shrunk by 8: noise averages out, and what is left is shape.
        flip_mean, flip_high: Mean of FLIP, and its percentile; the beauty only, unless they are given for others.
        energy: Difference of the sum over the image, as a part of the baseline's sum; colours only.
        flicker: Change of the difference from frame to frame, as a part of the baseline's root of the mean square.
    """

    fail_absolute: float = 2e-3
    fail_relative: float = 1e-2
    fail_percent: float = 0.2
    warn_absolute: float = 1e-3
    warn_relative: float = 2e-3
    warn_percent: float = 0.5
    hard: float = 0.5
    rmse: float = 3e-3
    coarse: float = 2e-3
    flip_mean: float = math.inf
    flip_high: float = math.inf
    energy: float = 1e-3
    flicker: float = 3e-3


@dataclass(frozen=True)
class FlipLimits:
    """How FLIP is measured: its exposures are fixed here, so that values mean the same in every frame.

    Attributes:
        maximum_luminance, median_luminance: What the exposures are laid out over.
        percentile: The percentile meant by ``flip_high``.
        width: Wider images are shrunk to this many pixels first, by whole factors, for FLIP takes seconds a megapixel.
            Single pixels are a matter for the other measures, which see all of them.
    """

    maximum_luminance: float = 2.0
    median_luminance: float = 0.18
    percentile: float = 99.0
    width: int = 640


@dataclass(frozen=True)
class SequenceLimits:
    """What is said of files and channels that do not pair up: ``fail``, ``warn`` or ``ignore``."""

    missing_frames: str = "fail"
    extra_frames: str = "fail"
    duplicate_frames: str = "fail"
    missing_channels: str = "fail"
    extra_channels: str = "warn"
    pixel_types: str = "fail"


@dataclass(frozen=True)
class MetadataLimits:
    """Which attributes must agree. Names may hold ``*``.

    Attributes:
        fail, warn: Attributes whose difference fails or warns.
        ignored_settings: Settings within ``tpdwarp:settings`` that may differ in silence.
        warned_settings: Settings whose difference warns.
        relative: Numbers may differ by this part.
    """

    fail: tuple[str, ...] = (
        "tpdwarp:settings",
        "tpdwarp:frame",
        "tpdwarp:camera",
        "tpdwarp:shutter*",
        "expTime",
        "framesPerSecond",
        "worldToCamera",
        "worldToNDC",
    )
    warn: tuple[str, ...] = ("tpdwarp:version", "tpdwarp:seed")
    ignored_settings: tuple[str, ...] = ("threads", "device")
    warned_settings: tuple[str, ...] = ("seed",)
    relative: float = 1e-5


@dataclass(frozen=True)
class PhotonLimits:
    """Limits of debug layers. Lengths are parts of the baseline's median footprint (√|D_u x × D_v x|) in that frame.

    Attributes:
        position, dxdu, dxdv, dxdt: Largest length of a photon's difference. Derivatives may differ by this part of
            their own length as well, where they are longer than a footprint.
        flux: Largest difference of a photon's flux, as a part of the baseline's median flux or of its own.
        percent: The most photons that may be beyond these limits, or be there in one layer only, in percent.
        total_flux: Difference of the summed flux, as a part of the baseline's.
    """

    position: float = 0.05
    dxdu: float = 0.05
    dxdv: float = 0.05
    dxdt: float = 0.05
    flux: float = 0.01
    percent: float = 0.2
    total_flux: float = 1e-3


# What people who open a limits file want to know.
_NOTES = {
    "all": """\
Every channel group: the beauty, its alpha and each AOV. inf turns a limit off.
A pixel fails where a channel differs by more than fail_absolute and by more than fail_relative of its value;
fail_percent of the pixels may. The same for warnings. Parts of the baseline: hard is one pixel's largest difference,
of the largest value; rmse, coarse (of the image shrunk by 8) and flicker (from frame to frame), of the root mean
square; energy, of the sum. flip_mean and flip_high are FLIP's mean and percentile.""",
    "flip": "How FLIP is measured: over fixed exposures, on images at most so many pixels wide.",
    "photons": "Debug layers: parts of a footprint's size or of the flux, and how many percent of photons may be off.",
    "sequence": 'What does not pair up: "fail", "warn" or "ignore".',
    "metadata": "Attributes that must agree; names may hold *.",
}

# Numbers that 0 or infinity would make meaningless: the least, the largest, and these in words. No image is wider than
# OpenEXR's windows, whose bounds are 32-bit integers.
_POSITIVE = (sys.float_info.min, sys.float_info.max, "a number above 0")
_RANGES = {
    ("flip", "width"): (1, 2**31 - 1, "a whole number above 0"),
    ("flip", "percentile"): (0, 100, "a number from 0 to 100"),
    ("flip", "maximum_luminance"): _POSITIVE,
    ("flip", "median_luminance"): _POSITIVE,
}

BEAUTY = "beauty"
# FLIP grows with the 0.7th power of small differences: rounding to half alone gives 0.003.
_BEAUTY_DEFAULTS = {"flip_mean": 6e-3, "flip_high": 0.03}
# The last bit decides whether a footprint's rim reaches a pixel, and a row of footprints has a rim in common: a count
# may be a few off, and where next to no light falls, the mean of D_t x is those footprints' or none.
_GROUP_DEFAULTS = {
    BEAUTY: _BEAUTY_DEFAULTS,
    "photons": {"fail_absolute": 3.0, "warn_absolute": 3.0, "rmse": 0.05, "coarse": 0.01},
    "motion": {"hard": 2.0, "rmse": 0.05, "coarse": 0.02},
}


@dataclass(frozen=True)
class Limits:
    """All limits of a check.

    Attributes:
        all: Of every channel group.
        groups: What differs from ``all`` in single groups, by name.
        flip, sequence, metadata, photons: The others.
        calibration: How the limits were found, for people to read; empty where by hand.
    """

    all: GroupLimits = GroupLimits()
    groups: Mapping[str, Mapping[str, float]] = field(default_factory=lambda: {**_GROUP_DEFAULTS})
    flip: FlipLimits = FlipLimits()
    sequence: SequenceLimits = SequenceLimits()
    metadata: MetadataLimits = MetadataLimits()
    photons: PhotonLimits = PhotonLimits()
    calibration: Mapping[str, Any] = field(default_factory=dict)

    def of(self, group: str) -> GroupLimits:
        """The limits of a channel group; a group of lights, ``caustic_NAME``, has those of ``caustic`` and its own."""
        of_all_lights = self.groups.get(group.partition("_")[0], {})
        return replace(self.all, **{**of_all_lights, **self.groups.get(group, {})})


def read_limits(path: str | os.PathLike[str]) -> Limits:
    """Reads limits; what a file leaves out keeps its default.

    Raises:
        InputError: The file cannot be read, or holds what is no limit.
    """
    file = os.fspath(path)
    try:
        with open(path, "rb") as stream:
            tables = tomllib.load(stream)
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=file) from error
    except RecursionError as error:
        raise InputError("is nested too deeply for limits", file=file) from error
    except ValueError as error:
        # Beside what is no TOML: what is no UTF-8, and numbers of thousands of digits.
        raise InputError(f"is no TOML: {shortened(str(error))}", file=file) from error
    kinds = {"all": GroupLimits, "flip": FlipLimits, "sequence": SequenceLimits}
    kinds |= {"metadata": MetadataLimits, "photons": PhotonLimits}
    for name, table in tables.items():
        if not isinstance(table, dict):
            raise InputError(f"{name!r} stands outside a table (put it under [all] or another)", file=file)
        if name not in (*kinds, "groups", "calibration"):
            raise InputError(f"knows no table [{name}]; there are {', '.join(kinds)}, groups.NAME", file=file)
    groups: dict[str, dict[str, float]] = {name: dict(table) for name, table in _GROUP_DEFAULTS.items()}
    for name, table in tables.get("groups", {}).items():
        if not isinstance(table, dict):
            raise InputError(f"[groups] holds tables, as in [groups.{name}]", file=file)
        checked = _table(GroupLimits, table, f"groups.{name}", file)
        groups.setdefault(name, {}).update({key: getattr(checked, key) for key in table})
    for name, value in tables.get("calibration", {}).items():
        if not isinstance(value, str) and not _is_number(value):
            raise InputError(f"[calibration] {name} must be text or a number, not {_shown(value)}", file=file)
    read = {name: _table(kind, tables.get(name, {}), name, file) for name, kind in kinds.items()}
    return Limits(groups=groups, calibration=tables.get("calibration", {}), **read)


def limits_beside(baseline: str | os.PathLike[str]) -> Path:
    """The limits file that belongs to a baseline."""
    path = Path(baseline)
    return (path if path.is_dir() or not path.suffix else path.parent) / LIMITS_FILE


def write_default_limits(baseline: str | os.PathLike[str], path: str | os.PathLike[str] | None = None) -> Path:
    """Writes the default limits, for people to change.

    Args:
        baseline: A folder, an image, a debug layer, or a name with ``####``.
        path: The file; None for ``tpdwarp-check.toml`` beside the baseline.

    Returns:
        The file.

    Raises:
        InputError: There is no such baseline, or the file is there already.
        FrameError: The file cannot be written.
    """
    target = limits_beside(baseline) if path is None else Path(path)
    if not (Path(baseline).exists() or ("#" in Path(baseline).name and Path(baseline).parent.is_dir())):
        raise InputError("does not exist (make the baseline first, for instance with --update)", file=str(baseline))
    check_writable(target)
    if target.exists():
        raise InputError("is there already (change it, remove it, or name another with --limits)", file=str(target))
    write_limits(target, Limits(), "Limits of tpdwarp check: its defaults. What is left out keeps its default.")
    return target


def write_limits(path: str | os.PathLike[str], limits: Limits, comment: str = "") -> None:
    """Writes limits, all of them, so that the file is its own list of what can be changed.

    Args:
        path: The file.
        limits: What to write.
        comment: Lines for the head of the file.

    Raises:
        FrameError: The file cannot be written.
    """
    lines = [f"# {line}".rstrip() for line in comment.splitlines()] + [""] * bool(comment)
    tables: dict[str, Mapping[str, Any]] = {"calibration": limits.calibration} if limits.calibration else {}
    tables["all"] = vars(limits.all)
    tables |= {f"groups.{_key(name)}": table for name, table in limits.groups.items()}
    for name in ("flip", "photons", "sequence", "metadata"):
        tables[name] = vars(getattr(limits, name))
    for name, table in tables.items():
        lines += [f"# {line}" for line in _NOTES.get(name, "").splitlines()]
        lines += [f"[{name}]", *(f"{key} = {_toml(value)}" for key, value in table.items()), ""]
    with complete_or_absent(path) as temporary:
        Path(temporary).write_text("\n".join(lines), encoding="utf-8")


def _table(kind: type, table: Mapping[str, Any], name: str, file: str) -> Any:
    known = {entry.name: entry.default for entry in fields(kind)}
    values: dict[str, Any] = {}
    for key, value in table.items():
        if key not in known:
            raise InputError(f"[{name}] knows no {key!r}; there are {', '.join(known)}", file=file)
        default = known[key]
        if isinstance(default, str):
            usable, wanted = value in SEVERITIES, f"one of {', '.join(SEVERITIES)}"
        elif isinstance(default, tuple):
            usable = isinstance(value, list) and all(isinstance(entry, str) for entry in value)
            wanted = "a list of names"
        else:
            low, high, wanted = _RANGES.get((name, key), (0, math.inf, "a number, 0 or more"))
            usable = _is_number(value) and low <= value <= high
        if not usable:
            raise InputError(f"[{name}] {key} must be {wanted}, not {_shown(value)}", file=file)
        values[key] = tuple(value) if isinstance(default, tuple) else type(default)(value)
    return kind(**values)


def _is_number(value: Any) -> bool:
    """Whether a value is a number, and one that fits a float."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return False
    try:
        float(value)
    except OverflowError:
        return False
    return True


def _shown(value: Any) -> str:
    """A value for a message, short and in one line."""
    try:
        return shortened(repr(value))
    except (ValueError, RecursionError):
        # Integers of thousands of digits have no text in Python.
        return "that"


def _toml(value: Any) -> str:
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
        return f'"{escaped}"'
    if isinstance(value, tuple | list):
        entries = [_toml(entry) for entry in value]
        line = f"[{', '.join(entries)}]"
        return line if len(line) <= 80 else "[\n" + "".join(f"    {entry},\n" for entry in entries) + "]"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _key(name: str) -> str:
    return name if name.replace("_", "").replace("-", "").isalnum() and name.isascii() else _toml(name)
