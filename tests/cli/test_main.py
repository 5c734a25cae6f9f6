import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import tpdwarp
from tests.small_stage import write_stage
from tpdwarp.cli import main
from tpdwarp.errors import InputError
from tpdwarp.io.images import read_image
from tpdwarp.jobs import frame_work

ROOT = Path(tpdwarp.__file__).parent.parent

# A renderer that never comes to an end after its first frame, for interrupting it.
SLOW = """
import signal, sys, time
import numpy as np
from tpdwarp.jobs import frame_work
from tpdwarp.cli import main
from tpdwarp.rendering.frame import Frame
from tpdwarp.photons.energy import EnergyAccount
from tpdwarp.photons.record import LandedPhotons, PhotonRecord

def render_frame(context, shutter, width, height, *_, **__):
    if shutter.frame > 1:
        print("busy", flush=True)
        time.sleep(60)
    grey = {name: np.ones((height, width), np.float32) for name in "RGBA"}
    landed, numbers = LandedPhotons([], ()), np.zeros(0, np.int64)
    landed.record = PhotonRecord(numbers, *[np.zeros((0, 3))] * 6, np.zeros((0, 2)), numbers, numbers, ())
    return Frame(landed, EnergyAccount(sent=1.0), {}, grey, context.source.at(shutter).camera)

frame_work.render_frame = render_frame
# Shells start what runs in the background with it ignored.
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.exit(main(sys.argv[1:]))
"""


