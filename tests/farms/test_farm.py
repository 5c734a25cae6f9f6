"""Frames of a farm are those of a render, whatever happens to workers and schedulers."""

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import psutil
import pytest
from pxr import Gf, Usd, UsdRender

import tpdwarp
from tests.farms.clusters import Cluster, cluster
from tests.small_stage import write_stage
from tpdwarp.errors import InputError
from tpdwarp.farms.order import heard, told
from tpdwarp.io.images import read_image
from tpdwarp.jobs.opening import DEFAULT_TIME
from tpdwarp.jobs.results import FrameOutcome
from tpdwarp.photons.energy import EnergyAccount

ROOT = Path(tpdwarp.__file__).parent.parent
SMALL = {"image_width": 12, "samples": 1, "photons": 256, "threads": 1}


@pytest.fixture
def stage(tmp_path):
    return write_stage(tmp_path / "stage.usda", frames=6)


def assert_same_pixels(folder, other):
    paths = sorted(Path(other).glob("*.exr"))
    assert paths
    for path in paths:
        ours, theirs = read_image(Path(folder) / path.name)[0], read_image(path)[0]
        assert ours.keys() == theirs.keys()
        for name in theirs:
            np.testing.assert_array_equal(ours[name], theirs[name], err_msg=f"{path.name} {name}")


def hidden(folder):
    return [path.name for path in Path(folder).iterdir() if path.name.startswith(".")]


def test_outcomes_come_over_the_wire_as_they_were():
    energy = EnergyAccount(3.0, 2.0, 0.5, 0.25, {"bounces": 0.25}, {"landed": 7})
    done = FrameOutcome(2.5, "written", "/a/ö.exr", "", 7, energy, {"trace": 0.5}, 1.25, 2)
    failed = FrameOutcome(3.0, "failed", "/a/b.exr", "no", tries=0)
    assert heard(told(done)) == done and heard(told(failed)) == failed
    # The default time is found again in a table of outcomes.
    assert heard(told(FrameOutcome(DEFAULT_TIME, "written"))).frame is DEFAULT_TIME


def test_a_farm_of_this_machine_renders_what_render_does(stage, tmp_path):
    extras = {"stats": tmp_path / "farm" / "s.jsonl", "debug_layer": tmp_path / "farm" / "a.debug.usdc"}
    result = tpdwarp.farm(stage, tmp_path / "farm" / "a.##.exr", workers=2, chunk=2, **extras, **SMALL)
    assert result.ok and result.written == (1, 2, 3, 4, 5, 6)
    plain = tpdwarp.render(stage, tmp_path / "one" / "a.##.exr", **SMALL)
    assert_same_pixels(tmp_path / "farm", tmp_path / "one")
    assert result.energy == plain.energy
    lines = [json.loads(line) for line in extras["stats"].read_text().splitlines()]
    assert sorted(line["frame"] for line in lines) == [1, 2, 3, 4, 5, 6]
    assert sorted(os.listdir(tmp_path / "farm")) == [
        *(f"a.0{frame}.exr" for frame in range(1, 7)),
        "a.debug.usdc",
        "a.view.usda",
        "s.jsonl",
    ]


@pytest.mark.slow
def test_a_farm_renders_every_product_under_its_own_name(stage, tmp_path):
    settings = Usd.Stage.Open(str(stage))
    found = UsdRender.Settings.Define(settings, "/Render/Settings")
    settings.SetMetadata("renderSettingsPrimPath", "/Render/Settings")
    for name, size in {"wide": (8, 4), "square": (4, 4)}.items():
        product = UsdRender.Product.Define(settings, f"/Render/{name}")
        product.CreateResolutionAttr(Gf.Vec2i(*size))
        product.CreateProductNameAttr(f"{name}.exr")
        found.GetProductsRel().AddTarget(product.GetPath())
    settings.GetRootLayer().Save()
    few = {"frames": "1:2", "samples": 1, "photons": 256, "threads": 1}
    result = tpdwarp.farm(stage, tmp_path / "farm" / "<product>.##.exr", workers=1, **few)
    assert result.ok and len(result.outcomes) == 4
    # One trace serves both.
    assert ["trace" in outcome.seconds for outcome in result.outcomes] == [True] * 2 + [False] * 2
    assert tpdwarp.render(stage, tmp_path / "one" / "<product>.##.exr", **few).ok
    assert len(list((tmp_path / "one").glob("*.exr"))) == 4
    assert_same_pixels(tmp_path / "farm", tmp_path / "one")


def test_a_scheduler_that_does_not_answer_is_refused(stage, tmp_path):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{probe.getsockname()[1]}"
        with pytest.raises(InputError, match="no scheduler answers"):
            tpdwarp.farm(stage, tmp_path / "a.##.exr", scheduler=address, **SMALL)


