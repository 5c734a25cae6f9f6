"""The command line: it parses and prints; whatever it can do, the functions of :mod:`tpdwarp` can do."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import traceback
from collections.abc import Sequence

from tpdwarp.cli.memory import check_address_space
from tpdwarp.cli.outcome import DONE, FAILED, REFUSED, SIGNALLED, debugging
from tpdwarp.cli.parser import build_parser
from tpdwarp.cli.streams import mend_streams
from tpdwarp.errors import InputError, shortened
from tpdwarp.io.terminal import say
from tpdwarp.stopping import Stopped, raise_if_asked, signals_stop

# One module in this package each, in the order in which --help lists them.
COMMANDS = ("render", "photons", "bake", "info", "check", "study", "farm", "openjd")


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the program.

    Args:
        arguments: Command line without the program's name; None takes the process's own.

    Returns:
        The exit code: 0 done; 1 a frame failed, or something unexpected happened; 2 wrong usage or unusable input;
        130, 143 or 129 interrupted by SIGINT, SIGTERM or SIGHUP.
    """
    mend_streams()
    try:
        # Behind the process's own command line only the interpreter's end follows.
        with signals_stop(_leave if arguments is None else None):
            return _run(arguments)
    except KeyboardInterrupt as error:
        return _interrupted(error)


def _run(arguments: Sequence[str] | None) -> int:
    resumable = ""
    try:
        options = build_parser(COMMANDS).parse_args(arguments)
        resumable = getattr(options, "resumable", "")
        check_address_space()
        code = options.run(options)
        raise_if_asked()
        return code
    except SystemExit as finished:
        return int(finished.code or DONE)
    except InputError as error:
        return _say(error, str(error), REFUSED)
    except KeyboardInterrupt as error:
        return _interrupted(error, resumable)
    except BrokenPipeError:
        # The reader of our output has left; what Python would flush at exit has nowhere to go either.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except Exception as error:
        return _say(error, f"internal: {type(error).__name__}: {shortened(str(error))}", FAILED)


def _interrupted(error: KeyboardInterrupt, resumable: str = "") -> int:
    number = error.number if isinstance(error, Stopped) else signal.SIGINT
    return _say(error, f"interrupted{resumable}", SIGNALLED + number)


def _leave(number: int) -> None:
    """Ends the process where nothing has to be cleaned up yet."""
    _say(Stopped(number), "interrupted", SIGNALLED + number)
    os._exit(SIGNALLED + number)


def _say(error: BaseException, line: str, code: int) -> int:
    if debugging():
        traceback.print_exception(error)
    with contextlib.suppress(BrokenPipeError):
        say("error: " + " ".join(line.split()), sys.stderr)
    return code
