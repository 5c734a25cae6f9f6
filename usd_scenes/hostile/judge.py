"""Runs a case in this process and judges what came out of it."""

from __future__ import annotations

import json
import math
import os
import re
import sys
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from pxr import Sdf, Tf

from tpdwarp.cli import main
from usd_scenes.hostile.cases import Case

BALANCE = 1e-4
"""Part of the flux sent that rounding may lose."""
_ALLOWED = re.compile(r"^(warning|error): \S")
_FRAME = re.compile(r"^error: frame [^:]+: ")
_INNARDS = re.compile(r"pxrInternal|\b0x[0-9a-f]{6}")
_NAMELESS = re.compile(r"--frames|out of memory")
_SUMMARY = re.compile(r"^error: \d+ of \d+ frames failed: ")


@dataclass(frozen=True)
class Verdict:
    """What came of a case.

    Attributes:
        code: Exit code.
        faults: What is wrong with it, a line each; empty for a pass.
        seconds: How long it took.
        errors: What the program said on stderr.
    """

    code: int
    faults: tuple[str, ...]
    seconds: float
    errors: str


def judge(case: Case) -> Verdict:
    """Runs ``case`` and looks at its exit code, at every line on stderr and at the files it leaves."""
    started = time.perf_counter()
    code, errors = _run(case)
    seconds = time.perf_counter() - started
    faults = [*_faults_of_lines(case, code, errors.splitlines())]
    if code == 0:
        faults += _faults_of_files(case)
    if any("internal:" in line for line in faults):
        os.environ["TPDWARP_DEBUG"] = "1"
        errors += _run(case)[1]
        del os.environ["TPDWARP_DEBUG"]
    return Verdict(code, tuple(faults), seconds, errors)


def _run(case: Case) -> tuple[int, str]:
    """The exit code, and what was said on stderr."""
    log = case.stage.with_suffix(".stderr")
    with _streams_to(log), warnings.catch_warnings():
        warnings.simplefilter("always")
        code = main(list(case.arguments))
    return code, log.read_text(errors="replace")


def clean(case: Case) -> None:
    """Removes what a case left behind."""
    for path in case.stage.parent.glob(f"{case.seed}.*"):
        path.unlink()


@contextmanager
def _streams_to(log: Path) -> Iterator[None]:
    """Standard error, native code's too, to ``log``; standard output to nowhere."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept = os.dup(1), os.dup(2)
    opened = os.open(os.devnull, os.O_WRONLY), os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    streams = sys.stdout, sys.stderr
    try:
        os.dup2(opened[0], 1)
        os.dup2(opened[1], 2)
        sys.stdout, sys.stderr = os.fdopen(os.dup(1), "w"), os.fdopen(os.dup(2), "w")
        try:
            yield
        finally:
            sys.stdout.close()
            sys.stderr.close()
    finally:
        sys.stdout, sys.stderr = streams
        for number, there in enumerate(kept, start=1):
            os.dup2(there, number)
            os.close(there)
        for one in opened:
            os.close(one)


def _faults_of_lines(case: Case, code: int, lines: list[str]) -> Iterator[str]:
    if code not in (0, 1, 2):
        yield f"exit code {code}"
    wrong = [line for line in lines if line.startswith("error: ")]
    yield from (f"a line that is neither an error nor a warning: {line}" for line in lines if not _ALLOWED.match(line))
    yield from (f"an internal error: {line}" for line in wrong if "internal:" in line)
    yield from (f"a line of {len(line)} letters: {line[:60]}…" for line in lines if len(line) > 12_000)
    yield from (f"innards of a library: {line[:200]}" for line in lines if _INNARDS.search(line))
    if code == 2 and len(wrong) != 1:
        yield f"refused in {len(wrong)} lines"
    if (code == 0) != (not wrong):
        yield f"exit code {code} with {len(wrong)} error lines"
    for line in wrong:
        if str(case.stage.parent) not in line and not _SUMMARY.match(line) and not _NAMELESS.search(line):
            yield f"an error that does not name its file: {line}"
        if code == 1 and not (_FRAME.match(line) or _SUMMARY.match(line) or "is not written" in line):
            yield f"a failure that does not name its frame: {line}"


def _faults_of_files(case: Case) -> Iterator[str]:
    folder = case.stage.parent
    for pattern in case.pictures:
        found = sorted(folder.glob(pattern))
        if not found:
            yield f"a success that left no {pattern}"
        for path in found:
            yield from faults_of_image(path) if path.suffix == ".exr" else _faults_of_layer(path)
    if case.statistics is not None:
        yield from _faults_of_statistics(json.loads(case.statistics.read_text()))


def faults_of_image(path: Path) -> Iterator[str]:
    image = oiio.ImageBuf(str(path))
    pixels = image.get_pixels(oiio.FLOAT)
    names = image.spec().channelnames
    for number, name in enumerate(names):
        channel = pixels[..., number]
        # Depth is infinite where nothing is seen.
        bad = np.isnan(channel) if name == "Z" else ~np.isfinite(channel)
        if bad.any():
            yield f"{path.name}: {int(bad.sum())} of {bad.size} pixels of {name} are not finite"
        if name in "RGB" and (channel < 0).any():
            yield f"{path.name}: {name} is negative"


def _faults_of_layer(path: Path) -> Iterator[str]:
    try:
        layer = Sdf.Layer.OpenAsAnonymous(str(path))
    except Tf.ErrorException as refused:
        yield f"{path.name} cannot be opened: {refused}"
        return
    found: list[str] = []

    def visit(spec: Sdf.Path) -> None:
        if not spec.IsPropertyPath():
            return
        for when in layer.ListTimeSamplesForPath(spec):
            try:
                values = np.array(layer.QueryTimeSample(spec, when), dtype=np.float64)
            except (TypeError, ValueError):
                continue
            if not np.isfinite(values).all():
                found.append(f"{path.name}: {spec} at {when:g} is not finite")

    layer.Traverse(Sdf.Path.absoluteRootPath, visit)
    yield from found


def _faults_of_statistics(statistics: dict) -> Iterator[str]:
    for frame in statistics["frames"]:
        energy = frame["energy"]
        if energy is None:
            continue
        parts = [energy["deposited"], energy["escaped"], energy["absorbed"], *energy["lost"].values()]
        if not all(map(math.isfinite, (*parts, energy["sent"]))) or min(parts) < 0:
            yield f"frame {frame['frame']}: energy {energy}"
        elif abs(sum(parts) - energy["sent"]) > BALANCE * energy["sent"]:
            yield f"frame {frame['frame']}: of {energy['sent']:g} W sent {sum(parts):g} W are known: {energy}"
