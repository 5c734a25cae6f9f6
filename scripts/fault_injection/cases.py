"""Faults other than signals, each on a sequence of a few small frames."""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import warp as wp

from scripts.fault_injection.bench import Bench, how_ended
from scripts.fault_injection.program import (
    FRAMES,
    LONGEST_LINE,
    finish,
    leftovers,
    lost,
    pixels,
    render,
    run,
    same,
    start,
)
from scripts.fault_injection.table import Row
from tpdwarp.device import Launcher
from tpdwarp.io.images import IMAGE_COPIES
from tpdwarp.io.memory import memory_allowed
from usd_scenes.hostile.gigantic import many_faces, many_pixels, nested_instancers, nested_prims, nested_references

SKIP = "--skip-existing-frames"
# Imports take the most of it.
REFUSED_SECONDS = 5.0


def stale_frames(bench: Bench) -> Iterator[Row]:
    """Frames of other settings or of another stage are not kept."""
    for change in (["--photons", "2048"], ["--seed", "5"], ["--exposure", "0.25"], ["-w", "24"], ["--aov", "Z"]):
        out = bench.rendered("stale")
        fresh = bench.new("fresh")
        ended = run([*render(bench.scene, out / "a.####.exr", SKIP), *change])
        run([*render(bench.scene, fresh / "a.####.exr"), *change])
        missing = lost(out, pixels(fresh))
        said = "of other settings" in ended.err
        yield Row(
            f"resumed with {' '.join(change)}",
            "all rendered anew, and why",
            how_ended(ended),
            missing,
            not missing and said,
        )
    out = bench.rendered("stale")
    scene = bench.new("stage") / "scene.usda"
    scene.write_text(
        f"#usda 1.0\n(\n    subLayers = [@{bench.scene}@]\n    startTimeCode = 1\n    endTimeCode = 9\n)\n"
    )
    ended = run(render(scene, out / "a.####.exr", SKIP))
    said = "of another stage" in ended.err
    yield Row("resumed with another stage", "all rendered anew, and why", how_ended(ended), 0, said and ended.code == 0)


