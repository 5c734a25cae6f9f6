"""Comparing one frame with its baseline."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tpdwarp.checks.findings import Finding, FrameComparison, GroupMeasures, Severity
from tpdwarp.checks.groups import channel_groups, is_color
from tpdwarp.checks.limits import Limits
from tpdwarp.checks.measures import judge, measure
from tpdwarp.checks.metadata import metadata_findings
from tpdwarp.checks.pictures import group_pictures
from tpdwarp.checks.sequences import Pair
from tpdwarp.errors import InputError, shortened
from tpdwarp.html.pictures import shrunk
from tpdwarp.io.images import StoredImage, decode_srgb, read_stored

# Flicker is a matter of areas, not of single pixels; reduced images of two frames are all that a sequence keeps.
FLICKER_WIDTH = 480


@dataclass(frozen=True, eq=False)
class ComparedFrame:
    """A comparison, and what the next frame's flicker needs of it.

    Attributes:
        comparison: What was found so far.
        reduced: Image and baseline, reduced, by colour group.
    """

    comparison: FrameComparison
    reduced: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)


def compare_frame(pair: Pair, limits: Limits, picture_width: int = 0) -> ComparedFrame:
    """Compares one frame with its baseline. What cannot be read is a finding, not an error.

    Args:
        pair: The files.
        limits: What is allowed.
        picture_width: Width of the pictures for a report; 0 for none.
    """
    started = time.perf_counter()
    path, baseline = (files[0] if files else "" for files in (pair.files, pair.baselines))
    findings = list(_file_findings(pair, limits))
    images = []
    for role, file in (("frame", path), ("baseline", baseline)):
        if not file:
            continue
        if images and same_bytes(path, baseline):
            images *= 2
            continue
        try:
            images.append(read_stored(file))
        except InputError as error:
            message = f"the {role} {error.message} ({Path(file).name})"
            findings.append(Finding("fail", "unreadable", message, of_baseline=role == "baseline"))
    measures: dict[str, GroupMeasures] = {}
    pictures: dict[str, bytes] = {}
    scales: dict[str, float] = {}
    reduced: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    identical = False
    if len(images) == 2:
        image, reference = images
        findings += metadata_findings(image.metadata, reference.metadata, limits.metadata)
        findings += _channel_findings(image, reference, limits)
        findings += _layout_findings(image, reference)
        if image.pixels.shape[:2] == reference.pixels.shape[:2]:
            identical = image is reference or (
                image.names == reference.names and np.array_equal(image.pixels, reference.pixels)
            )
            encoded = Path(path).suffix.lower() != ".exr"
            common = [name for name in reference.names if name in image.names]
            for group, channels in channel_groups(common).items():
                mine = _planes(image, channels)
                theirs = mine if image is reference else _planes(reference, channels)
                findings += _make_finite(group, channels, mine, theirs)
                group_limits, colors = limits.of(group), is_color(channels)
                linear = _linear(mine, theirs) if encoded and colors else None
                measured = measure(mine, theirs, group_limits, limits.flip, colors, linear)
                measures[group] = measured.measures
                beyond = list(judge(group, measured.measures, group_limits, limits.flip.percentile))
                findings += beyond
                shown, shown_baseline = linear or (mine, theirs)
                if colors:
                    small = shrunk(shown_baseline, FLICKER_WIDTH)
                    same = measured.difference is None
                    reduced[group] = (small if same else shrunk(shown, FLICKER_WIDTH), small)
                if picture_width and (colors or beyond):
                    made = group_pictures(
                        group, shown, shown_baseline, measured, picture_width, failing=bool(beyond), colors=colors
                    )
                    pictures |= made[0]
                    scales |= made[1]
    comparison = FrameComparison(
        pair.name,
        pair.frame,
        path,
        baseline,
        tuple(findings),
        measures,
        pictures,
        scales,
        identical,
        time.perf_counter() - started,
    )
    return ComparedFrame(comparison, reduced)


def compare_surely(pair: Pair, limits: Limits, picture_width: int = 0) -> ComparedFrame:
    """Like :func:`compare_frame`; whatever else goes wrong with a frame is that frame's failure as well.

    Files come from anywhere, and one odd file must not cost the report of all the others.
    """
    try:
        return compare_frame(pair, limits, picture_width)
    except Exception as error:
        finding = not_compared(error)
        paths = [files[0] if files else "" for files in (pair.files, pair.baselines)]
        return ComparedFrame(FrameComparison(pair.name, pair.frame, paths[0], paths[1], (finding,)))


def not_compared(error: Exception) -> Finding:
    """The failure of a frame whose comparison ended in an error."""
    return Finding("fail", "not compared", shortened(f"{type(error).__name__}: {error}"))


def same_bytes(path: str, other: str) -> bool:
    """Whether two files hold the same, so that one of them need not be decoded. What cannot be read is not the same."""
    try:
        if os.path.getsize(path) != os.path.getsize(other):
            return False
        with open(path, "rb") as mine, open(other, "rb") as theirs:
            while chunk := mine.read(2**20):
                if chunk != theirs.read(2**20):
                    return False
            return not theirs.read(1)
    except OSError:
        return False


def _file_findings(pair: Pair, limits: Limits) -> Iterator[Finding]:
    checks = (
        ("missing frame", limits.sequence.missing_frames, not pair.files, "there is no such frame"),
        ("extra frame", limits.sequence.extra_frames, not pair.baselines, "the baseline has no such frame"),
    )
    for kind, severity, applies, message in checks:
        if applies and severity != "ignore":
            yield Finding(_weight(severity), kind, message)
    for role, files in (("frame", pair.files), ("baseline", pair.baselines)):
        if len(files) > 1 and limits.sequence.duplicate_frames != "ignore":
            listed = ", ".join(Path(file).name for file in files)
            message = f"the {role} is there {len(files)} times ({listed}); the first was compared"
            severity = _weight(limits.sequence.duplicate_frames)
            yield Finding(severity, "duplicate frame", message, of_baseline=role == "baseline")


def _channel_findings(image: StoredImage, baseline: StoredImage, limits: Limits) -> Iterator[Finding]:
    missing = [name for name in baseline.names if name not in image.names]
    extra = [name for name in image.names if name not in baseline.names]
    rules = limits.sequence
    if missing and rules.missing_channels != "ignore":
        yield Finding(_weight(rules.missing_channels), "missing channels", f"lacks channels {', '.join(missing)}")
    if extra and rules.extra_channels != "ignore":
        message = f"has channels {', '.join(extra)}, which the baseline has not"
        yield Finding(_weight(rules.extra_channels), "extra channels", message)
    depths = dict(zip(baseline.names, baseline.depths, strict=True))
    changed = [
        f"{name} is {depth}, the baseline's {depths[name]}"
        for name, depth in zip(image.names, image.depths, strict=True)
        if name in depths and depth != depths[name]
    ]
    if changed and rules.pixel_types != "ignore":
        yield Finding(_weight(rules.pixel_types), "pixel type", "; ".join(changed))


def _layout_findings(image: StoredImage, baseline: StoredImage) -> Iterator[Finding]:
    sizes = [f"{pixels.shape[1]} × {pixels.shape[0]}" for pixels in (image.pixels, baseline.pixels)]
    if sizes[0] != sizes[1]:
        yield Finding("fail", "size", f"is {sizes[0]} pixels, the baseline {sizes[1]}")
    elif image.window != baseline.window:
        yield Finding(
            "fail", "size", f"its data and display windows are {image.window}, the baseline's {baseline.window}"
        )
    if image.parts != baseline.parts:
        yield Finding("fail", "parts", f"holds {image.parts} parts, the baseline {baseline.parts}")
    elif image.parts > 1:
        yield Finding("warn", "parts", f"of {image.parts} parts only the first was compared")


def _make_finite(group: str, channels: Sequence[str], image: np.ndarray, baseline: np.ndarray) -> Iterator[Finding]:
    """Findings for what is no number; those pixels become black in both, so that the rest can be measured."""
    bad = np.zeros(image.shape, bool)
    for role, pixels in (("", image), ("the baseline's ", baseline)):
        broken = ~np.isfinite(pixels)
        if broken.any():
            row, column, index = (int(place) for place in np.argwhere(broken)[0])
            value, count = pixels[row, column, index], int(np.count_nonzero(broken))
            where = f"{role}{channels[index]} is {value} at pixel ({column}, {row})"
            message = f"{where}, one of {count} that are no number"
            yield Finding("fail", "not finite", message, group, place=(column, row), of_baseline=bool(role))
            bad |= broken
    image[bad] = 0
    baseline[bad] = 0


def _linear(image: np.ndarray, baseline: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    mine = decode_srgb(image)
    return mine, mine if image is baseline else decode_srgb(baseline)


def _planes(image: StoredImage, channels: Sequence[str]) -> np.ndarray:
    indices = [image.names.index(name) for name in channels]
    first, last = indices[0], indices[-1]
    if indices == list(range(first, last + 1)):
        return np.ascontiguousarray(image.pixels[..., first : last + 1])
    return np.take(image.pixels, indices, axis=-1)


def _weight(severity: str) -> Severity:
    return "fail" if severity == "fail" else "warn"
