"""The command line: it parses and prints; whatever it can do, the functions of :mod:`tpdwarp` can do."""

from __future__ import annotations

import os
import signal
import sys
import traceback
from collections.abc import Sequence
from types import FrameType

from tpdwarp.cli.outcome import DONE, FAILED, INTERRUPTED, REFUSED, debugging
from tpdwarp.cli.parser import build_parser
from tpdwarp.errors import InputError

# One module in this package each, in the order in which --help lists them.
COMMANDS = ("render", "photons", "info", "check", "study")


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the program.

    Args:
        arguments: Command line without the program's name; None takes the process's own.

    Returns:
        The exit code: 0 done; 1 a frame failed, or something unexpected happened; 2 wrong usage or unusable input;
        130 interrupted.
    """
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    try:
        before = signal.signal(signal.SIGTERM, _interrupt)
    except ValueError:
        # Only the main thread may; elsewhere the caller's handler stays.
        before = None
    try:
        options = build_parser(COMMANDS).parse_args(arguments)
        return options.run(options)
    except SystemExit as finished:
        return int(finished.code or DONE)
    except InputError as error:
        return _say(error, str(error), REFUSED)
    except KeyboardInterrupt as error:
        return _say(error, "interrupted", INTERRUPTED)
    except BrokenPipeError:
        # The reader of our output has left; what Python would flush at exit has nowhere to go either.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except Exception as error:
        return _say(error, f"internal: {type(error).__name__}: {error}", FAILED)
    finally:
        if before is not None:
            signal.signal(signal.SIGTERM, before)


def _interrupt(number: int, frame: FrameType | None) -> None:
    # Farms stop jobs with this signal: unwinding as for Ctrl-C leaves nothing half written.
    raise KeyboardInterrupt


def _say(error: BaseException, line: str, code: int) -> int:
    if debugging():
        traceback.print_exception(error)
    print("error: " + " ".join(line.split()), file=sys.stderr)
    return code