def damaged_frames(bench: Bench) -> Iterator[Row]:
    """Frames that are not whole are not kept."""
    out = bench.rendered("damaged")
    whole = (out / "a.0001.exr").read_bytes()
    for number, data in enumerate((whole[: len(whole) // 2], whole[:1], b"a text\n", b"<html></html>", b""), start=1):
        (out / f"a.{number:04d}.exr").write_bytes(data)
    ended = run(render(bench.scene, out / "a.####.exr", SKIP))
    missing = lost(out, bench.reference)
    said = "5 damaged" in ended.out and f"{FRAMES - 5} skipped" in ended.out
    yield Row(
        "frames cut, of one byte, text, HTML, empty",
        "5 rendered anew, the others kept",
        how_ended(ended),
        missing,
        said and not missing,
    )


def closed_streams(bench: Bench) -> Iterator[Row]:
    """Streams that are closed cost no frame."""
    for closed in ("2>&-", "1>&-", "0<&- 1>&- 2>&-", ">/dev/full 2>&1"):
        out = bench.new("closed")
        ended = run(render(bench.scene, out / "a.####.exr"), prefix=("bash", "-c", f'exec "$@" {closed}', "bash"))
        missing = lost(out, bench.reference)
        yield Row(
            f"started with {closed}", "renders, silently", how_ended(ended), missing, not missing and not ended.err
        )


def outputs_over_inputs(bench: Bench) -> Iterator[Row]:
    """No output destroys what is read or written too."""
    folder = bench.new("outputs")
    sub = folder / "sub.usdc"
    shutil.copy2(bench.scene, sub)
    scene = folder / "scene.usda"
    scene.write_text("#usda 1.0\n(\n    subLayers = [@./sub.usdc@]\n)\n")
    (folder / "link.json").symlink_to(sub)
    before = sub.read_bytes()
    frames = folder / "a.####.exr"
    for arguments in (
        ["photons", scene, sub],
        render(scene, frames, "--debug-layer", sub),
        render(scene, frames, "--stats", sub),
        render(scene, frames, "--stats", folder / "link.json"),
        render(scene, frames, "--stats", folder / "a.0002.exr"),
        render(scene, "s3://bucket/a.####.exr"),
    ):
        ended = run(arguments)
        good = ended.code == 2 and ended.one_line and sub.read_bytes() == before
        yield Row(
            f"{arguments[0]} … {' '.join(_short(a) for a in arguments[-2:])}",
            "exit 2, one line",
            how_ended(ended),
            0,
            good,
        )
    precious = folder / "precious.txt"
    precious.write_text("precious")
    (folder / "a.0001.exr").symlink_to(precious)
    ended = run(render(bench.scene, frames))
    good = precious.read_text() == "precious" and not lost(folder, bench.reference)
    yield Row(
        "a link planted in place of a frame",
        "what it names stays",
        how_ended(ended),
        lost(folder, bench.reference),
        good,
    )


def stage_written_over(bench: Bench) -> Iterator[Row]:
    """A crate that changes under a render gives no frame of two versions."""
    data = bench.scene.read_bytes()
    for how, change in (("truncated", data[:1000]), ("written over, same size", bytes(len(data)))):
        folder = bench.new("over")
        scene = folder / "scene.usdc"
        scene.write_bytes(data)
        process = start(render(scene, folder / "a.####.exr"))
        _wait_for(folder / "a.0001.exr")
        with open(scene, "r+b") as file:
            file.write(change)
            file.truncate(len(change))
        ended = finish(process)
        wrong = sum(not same(planes, bench.reference[name]) for name, planes in pixels(folder).items())
        longest = max(map(len, ended.err.splitlines()), default=0)
        did = f"code {ended.code}, {len(pixels(folder))} frames, {wrong} wrong, longest line {longest}"
        good = ended.code == 1 and not wrong and longest <= LONGEST_LINE and "was written over" in ended.err
        yield Row(f"the stage {how} in place", "frames until then, exit 1, short lines", did, wrong, good)


def folder_gone(bench: Bench) -> Iterator[Row]:
    """A folder that vanishes fails the frames to come, and nothing else."""
    out = bench.new("gone")
    process = start(render(bench.scene, out / "a.####.exr"))
    _wait_for(out / "a.0002.exr")
    shutil.move(out, bench.folder / "moved")
    ended = finish(process)
    kept = pixels(bench.folder / "moved")
    wrong = sum(not same(planes, bench.reference[name]) for name, planes in kept.items())
    shutil.rmtree(bench.folder / "moved")
    good = ended.code == 1 and len(kept) >= 2 and not wrong and "frames failed" in ended.err
    yield Row("the output folder is moved away", "exit 1, failed frames listed", how_ended(ended), wrong, good)


def full_disk(bench: Bench) -> Iterator[Row]:
    """A full disk ends the sequence soon, and what is there is whole."""
    out = bench.new("full")
    size = sum(path.stat().st_size for path in (bench.folder / "reference").glob("*.exr")) // FRAMES
    mount = f"mount -t tmpfs -o size={max(size * 2 // 4096, 1) * 4096} tmpfs {out} && trap '' PIPE && \"$@\""
    keep = f"; code=$?; mkdir -p {out}.kept; cp {out}/*.exr {out}.kept; exit $code"
    prefix = ("unshare", "-rm", "sh", "-c", mount + keep, "sh")
    if subprocess.run(["unshare", "-rm", "true"], capture_output=True).returncode:
        yield Row("a full disk", "stops, whole frames", "not tried: no mounts of one's own here", 0, True)
        return
    ended = run(render(bench.scene, out / "a.####.exr"), prefix=prefix)
    kept = pixels(Path(f"{out}.kept"))
    wrong = sum(not same(planes, bench.reference[name]) for name, planes in kept.items())
    shutil.rmtree(f"{out}.kept", ignore_errors=True)
    good = ended.code == 1 and not wrong and "frames failed" in ended.err
    yield Row("a disk that is full after two frames", "exit 1, whole frames, listed", how_ended(ended), wrong, good)


def names(bench: Bench) -> Iterator[Row]:
    """Names do nothing to the terminal, whatever the encoding."""
    out = bench.new("names")
    wicked = "\x1b[31m\u202e\nframe 9 (9:9) written"
    ended = run(render(bench.scene, out / f"{wicked}.####.exr"))
    raw = any(character in ended.out + ended.err for character in "\x1b\u202e")
    lines = sum(line.startswith("frame 9 (9:9)") for line in ended.out.splitlines())
    good = ended.code == 0 and not raw and not lines
    yield Row(
        "a name with escapes, a mark, a line break", "escaped", f"{how_ended(ended)}, {lines} forged lines", 0, good
    )
    plain = {"PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "LC_ALL": "C"}
    ended = run(render(bench.scene, out / "größe" / "a.####.exr"), changes=plain)
    made = len(list((out / "größe").glob("*.exr"))) if (out / "größe").exists() else 0
    good = (ended.code == 0 and made == FRAMES) or (ended.code == 2 and ended.one_line)
    yield Row("a name beyond ASCII, UTF-8 off", "written, or one line", how_ended(ended), 0, good)


def two_at_once(bench: Bench) -> Iterator[Row]:
    """Two renders into one folder share the frames."""
    out = bench.new("two")
    processes = [start(render(bench.scene, out / "a.####.exr")) for _ in range(2)]
    ended = [finish(process) for process in processes]
    written = sum(each.out.count(" written ") for each in ended)
    missing = lost(out, bench.reference)
    good = [each.code for each in ended] == [0, 0] and not missing and written == FRAMES and not leftovers(out)
    yield Row("two renders into one folder", f"{FRAMES} frames rendered once", f"{written} rendered", missing, good)


def kernel_caches(bench: Bench) -> Iterator[Row]:
    """A cache that is damaged or cannot be used costs no frame."""
    # Starts Warp without its greeting.
    Launcher()
    whole = Path(wp.config.kernel_cache_dir)
    temporary = bench.new("tmp")

    def rendered(name: str, must: str, cache: Path, **changes: str | None) -> Row:
        out = bench.new("cached")
        started = time.monotonic()
        ended = run(
            render(bench.scene, out / "a.####.exr"),
            changes={"WARP_CACHE_PATH": str(cache), "TMPDIR": str(temporary), **changes},
        )
        missing = lost(out, bench.reference)
        did = f"{how_ended(ended)}, {time.monotonic() - started:.0f} s"
        return Row(name, must, did, missing, ended.code == 0 and not missing)

    (bench.folder / "file").write_text("")
    yield rendered("the kernel cache lies below a file", "a cache of its own", bench.folder / "file" / "cache")
    copy = bench.folder / "cache" / whole.name
    for name, how in (("truncated", lambda data: data[: len(data) // 2]), ("empty", lambda data: b"")):
        shutil.rmtree(copy.parent, ignore_errors=True)
        shutil.copytree(temporary / f"tpdwarp-kernels-{os.getuid()}" / whole.name, copy)
        for path in copy.glob("wp_*/*.o"):
            path.write_bytes(how(path.read_bytes()))
        yield rendered(f"all objects in the cache are {name}", "compiled anew", copy.parent)


def pipes(bench: Bench) -> Iterator[Row]:
    """What is no file is refused, not waited for."""
    folder = bench.new("pipe")
    os.mkfifo(folder / "pipe.usda")
    for arc in ("subLayers", "references"):
        body = "(\n    subLayers = [@./pipe.usda@]\n)\n"
        if arc == "references":
            body = 'def "A" (\n    references = @./pipe.usda@</B>\n)\n{\n}\n'
        (folder / f"{arc}.usda").write_text(f"#usda 1.0\n{body}")
    for name in ("pipe", "subLayers", "references"):
        yield _refused(bench, f"a pipe: {name}", render(folder / f"{name}.usda", folder / "a.####.exr"))


def strangers(bench: Bench) -> Iterator[Row]:
    """A few bytes that stand for more than any machine holds are refused by what they declare."""
    folder = bench.new("strangers")
    out = folder / "a.####.exr"
    stages = {
        "point instancers nested to 10⁹": nested_instancers(folder / "instancers.usda", 9, 10),
        "native instances nested to 10¹⁰": nested_references(folder / "native.usda", 10, 10, instanceable=True),
        "references nested to 10¹⁰": nested_references(folder / "references.usda", 10, 10, instanceable=False),
        "100 000 prims in each other, text": nested_prims(folder / "deep.usda", 100_000),
        "3000 prims in each other, crate": nested_prims(folder / "deep.usdc", 3000),
        "a crate of 3·10⁸ face counts": many_faces(folder / "faces.usdc", 300_000_000),
    }
    for name, stage in stages.items():
        yield _refused(bench, name, render(stage, out))
    yield _refused(bench, "2²⁸ photons", [*render(bench.scene, out), "--photons", 2**28, "--max-memory", "8G"])
    frames = [bench.new(f"images/{side}") for side in ("ours", "theirs")]
    rows = int(memory_allowed(None) / (40_000 * 4 * 4 * IMAGE_COPIES)) + 1
    bomb = many_pixels(frames[0] / "a.0001.exr", 40_000, rows)
    shutil.copy(bomb, frames[1])
    started = time.monotonic()
    ended = run(["check", *frames])
    took = time.monotonic() - started
    # A frame that cannot be read is one that differs.
    good = ended.code == 1 and "GB of memory" in ended.out + ended.err and took < REFUSED_SECONDS
    did = f"{how_ended(ended)}, {took:.1f} s"
    yield Row("an image of more pixels than memory, check", "exit 1, named, within 5 s", did, 0, good)


def address_space(bench: Bench) -> Iterator[Row]:
    """A limit on addresses in which libraries crash is refused."""
    out = bench.new("addresses") / "a.####.exr"
    limited = ("bash", "-c", 'ulimit -v 1500000; exec "$@"', "bash")
    yield _refused(bench, "1.5 GB of address space", render(bench.scene, out), prefix=limited)


def _refused(bench: Bench, name: str, arguments: list[object], **options) -> Row:
    """A run that must end at once with one line; on a machine that others keep busy its own processor time tells."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    started = time.monotonic()
    ended = finish(start(arguments, **options), timeout=120)
    took = time.monotonic() - started
    now = resource.getrusage(resource.RUSAGE_CHILDREN)
    work = now.ru_utime + now.ru_stime - used.ru_utime - used.ru_stime
    good = ended.code == 2 and ended.one_line and min(took, work) < REFUSED_SECONDS
    return Row(
        name, "exit 2, one line, within 5 s", f"{took:.1f} s ({work:.1f} s of work), {how_ended(ended)}", 0, good
    )


def _wait_for(path: Path) -> None:
    deadline = time.monotonic() + 120
    while not path.exists() and time.monotonic() < deadline:
        time.sleep(0.005)


def _short(argument: object) -> str:
    text = str(argument)
    return text if "://" in text else os.path.basename(text)
