"""Runs of the program that faults are injected into, each in a process of its own and bounded in time."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tpdwarp.errors import InputError
from tpdwarp.io.images import read_image
from tpdwarp.usd.read.debug_layer import DebugLayerReader

ROOT = Path(__file__).parent.parent.parent
# Nothing here takes a minute on an idle core; a hang is a finding, not the end of the script.
TIMEOUT = 300.0
FRAMES = 12
SMALL = ("-w", "32", "--samples", "1", "--photons", "4096", "--threads", "2")


@dataclass(frozen=True)
class Ended:
    """How a run ended.

    Attributes:
        code: Exit code, as a shell reports it: 128 + the number of a signal that ended it.
        out, err: What it printed.
        seconds: How long it took from the fault, or in all.
    """

    code: int
    out: str
    err: str
    seconds: float

    @property
    def crashed(self) -> bool:
        """Whether it ended by an abort, a bus error or a segmentation fault, or had to be killed for hanging."""
        return self.code in (134, 135, 139, HANGS)

    @property
    def one_line(self) -> bool:
        """Whether it said exactly one error, in a line of bounded length, beside warnings."""
        errors = [line for line in self.err.splitlines() if not line.startswith("warning: ")]
        return len(errors) == 1 and errors[0].startswith("error: ") and len(errors[0]) <= LONGEST_LINE


# What a library says is cut to 240 characters; names of files and prims stand in front.
LONGEST_LINE = 600
HANGS = -1


def start(
    arguments: list[object],
    changes: Mapping[str, str | None] | None = None,
    prefix: tuple[str, ...] = (),
    program: tuple[str, ...] = ("-m", "tpdwarp"),
) -> subprocess.Popen[bytes]:
    """Starts ``tpdwarp`` with ``arguments``, behind a command line that it is handed to.

    Args:
        arguments: Its arguments.
        changes: Changes of the environment; None removes a variable.
        prefix: Command line in front, for instance of ``unshare``.
        program: What Python runs.
    """
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **(changes or {})}
    return subprocess.Popen(
        [*prefix, sys.executable, *program, *map(str, arguments)],
        env={name: value for name, value in environment.items() if value is not None},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        preexec_fn=_hear_signals,
    )


def finish(process: subprocess.Popen[bytes], timeout: float = TIMEOUT) -> Ended:
    """Waits for a run; one that hangs is killed."""
    started = time.monotonic()
    try:
        out, err = process.communicate(timeout=timeout)
        code = process.returncode
    except subprocess.TimeoutExpired:
        process.kill()
        out, err = process.communicate()
        code = HANGS
    code = 128 - code if code < HANGS else code
    return Ended(code, out.decode("utf-8", "replace"), err.decode("utf-8", "replace"), time.monotonic() - started)


def cpu_seconds(process: subprocess.Popen[bytes]) -> float:
    """Processor time that a running process has used."""
    fields = Path(f"/proc/{process.pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def run(arguments: list[object], **options) -> Ended:
    """Runs ``tpdwarp`` to its end."""
    return finish(start(arguments, **options))


def render(scene: object, out: object, *more: object, frames: object = f"1:{FRAMES}") -> list[object]:
    """Arguments that render a few small frames."""
    return ["render", scene, out, *SMALL, "-f", frames, "--progress", "plain", *more]


def pixels(folder: Path) -> dict[str, dict[str, np.ndarray] | None]:
    """Channels of all frames in ``folder``, by name; None where one cannot be read whole."""
    found: dict[str, dict[str, np.ndarray] | None] = {}
    for path in sorted(folder.glob("*.exr")):
        try:
            found[path.name] = read_image(path)[0]
        except InputError:
            found[path.name] = None
    return found


def lost(folder: Path, reference: Mapping[str, dict[str, np.ndarray]]) -> int:
    """How many frames of ``reference`` are missing in ``folder``, torn, or differ in a pixel."""
    found = pixels(folder)
    return sum(not same(found.get(name), planes) for name, planes in reference.items())


def same(planes: Mapping[str, np.ndarray] | None, others: Mapping[str, np.ndarray]) -> bool:
    """Whether all channels agree bit by bit."""
    return planes is not None and all(np.array_equal(planes.get(name), values) for name, values in others.items())


def layer_values(path: Path) -> dict[str, bytes]:
    """All values of a debug layer by attribute and frame, and its frames' photons and energies."""
    reader = DebugLayerReader(path)
    values = {}
    for frame in reader.frames:
        record = reader.at(frame)
        columns = {**vars(record), "receiver_paths": np.array(record.receiver_paths)}
        ends, colors = reader.time_differentials(frame)
        for name, column in {**columns, "ends": ends, "colors": colors}.items():
            values[f"{name} {frame}"] = np.ascontiguousarray(column).tobytes()
    for frame, text in json.loads(reader.provenance["statistics"]).items():
        noted = {name: value for name, value in json.loads(text).items() if name != "seconds"}
        values[f"statistics {frame}"] = json.dumps(noted).encode()
    return values


def statistics_lines(path: Path) -> dict[float, dict[str, object]]:
    """Photons and energy of every frame of a statistics file of lines, by frame."""
    entries = map(json.loads, path.read_text().splitlines())
    return {entry["frame"]: {name: entry[name] for name in ("photons", "energy")} for entry in entries}


def leftovers(folder: Path) -> list[str]:
    """Hidden files, which are temporaries and claims."""
    return sorted(path.name for path in folder.iterdir() if path.name.startswith("."))


def _hear_signals() -> None:
    """Undoes what shells hand on: commands in the background ignore SIGINT, and those of ``nohup`` SIGHUP."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
