"""``tpdwarp check``: compares frames with their baseline."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile

from tpdwarp.cli.outcome import DONE, FAILED
from tpdwarp.cli.report import warnings_shown
from tpdwarp.errors import FrameError, InputError, shortened
from tpdwarp.io.terminal import say
from tpdwarp.jobs.progress import KINDS, OccasionalProgress, Progress, progress_of
from tpdwarp.stopping import work_begins

SUMMARY = "compare frames and debug layers with a baseline"
EPILOG = (
    "FRAMES and BASELINE are folders, images, or names with #### where the frame number goes. What may differ is said\n"
    "by tpdwarp-check.toml beside the baseline.\n"
    "Exit code: 0 the same within limits, 1 different, 2 could not compare, 130 or 143 interrupted."
)


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the sub-command's arguments."""
    parser.usage = (
        "tpdwarp check FRAMES BASELINE [options]\n"
        "       tpdwarp check --render SCENE [FRAMES] BASELINE [options]\n"
        "       tpdwarp check --calibrate SCENE BASELINE [options]\n"
        "       tpdwarp check --write-limits BASELINE [--limits FILE.toml]"
    )
    parser.add_argument(
        "frames", metavar="FRAMES", nargs="?", help="What is to be checked; --render fills this folder. [temporary]"
    )
    parser.add_argument("baseline", metavar="BASELINE", help="What it should look like.")
    parser.add_argument("--limits", metavar="FILE.toml", help="Limits. [tpdwarp-check.toml beside BASELINE]")
    parser.add_argument(
        "--write-limits", action="store_true", help="Write the default limits there, to be changed; overwrites none."
    )
    says = parser.add_argument_group("what it says")
    says.add_argument("--report", metavar="FILE.html", help="Also write a page to look at, all in one file.")
    says.add_argument("--junit", metavar="FILE.xml", help="Also write JUnit XML, for GitLab, Jenkins and GitHub.")
    says.add_argument("--json", metavar="FILE.json", help="Also write everything measured as JSON.")
    says.add_argument("-v", "--verbose", action="store_true", help="A line for every frame and every finding.")
    says.add_argument(
        "--color", choices=("auto", "always", "never"), default="auto", help="Colours of the table. [auto]"
    )
    says.add_argument("--progress", metavar="|".join(KINDS), default="auto", help="How progress is shown. [auto]")
    update = parser.add_argument_group("updating")
    update.add_argument(
        "--update", action="store_true", help="Show what differs, then make FRAMES the baseline, in one step. Exits 0."
    )
    update.add_argument(
        "--drop-missing", action="store_true", help="Let --update remove frames from BASELINE that FRAMES lacks."
    )
    update.add_argument("--reason", metavar="TEXT", default="", help="Why, for the record; --update needs it.")
    rendering = parser.add_argument_group("rendering")
    source = rendering.add_mutually_exclusive_group()
    source.add_argument(
        "--render", metavar="SCENE", help="Render this stage first, with the baseline's settings and frames."
    )
    source.add_argument(
        "--calibrate", metavar="SCENE", help="Render this stage with other seeds, and write the limits these need."
    )
    rendering.add_argument("--seeds", type=int, default=12, metavar="N", help="Renders to calibrate by. [12]")
    rendering.add_argument(
        "--false-alarms",
        type=float,
        default=1e-3,
        metavar="P",
        help="Probability that a check of honest frames may fail at calibrated limits. [0.001]",
    )
    machine = parser.add_argument_group("machine")
    machine.add_argument("--device", default="", metavar="NAME", help="What to render on. [cpu]")
    machine.add_argument(
        "--threads", type=int, default=0, metavar="N", help="Frames compared at the same time. [0: all cores]"
    )


def run(options: argparse.Namespace) -> int:
    """Compares; returns the exit code."""
    # A line a frame would drown the table.
    seldom = options.progress == "auto" and not sys.stderr.isatty()
    shown = OccasionalProgress() if seldom else progress_of(options.progress)
    if options.frames is None and not (options.render or options.calibrate or options.write_limits):
        raise InputError("check needs FRAMES and BASELINE (see tpdwarp check --help)")
    if options.frames is not None and options.calibrate:
        raise InputError("--calibrate needs BASELINE only, for it renders frames of its own")
    if options.write_limits:
        if options.frames is not None or options.render or options.calibrate or options.update:
            raise InputError("--write-limits needs BASELINE only, and compares nothing")
        from tpdwarp.checks.limits import write_default_limits

        say(f"{write_default_limits(options.baseline, options.limits)} written", sys.stdout)
        return DONE
    work_begins()
    try:
        with warnings_shown(shown), tempfile.TemporaryDirectory(prefix="tpdwarp-check-") as temporary:
            return _check(options, options.frames or temporary, shown)
    except (InputError, BrokenPipeError):
        raise
    except FrameError as error:
        raise InputError(str(error)) from error
    except Exception as error:
        # The exit code must not say that frames differ.
        raise InputError(f"internal: {type(error).__name__}: {shortened(str(error))}") from error


def _check(options: argparse.Namespace, frames: str, shown: Progress) -> int:
    # Here and not above, so that --help need not wait for image libraries to load.
    from tpdwarp.checks.limits import limits_beside
    from tpdwarp.checks.run import check
    from tpdwarp.checks.table import table_lines
    from tpdwarp.checks.update import check_reason, update_baseline

    if options.update:
        check_reason(options.reason)
    if options.calibrate:
        from tpdwarp.checks.calibrate import calibrate

        machine = {"threads": options.threads} | ({"device": options.device} if options.device else {})
        calibrate(
            options.calibrate,
            options.baseline,
            seeds=options.seeds,
            false_alarms=options.false_alarms,
            limits=options.limits,
            progress=shown,
            **machine,
        )
        say(f"{options.limits or limits_beside(options.baseline)} written", sys.stdout)
        return DONE
    result = check(
        frames,
        options.baseline,
        render=options.render,
        device=options.device,
        limits=options.limits,
        report=options.report,
        junit=options.junit,
        json=options.json,
        threads=options.threads,
        progress=shown,
        new=options.update,
    )
    say("\n".join(table_lines(result, _wants_color(options.color), options.verbose)), sys.stdout)
    if options.update:
        updated = update_baseline(result, options.reason, drop_missing=options.drop_missing)
        say(f"{options.baseline} {'replaced' if updated else 'needs no update'}", sys.stdout)
        return DONE
    return DONE if result.ok else FAILED


def _wants_color(choice: str) -> bool:
    # https://no-color.org
    automatic = sys.stdout.isatty() and not os.environ.get("NO_COLOR")
    return choice == "always" or (choice == "auto" and automatic)