def start(arguments, *command, **options):
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.Popen(
        [sys.executable, *command, *map(str, arguments)],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "required: COMMAND (see tpdwarp --help)"),
        (["dance"], "invalid choice: 'dance'"),
        (["render"], "required: SCENE, OUT (see tpdwarp render --help)"),
        (["render", "a", "b", "--no-such-option"], "--no-such-option (see tpdwarp render --help)"),
        (["render", "a", "b", "--phot", "3"], "unknown arguments: --phot (see"),
        (["render", "a", "--phot", "3", "b.exr"], "unknown arguments: --phot (see"),
        (["render", "a", "b.exr", "c.exr"], "unknown arguments: c.exr (see"),
        (["render", "a", "s3://bucket/b.exr"], "no such file"),
        (["render", "a", "b.exr", "--retries", "-1"], "--retries must be 0 or more"),
        (["render", "a", "b", "--photons", "many"], "--photons"),
        (["render", "a", "b.exr", "--exposure", "1", "--shutter", "0", "1"], "not allowed with"),
        (["render", "a", "b.exr", "-f", "1", "-d"], "not allowed with"),
        (["render", "no.usda", "b.exr"], "no.usda: no such file"),
        (["render", "no.usda", "b.exr", "--kernel", "square"], "--kernel must be one of"),
        (["render", "no.usda", "b.exr", "--samples", "9" * 20], "--samples must be at most 65536"),
        (["render", "no.usda", "b.exr", "--bounces", "4294967297"], "--bounces must be at most 65536"),
        (["render", "no.usda", "b.exr", "--segments", "all"], "'all' is neither a whole number nor auto"),
        (["render", "no.usda", "b.exr", "--complexity", "best"], "'best' is neither a number nor low, medium"),
        (["render", "no.usda", "b.exr", "--segments", "100000"], "--segments must be at most 4096"),
        (["render", "no.usda", "b.exr", "--accumulation-times", "1000000000"], "--accumulation-times must be at most"),
        (["render", "no.usda", "b.exr", "--threads", "100000"], "--threads must lie in 0 (all cores) … 1024"),
        (["render", "no.usda", "b.exr", "--complexity", "-1"], "--complexity must lie in 1 … 2"),
        (["render", "no.usda", "b.exr", "--complexity", "nan"], "--complexity must lie in 1 … 2"),
        (["render", "no.usda", "b.exr", "--progress", "wheel"], "--progress must be one of"),
        (["photons", "no.usda", "b.usdc"], "no.usda: no such file"),
        (["info", "no.usda"], "no.usda: no such file"),
    ],
)
def test_what_cannot_be_used_is_said_in_one_line_with_code_2(arguments, message, capsys):
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert out == "" and re.fullmatch(r"error: [^\n]*\n", err) and message in err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["render", "a.####.exr", "--stats", "a.png"], "a.png: is no name for statistics"),
        (["render", "a.####.exr", "--stats", "a.usdc"], "a.usdc: is no name for statistics"),
        (["photons", ""], "error: is "),
        (["photons", "."], ".: is a folder"),
    ],
)
def test_a_name_that_cannot_be_meant_is_refused_before_any_work(arguments, message, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    command, *rest = arguments
    assert main([command, write_stage(tmp_path / "scene.usda", frames=1), *rest]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line
    assert os.listdir(tmp_path) == ["scene.usda"]


def test_help_and_version_are_no_errors(capsys):
    for arguments in (["--help"], ["render", "--help"], ["photons", "-h"], ["info", "-h"], ["--version"]):
        assert main(arguments) == 0
        out, err = capsys.readouterr()
        assert out and not err
    assert out == f"tpdwarp {tpdwarp.__version__}\n"


@pytest.fixture
def break_info(monkeypatch):
    def with_error(error):
        def fail(*arguments, **settings):
            raise error

        monkeypatch.setattr("tpdwarp.jobs.stage_info.info", fail)

    return with_error


def test_the_unexpected_is_one_line_with_code_1(break_info, capsys, monkeypatch):
    monkeypatch.delenv("TPDWARP_DEBUG", raising=False)
    break_info(ZeroDivisionError("by\nzero"))
    assert main(["info", "a"]) == 1
    assert capsys.readouterr().err == "error: internal: ZeroDivisionError: by zero\n"


@pytest.mark.parametrize(("error", "code"), [(ZeroDivisionError("x"), 1), (InputError("y"), 2)])
def test_tracebacks_appear_only_when_asked_for(break_info, capsys, monkeypatch, error, code):
    break_info(error)
    for value, shown in (("0", False), ("1", True)):
        monkeypatch.setenv("TPDWARP_DEBUG", value)
        assert main(["info", "a"]) == code
        assert ("Traceback" in capsys.readouterr().err) == shown


def test_an_interruption_is_code_130_in_one_line(break_info, capsys):
    break_info(KeyboardInterrupt())
    assert main(["info", "a"]) == 130
    assert capsys.readouterr().err == "error: interrupted\n"


@pytest.mark.parametrize(("signal_number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_an_interrupted_render_leaves_complete_frames_only(tmp_path, signal_number, code):
    if signal.getsignal(signal_number) == signal.SIG_IGN:
        pytest.skip("whoever runs the tests (nohup, say) has this signal ignored, and so do they")
    stage = write_stage(tmp_path / "stage.usda")
    out = tmp_path / "out"
    arguments = ["render", stage, out / "a.##.exr", "-w", 8, "--debug-layer", out / "a.usdc", "--stats", out / "a.json"]
    process = start(arguments, "-c", SLOW)
    lines = []
    for line in process.stdout:
        lines.append(line)
        if line == "busy\n":
            break
    process.send_signal(signal_number)
    _, err = process.communicate(timeout=60)
    assert process.returncode == code, (lines, err)
    assert err == "error: interrupted (the same command with --skip-existing-frames goes on)\n"
    # The photons of the frame that is done wait for a second run.
    assert sorted(os.listdir(out)) == ["a.01.exr", "a.usdc.parts"]


SIGNALLED_WHILE_IMPORTING = """
import os, pathlib, signal, sys, tempfile
folder = tempfile.mkdtemp()
# Stands for pxr, whose loader swallows what is raised while a module of it is imported.
pathlib.Path(folder, "swallowing.py").write_text('''
import os, signal
try:
    os.kill(os.getpid(), signal.SIGTERM)
    for _ in range(10**5): pass
except BaseException:
    pass
''')
sys.path.insert(0, folder)
from tpdwarp.cli import main
import tpdwarp.cli.info as info

def run(options):
    import swallowing
    return 0

info.run = run
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.parametrize("call", ["main()", "main(sys.argv[1:])"])
def test_a_signal_during_an_import_is_heard_at_once_by_the_program_and_after_it_by_callers(call):
    # Only a process of the program's own may be ended within an import.
    process = start(["info", "none.usda"], "-c", SIGNALLED_WHILE_IMPORTING.replace("main(sys.argv[1:])", call))
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (143, "", "error: interrupted\n")


@pytest.mark.parametrize("closed", ["1>&-", "2>&-", "0<&- 1>&- 2>&-"])
def test_a_render_without_standard_streams_writes_its_frames(tmp_path, closed):
    stage = write_stage(tmp_path / "stage.usda")
    command = f'exec "$@" {closed}'
    program = [sys.executable, "-m", "tpdwarp", "render", stage, tmp_path / "a.##.exr", "-w", 8, "--photons", 64]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        ["bash", "-c", command, "bash", *map(str, program)], env=environment, capture_output=True, timeout=100
    )
    assert done.returncode == 0 and done.stderr == b""
    assert sorted(path.name for path in tmp_path.glob("*.exr")) == ["a.01.exr", "a.02.exr", "a.03.exr"]
    read_image(tmp_path / "a.03.exr")


def test_too_little_address_space_is_one_line_and_no_crash(tmp_path):
    stage = write_stage(tmp_path / "stage.usda")
    program = [sys.executable, "-m", "tpdwarp", "render", stage, str(tmp_path / "a.##.exr")]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        ["bash", "-c", 'ulimit -v 1500000; exec "$@"', "bash", *program],
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 2 and re.fullmatch(r"error: 1\.4 GB of address space [^\n]*\n", done.stderr)


def test_a_pipe_is_refused_and_not_waited_for(tmp_path, capsys):
    os.mkfifo(tmp_path / "stage.usda")
    assert main(["render", str(tmp_path / "stage.usda"), str(tmp_path / "a.exr")]) == 2
    assert "is no ordinary file" in capsys.readouterr().err


def test_a_full_log_costs_no_frame(tmp_path):
    stage = write_stage(tmp_path / "stage.usda")
    with open("/dev/full", "w") as full:
        arguments = ["-m", "tpdwarp", "render", stage, tmp_path / "a.##.exr", "-w", 8, "--photons", 64]
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        subprocess.run([sys.executable, *map(str, arguments)], env=environment, stdout=full, stderr=full, timeout=100)
    assert len(list(tmp_path.glob("*.exr"))) == 3


def test_a_reader_that_leaves_early_is_no_traceback(tmp_path):
    stage = write_stage(tmp_path / "stage.usda")
    process = start(["-m", "tpdwarp", "info", stage])
    process.stdout.close()
    assert "Traceback" not in process.stderr.read()
    process.stderr.close()
    assert process.wait(60) == 1


def test_an_interruption_before_the_program_has_begun_is_no_traceback(tmp_path):
    # Python runs this before the program, in place of a keyboard.
    (tmp_path / "argparse.py").write_text("import os, signal\nos.kill(os.getpid(), signal.SIGINT)\n")
    script = (
        "import runpy, signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
        f"sys.path.insert(0, {str(tmp_path)!r}); runpy.run_module('tpdwarp', run_name='__main__')"
    )
    process = start([], "-c", script)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (-signal.SIGINT, "", "")


def test_python_m_tpdwarp_is_the_program():
    process = start(["-m", "tpdwarp", "--version"])
    assert process.communicate(timeout=60)[0] == f"tpdwarp {tpdwarp.__version__}\n"
    assert process.returncode == 0


def test_the_callers_signal_handler_is_put_back(capsys):
    before = signal.getsignal(signal.SIGTERM)
    main(["info", "none.usda"])
    assert signal.getsignal(signal.SIGTERM) is before


def test_sequences_take_their_renderer_from_the_frame_room():
    from tpdwarp.rendering import frame

    assert (frame_work.render_frame, frame_work.trace_frame) == (frame.render_frame, frame.trace_frame)