def running(stage, out, *options):
    """A farm in a process of its own."""
    arguments = ["farm", stage, out, "-w", 12, "--samples", 1, "--photons", 256, "--progress", "plain", *options]
    return subprocess.Popen(
        [sys.executable, "-m", "tpdwarp", *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def wait_for(what, timeout=240):
    deadline = time.monotonic() + timeout
    while time.monotonic() < deadline:
        if what():
            return
        time.sleep(0.05)
    pytest.fail("it did not happen in time")


def processes_of(process):
    return [psutil.Process(process.pid), *psutil.Process(process.pid).children(recursive=True)]


@pytest.mark.slow
def test_everything_listens_to_this_machine_alone_and_ends_with_a_signal(stage, tmp_path):
    out = tmp_path / "o"
    farm = running(write_stage(tmp_path / "long.usda", frames=400), out / "a.###.exr", "--workers", 2)
    wait_for(lambda: out.exists() and any(out.glob("*.exr")))
    family = processes_of(farm)
    listening = [
        connection.laddr.ip
        for process in family
        for connection in process.net_connections()
        if connection.status == psutil.CONN_LISTEN
    ]
    assert len(listening) >= 4 and set(listening) == {"127.0.0.1"}
    # As a terminal does: to all of its processes.
    os.killpg(farm.pid, signal.SIGINT)
    started = time.monotonic()
    _, err = farm.communicate(timeout=60)
    assert farm.returncode == 130
    assert err == "error: interrupted (the same command with --skip-existing-frames goes on)\n"
    assert time.monotonic() - started < 10
    assert hidden(out) == []
    wait_for(lambda: not any(process.is_running() for process in family), 10)


def poisoned(tmp_path, body):
    """A folder whose ``sitecustomize`` does something in the worker at frame 3."""
    (tmp_path / "sitecustomize.py").write_text(
        "import importlib.abc, importlib.util, os, sys, time\n"
        "class Finder(importlib.abc.MetaPathFinder):\n"
        "    def find_spec(self, name, path, target=None):\n"
        "        if name != 'tpdwarp.jobs.frame_work': return None\n"
        "        sys.meta_path.remove(self)\n"
        "        spec = importlib.util.find_spec(name)\n"
        "        run = spec.loader.exec_module\n"
        "        def exec_module(module):\n"
        "            run(module)\n"
        "            real = module.render_frame\n"
        "            def render_frame(context, shutter, *size, **more):\n"
        f"                if shutter.frame == 3: {body}\n"
        "                return real(context, shutter, *size, **more)\n"
        "            module.render_frame = render_frame\n"
        "        spec.loader.exec_module = exec_module\n"
        "        return spec\n"
        "sys.meta_path.insert(0, Finder())\n"
    )
    return f"{tmp_path}{os.pathsep}{ROOT}"


@pytest.mark.slow
def test_a_frame_that_kills_its_worker_fails_alone(stage, tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", poisoned(tmp_path, "os.kill(os.getpid(), 9)"))
    result = tpdwarp.farm(stage, tmp_path / "o" / "a.##.exr", workers=2, chunk=3, **SMALL)
    assert list(result.failed) == [3] and "its worker died" in result.failed[3]
    assert result.written == (1, 2, 4, 5, 6) and hidden(tmp_path / "o") == []


@pytest.mark.slow
def test_memory_that_one_worker_lacks_costs_no_frame(stage, tmp_path, monkeypatch):
    mark = tmp_path / "mark"
    body = f"""
                    if not os.path.exists({str(mark)!r}):
                        open({str(mark)!r}, 'w').close()
                        raise MemoryError"""
    monkeypatch.setenv("PYTHONPATH", poisoned(tmp_path, body))
    result = tpdwarp.farm(stage, tmp_path / "o" / "a.##.exr", workers=2, chunk=3, **SMALL)
    assert mark.exists() and result.ok and len(result.written) == 6


@pytest.mark.slow
def test_a_frame_that_eats_all_memory_fails_alone(stage, tmp_path, monkeypatch):
    body = """
                    eaten = []
                    while True:
                        eaten.append(bytearray(os.urandom(1 << 24)))
                        time.sleep(0.05)"""
    monkeypatch.setenv("PYTHONPATH", poisoned(tmp_path, body))
    result = tpdwarp.farm(
        stage, tmp_path / "o" / "a.##.exr", workers=2, chunk=3, max_memory=2 * 900 * 2**20, **SMALL
    )
    assert list(result.failed) == [3] and "--max-memory" in result.failed[3]
    assert result.written == (1, 2, 4, 5, 6)


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["kill a worker", "stop a worker", "kill the scheduler"])
def test_no_frame_is_lost_with_a_worker_or_a_scheduler(tmp_path, fault):
    stage, out = write_stage(tmp_path / "long.usda", frames=60), tmp_path / "o"
    with cluster(tmp_path / "dask", 2) as made:
        farm = running(stage, out / "a.###.exr", "--scheduler", made.address, "--threads", 1, "--chunk", 5)
        try:
            wait_for(lambda: out.exists() and len(list(out.glob("*.exr"))) >= 5)
            if fault == "kill the scheduler":
                made.scheduler.kill()
                made.scheduler.wait()
                time.sleep(2)
                made.start_scheduler()
                for worker in made.workers:
                    with contextlib.suppress(ProcessLookupError):
                        os.killpg(worker.pid, signal.SIGKILL)
                made.start_worker()
            else:
                number = signal.SIGKILL if fault == "kill a worker" else signal.SIGSTOP
                for process in processes_of(made.workers[0]):
                    process.send_signal(number)
            stdout, stderr = farm.communicate(timeout=400)
        finally:
            farm.kill()
    assert farm.returncode == 0, stdout + stderr
    tpdwarp.render(stage, tmp_path / "one" / "a.###.exr", **SMALL)
    assert_same_pixels(out, tmp_path / "one")
    assert "60 of 60 frames done" in stdout
    # A worker that is stopped holds its claim on, until it is killed and the next render sweeps.
    assert tpdwarp.render(stage, out / "a.###.exr", skip_existing=True, **SMALL).written == () and hidden(out) == []
    assert ("the scheduler is gone" in stderr) == (fault == "kill the scheduler")


@pytest.mark.slow
def test_workers_that_see_another_stage_or_have_other_versions_render_nothing_and_say_so(stage, tmp_path):
    # A worker whose program says that it is another version.
    (tmp_path / "sitecustomize.py").write_text("import tpdwarp.version\ntpdwarp.version.VERSION = '0.0.9'\n")
    with cluster(tmp_path / "dask", 1) as made:
        made.start_worker(PYTHONPATH=f"{tmp_path}{os.pathsep}{ROOT}")
        time.sleep(5)
        farm = running(stage, tmp_path / "o" / "a.##.exr", "--scheduler", made.address, "--chunk", 1)
        stdout, stderr = farm.communicate(timeout=300)
        assert farm.returncode == 0, stdout + stderr
        assert stderr.count("has tpdwarp 0.0.9, not") == 1 and "it renders nothing" in stderr
    with cluster(tmp_path / "dask", 0) as made:
        made.start_worker(PYTHONPATH=f"{tmp_path}{os.pathsep}{ROOT}")
        farm = running(stage, tmp_path / "p" / "a.##.exr", "--scheduler", made.address)
        _, stderr = farm.communicate(timeout=300)
        assert farm.returncode == 2 and "error: no worker can render" in stderr


@pytest.mark.slow
def test_connections_are_encrypted_and_strangers_are_refused(stage, tmp_path):
    ours, theirs = certificates(tmp_path / "ours"), certificates(tmp_path / "theirs")
    flags = zip(("--tls-ca-file", "--tls-cert", "--tls-key"), ours, strict=True)
    options = tuple(part for pair in flags for part in pair)
    made = Cluster(tmp_path / "dask", "tls", options)
    try:
        made.start_scheduler()
        made.start_worker()
        time.sleep(5)
        result = tpdwarp.farm(stage, tmp_path / "a.##.exr", scheduler=made.address, tls=ours, **SMALL)
        assert result.ok and len(result.written) == 6
        for trust in (theirs, None):
            with pytest.raises(InputError):
                tpdwarp.farm(stage, tmp_path / "b.##.exr", scheduler=made.address, tls=trust, **SMALL)
        assert not list(tmp_path.glob("b.*"))
    finally:
        made.stop()
    local = tpdwarp.farm(stage, tmp_path / "c.##.exr", workers=1, tls=ours, **SMALL)
    assert local.ok


def certificates(folder):
    """An authority's certificate, one that it signed, and the key of both."""
    folder.mkdir()
    ca, certificate, key = (str(folder / name) for name in ("ca.pem", "cert.pem", "key.pem"))
    new = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=127.0.0.1"]
    subprocess.run([*new, "-keyout", key, "-out", certificate], check=True, capture_output=True)
    Path(ca).write_bytes(Path(certificate).read_bytes())
    return ca, certificate, key


@pytest.mark.slow
def test_kernels_are_compiled_once_a_host(stage, tmp_path, monkeypatch):
    monkeypatch.setenv("WARP_CACHE_PATH", str(tmp_path / "cache"))
    compiled = []
    ended = threading.Event()

    def watch():
        # A module's folder is made under the number of the process that compiles it.
        while not ended.wait(0.002):
            for path in (tmp_path / "cache").glob("*/wp_*_p*_t*"):
                if path.name not in compiled:
                    compiled.append(path.name)

    watcher = threading.Thread(target=watch)
    watcher.start()
    result = tpdwarp.farm(stage, tmp_path / "a.##.exr", workers=2, chunk=1, **SMALL)
    ended.set()
    watcher.join()
    assert result.ok and compiled
    modules = [name.rsplit("_p", 1)[0] for name in compiled]
    assert len(modules) == len(set(modules))
