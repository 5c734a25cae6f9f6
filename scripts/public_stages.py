#!/usr/bin/env python3
"""Counts what tpdwarp makes of every USD stage below folders, for instance clones of public repositories.

    .venv/bin/python scripts/public_stages.py usd-wg-assets OpenUSD arnold-usd --out stages.json
    .venv/bin/python scripts/public_stages.py OpenUSD --pictures small --out stages.json     # renders each, 64 wide

A stage is read at its first frame, in a process of its own with a limit of time. It counts as whole where nothing that
it says of its picture is left out: where there is no warning, or only such as :data:`SOFT` lists. The table of warnings
shows for each kind how many stages hold it, and how many would be whole without it. With ``--pictures``, each is
rendered, too, and what is empty (nothing in view), black, or not finite is listed, with what was said that explains it.
With ``--resume``, stages that ``--out`` knows are not read again. They are taken in an order that mixes folders, so
that what a run has found so far stands for all of them.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import logging
import os
import random
import re
import resource
import sys
import tempfile
import time
import traceback
from collections import Counter
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
# What is no loss: stand-ins that a viewer adds too, choices, the stage's own faults (files that are not there, arrays
# that do not fit), approximations that show nothing else than what is authored, and light of materials and what rough
# metal throws onto other surfaces, which usdview shows likewise.
SOFT = tuple(
    map(
        re.compile,
        (
            r"no light shines",
            r"the stage has no camera",
            r"has no surface that reflects or refracts",
            r"is used, the first of \d+ cameras",
            r"frames outside the animation",
            r"against the faces' winding",
            r"rendered as its control polygons",
            r"has no widths",
            r"has no (points|faces|curve of enough vertices) and is left out|has a size of 0 or less",
            r"has no prototypes and is left out|has no protoIndices|which does not exist",
            r"faces of fewer than three corners",
            r"is no whole number|holds no finite|which is clamped|which are clamped|are ignored|is ignored",
            r"does not fit|do not fit|to something other than faces",
            r"whose file cannot be read|cannot be read: ",
            # As viewers do, which show what is bound to nothing in its display colour, too.
            r"names \S+, which is no material",
            r"in the place of which the model itself is rendered",
            r"a lens that zooms",
            r"no depth of field",
            r"makes no caustics",
            r"portals of a dome|where light of domes comes in",
            r"knows no '|holds no window|holds planes that are none",
            r"does not fit its interpolation",
            r"has no .*: projected along",
            r"until then the mesh is left out",
            r"light that a surface gives off|throws onto other surfaces is left out",
            r"is named as before USD|names no surface|has a material for previews alone",
            r"is not there for textures",
            r"to UsdUVTexture, which is not read",
            r"what is of purpose proxy is rendered",
            r"has faces of points that are not there",
            r"change in number within a shutter",
            # USD's own words, of what it could not compose.
            r"Could not open asset|Could not load|Unresolved reference|deprecated version|Skipping xformOp|API schema",
            r" -- found \[| -- no (positions|prototype indices)|MaterialBindingAPI is not applied",
            r"Unable to open clip layer",
            r"samples are not aligned|joint ?(influences|Indices)|element size|Boundable Extent",
        ),
    )
)
# What says nothing of why a picture would be black or empty.
STAND_INS = re.compile(r"no light shines|the stage has no camera|no surface that reflects or refracts|frames outside")
# What names no kind: prims, files, numbers, quotations.
NAMES = re.compile(r"'[^']*'|@[^@]*@|(?<![\w/])/[\w./:\[\]{}=-]+|\b\d[\d.e+-]*\b| \S* … and \d+ more$| …$")


def main() -> int:
    parser = argparse.ArgumentParser(description="Counts what tpdwarp makes of every USD stage below folders.")
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--out", type=Path, required=True, metavar="JSON", help="takes what was found, stage by stage")
    parser.add_argument("--pictures", type=Path, metavar="FOLDER", help="render each, 64 pixels wide, as PNG there")
    parser.add_argument("--seconds", type=float, default=60.0, help="of processor time a stage may take [60]")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="only every Nth of them [1]")
    parser.add_argument("--first", type=int, default=0, metavar="K", help="of those, begin at the Kth of all [0]")
    parser.add_argument("--resume", action="store_true", help="keep what --out holds")
    options = parser.parse_args()
    known = json.loads(options.out.read_text()) if options.resume and options.out.exists() else {}
    stages = sorted(str(f) for d in options.folders for f in d.rglob("*") if f.suffix in SUFFIXES and f.is_file())
    random.Random(0).shuffle(stages)
    stages = stages[options.first :: options.every]
    if options.pictures:
        options.pictures.mkdir(parents=True, exist_ok=True)
    import_everything(options.pictures)
    for done, stage in enumerate(stages):
        if stage in known:
            continue
        known[stage] = apart(stage, options.pictures, options.seconds)
        if done % 20 == 0:
            options.out.write_text(json.dumps(known, indent=1))
    options.out.write_text(json.dumps(known, indent=1))
    report({stage: known[stage] for stage in stages})
    return 0


def import_everything(pictures: Path | None) -> None:
    """What every stage needs, once for all processes: modules, and for pictures the kernels of a plain stage."""
    import tpdwarp.jobs.opening
    import tpdwarp.rendering.frame  # noqa: F401

    if pictures:
        with tempfile.TemporaryDirectory() as folder:
            stage = Path(folder) / "floor.usda"
            stage.write_text('#usda 1.0\ndef Cube "Floor" {\n}\n')
            looked_at(str(stage), Path(folder))


def apart(stage: str, pictures: Path | None, seconds: float) -> dict:
    """What a process of its own found out about a stage."""
    reading, writing = os.pipe()
    process = os.fork()
    if process == 0:
        os.close(reading)
        resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds) + 1))
        silent = os.open(os.devnull, os.O_WRONLY)
        os.dup2(silent, 1)
        os.dup2(silent, 2)
        with os.fdopen(writing, "w") as pipe:
            json.dump(looked_at(stage, pictures), pipe)
        os._exit(0)
    os.close(writing)
    began = time.monotonic()
    os.set_blocking(reading, False)
    answer = b""
    while time.monotonic() < began + 10 * seconds:
        try:
            part = os.read(reading, 1 << 20)
        except BlockingIOError:
            time.sleep(0.01)
            continue
        if not part:
            break
        answer += part
    else:
        os.kill(process, 9)
    os.close(reading)
    _, status = os.waitpid(process, 0)
    found = json.loads(answer) if answer else {"result": f"ended by {os.waitstatus_to_exitcode(status)}"}
    return {**found, "seconds": round(time.monotonic() - began, 2)}


def looked_at(stage: str, pictures: Path | None) -> dict:
    """Result, what is said in words, and with a folder for ``pictures`` what is seen."""
    from tpdwarp.errors import FrameError, InputError, logger
    from tpdwarp.io.images import encode_srgb
    from tpdwarp.jobs.dark_frames import DarkWatch
    from tpdwarp.jobs.opening import chosen_settings, open_scene, shutter_of
    from tpdwarp.rendering.context import RenderContext
    from tpdwarp.rendering.frame import render_frame

    logging.disable()
    settings = chosen_settings({"photons": 1024, "samples": 1, "image_width": 64, "threads": 1})
    found: dict = {"result": "read"}
    word: list[str] = []
    source = None
    try:
        source = open_scene(stage, settings, default_time=False)
        shutter = shutter_of(source, source.start, settings)
        source.region()
        scene = source.at(shutter)
        found["triangles"] = sum(len(mesh.triangles) for mesh in scene.meshes)
        if pictures:
            frame = render_frame(RenderContext(source, settings), shutter, *source.resolution())
            pixels = np.stack([frame.channels[name] for name in "RGBA"], axis=-1)
            found["seen"] = seen(pixels)
            logging.disable(logging.NOTSET)
            listener = logging.Handler()
            listener.emit = lambda record: word.append(record.getMessage().removeprefix(stage))
            logger.addHandler(listener)
            DarkWatch(stage)(shutter.frame, frame.channels)
            found["word"] = word
            found["picture"] = str(pictures / (hashlib.sha256(stage.encode()).hexdigest()[:16] + ".png"))
            write_png(found["picture"], encode_srgb(np.nan_to_num(pixels[..., :3])))
    except (InputError, FrameError) as error:
        found = {"result": "refused", "error": str(error).removeprefix(stage)}
    except Exception:
        found = {"result": "traceback", "error": traceback.format_exc()[-2000:]}
    if source is not None:
        found["warnings"] = [message.removeprefix(stage) for message in source.warnings.messages]
    return found


def seen(pixels: np.ndarray) -> str:
    """What a picture [height, width, RGBA] is in a word."""
    if not np.isfinite(pixels).all():
        return "not finite"
    if pixels[..., :3].any():
        return "shown"
    return "black" if pixels[..., 3].any() else "empty"


def write_png(path: str, pixels: np.ndarray) -> None:
    """A picture [height, width, RGB], sRGB."""
    image = oiio.ImageBuf(oiio.ImageSpec(pixels.shape[1], pixels.shape[0], 3, "uint8"))
    image.set_pixels(oiio.ROI(), pixels)
    image.write(path)


def kind_of(message: str) -> str:
    """A message without what it names."""
    message = re.sub(r"^: (?=/)\S+( and \d+ more)?: ", "", message)
    return NAMES.sub("…", message.removeprefix(": "))


def losses(found: dict) -> set[str]:
    """Kinds of what is lost in a picture."""
    said = found.get("warnings", ())
    return {kind_of(message) for message in said if not any(soft.search(message) for soft in SOFT)}


def report(stages: dict[str, dict]) -> None:
    """Prints the counts."""
    results = Counter(found["result"] for found in stages.values())
    print(f"{len(stages)} stages: " + ", ".join(f"{count} {name}" for name, count in results.most_common()))
    for name in results:
        if name in ("read", "refused"):
            continue
        for stage, found in stages.items():
            if found["result"] == name:
                print(f"  {stage}: {name} {found.get('error', '').strip().splitlines()[-1:]}")
    print("refused:")
    for kind, count in Counter(
        kind_of(found["error"]) for found in stages.values() if found["result"] == "refused"
    ).most_common():
        first = next(s for s, f in stages.items() if f["result"] == "refused" and kind_of(f["error"]) == kind)
        print(f"  {count:5d}  {kind}   [{first}]")
    lost = {stage: losses(found) for stage, found in stages.items() if found["result"] == "read"}
    print(f"nothing lost in {sum(not kinds for kinds in lost.values())} of {len(lost)} that are read; lost:")
    alone = Counter(next(iter(kinds)) for kinds in lost.values() if len(kinds) == 1)
    for kind, count in Counter(kind for kinds in lost.values() for kind in kinds).most_common():
        first = next(stage for stage, kinds in lost.items() if kind in kinds)
        print(f"  {count:5d} (alone in {alone[kind]})  {kind}   [{first}]")
    pictures = {stage: found for stage, found in stages.items() if "seen" in found}
    if pictures:
        counts = Counter(found["seen"] for found in pictures.values())
        print(f"{len(pictures)} pictures: " + ", ".join(f"{count} {name}" for name, count in counts.most_common()))
    for stage, found in pictures.items():
        if found["seen"] != "shown":
            why = [message for message in found["warnings"] if not STAND_INS.search(message)] + found["word"]
            print(f"  {stage}: {found['seen']}" + (f", for {why[0]}" if why else " WITHOUT A WORD"))


if __name__ == "__main__":
    sys.exit(main())
