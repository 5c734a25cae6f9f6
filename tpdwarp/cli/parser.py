"""The argument parser: one-line errors, sub-commands from their modules."""

from __future__ import annotations

import argparse
import re
import shutil
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import Any, NoReturn

from tpdwarp.errors import InputError
from tpdwarp.version import VERSION

_FRAME_OPTIONS = ("-f", "--frames")


class Formatter(argparse.RawDescriptionHelpFormatter):
    """Help in few lines: wide where the terminal is, each option beside its text."""

    def __init__(self, prog: str) -> None:
        width = min(110, shutil.get_terminal_size().columns - 2)
        super().__init__(prog, max_help_position=32, width=width)

    def _format_action_invocation(self, action: argparse.Action) -> str:
        if not action.option_strings or action.nargs == 0:
            return super()._format_action_invocation(action)
        # The value once, after the last spelling, and not after each.
        value = self._format_args(action, self._get_default_metavar_for_optional(action))
        return f"{', '.join(action.option_strings)} {value}"


class Parser(argparse.ArgumentParser):
    """A parser that refuses wrong usage as any other unusable input, in one line."""

    def __init__(self, **options: Any) -> None:
        super().__init__(formatter_class=Formatter, allow_abbrev=False, **options)

    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message} (see {self.prog} --help)")


def build_parser(commands: Sequence[str]) -> _Root:
    """The program's parser.

    Args:
        commands: Modules of :mod:`tpdwarp.cli`, each with ``SUMMARY``, ``declare(parser)`` and ``run(options)``.
    """
    root = _Root(prog="tpdwarp", description="Renders USD animations with motion-blurred caustics.")
    root.add_argument("--version", action="version", version=f"tpdwarp {VERSION}")
    choices = root.add_subparsers(title="commands", metavar="COMMAND", required=True, parser_class=Parser)
    for name in commands:
        module = import_module(f"tpdwarp.cli.{name}")
        parser = choices.add_parser(name, help=module.SUMMARY, description=f"{module.SUMMARY}.", epilog=module.EPILOG)
        module.declare(parser)
        parser.set_defaults(run=module.run, parser=parser)
    return root


class _Root(Parser):
    def parse_args(self, arguments: Sequence[str] | None = None) -> argparse.Namespace:  # type: ignore[override]
        """Parses a command line, in which frames may be negative.

        Raises:
            InputError: Wrong usage.
        """
        options, unknown = self.parse_known_args(_joined(sys.argv[1:] if arguments is None else arguments))
        if unknown:
            # An option's value is left over with it, or taken for a file while that is left over: neither is to blame.
            blamed = [argument for argument in unknown if argument.startswith("-")] or unknown
            options.parser.error(f"unknown arguments: {' '.join(blamed)}")
        return options


def _joined(arguments: Sequence[str]) -> list[str]:
    """``-f -5:-1`` as ``--frames=-5:-1``: argparse takes ``-5:-1`` for an option, though no option has a digit.

    So is ``--light-groups SCENE`` told from ``--light-groups NAME=PATTERN``.
    """
    joined: list[str] = []
    for argument in arguments:
        if joined and joined[-1] in _FRAME_OPTIONS and re.match(r"-\.?[0-9]", argument):
            joined[-1] = f"--frames={argument}"
        elif joined and joined[-1] == "--light-groups" and not re.match("auto|-|.*=", argument):
            joined[-1:] = ["--light-groups=auto", argument]
        else:
            joined.append(argument)
    return joined
