"""Shows that checks are worth trusting: deliberate faults are all caught, honest renders all pass.

    python scripts/check_mutations.py [--seeds 20] [--renders 100] [--width 96] [--few]

A small animation is rendered, limits are calibrated from other seeds, and each fault is put into frames of yet another
seed, so that it has to stand out from honest noise. Frames and debug layers are checked apart, and faults that are not
of the metadata carry the baseline's, so that the pixels or photons alone give them away.
"""

from __future__ import annotations

import argparse
import contextlib
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tpdwarp
from tpdwarp.checks.calibrate import calibrate
from tpdwarp.checks.findings import CheckResult
from tpdwarp.checks.limits import LIMITS_FILE
from tpdwarp.io.images import read_image, write_frame
from tpdwarp.photons import tracer
from tpdwarp.photons.photon_map import PhotonMap
from usd_scenes.authoring.wave import write_wave

FRAMES = 4
SETTINGS: dict[str, Any] = {
    "samples": 8,
    "photons": 4096,
    "exposure": 0.5,
    "camera": "/World/Camera",
    "aovs": ("caustic", "Z"),
}
FALSE_ALARMS = 0.01
CALIBRATION_SEEDS = 10
FAULTY_SEED = 777

Channels = dict[str, np.ndarray]
Photons = Callable[[PhotonMap], PhotonMap]


@dataclass
class Shot:
    """A stage, its baselines and an honest render of another seed.

    Attributes:
        folder: Where everything lies.
        width: Width of the frames in pixels.
        frames, layer: Folders of the baselines.
        honest: Frames of another seed.
    """

    folder: Path
    width: int = 96
    frames: Path = field(init=False)
    layer: Path = field(init=False)
    honest: Path = field(init=False)

    def __post_init__(self) -> None:
        self.frames, self.layer, self.honest = (self.folder / name for name in ("frames", "layer", "honest"))
        write_wave(self.scene, frames=FRAMES + 1, resolution=97)
        self.render(self.frames, self.layer)
        calibrate(self.scene, self.frames, seeds=CALIBRATION_SEEDS, false_alarms=FALSE_ALARMS)
        self.render(self.honest, seed=FAULTY_SEED)

    @property
    def scene(self) -> Path:
        return self.folder / "wave.usdc"

    def render(
        self,
        frames: Path,
        layer: Path | None = None,
        scene: Path | None = None,
        photons: Photons | None = None,
        **changes: Any,
    ) -> None:
        """Renders the shot, with photons altered on their way from the tracer to footprints and layer."""
        with altered(photons) if photons else contextlib.nullcontext():
            result = tpdwarp.render(
                scene or self.scene,
                frames / "wave.####.exr",
                frames=f"1:{FRAMES}",
                debug_layer=layer / "wave.debug.usdc" if layer else None,
                **{**SETTINGS, "image_width": self.width, **changes},
            )
        if not result.ok:
            raise SystemExit(f"{frames}: {result.failed} {result.problems}")


@contextlib.contextmanager
def altered(photons: Photons) -> Iterator[None]:
    """While entered, the tracer's photons are changed."""
    real = tracer.trace_photons

    def changed(*arguments: Any, **options: Any) -> Any:
        found, account = real(*arguments, **options)
        return photons(found), account

    tracer.trace_photons = changed
    try:
        yield
    finally:
        tracer.trace_photons = real


# A fault fills a folder with frames, or with a debug layer.
Fault = Callable[[Shot, Path], None]


def rendered(stage: str = "", photons: Photons | None = None, **changes: Any) -> Fault:
    """Frames of a stage with stronger opinions, altered photons or other settings; the metadata tells nothing of it."""

    def make(shot: Shot, folder: Path) -> None:
        scene = None
        if stage:
            scene = shot.folder / f"{folder.name}.usda"
            scene.write_text(f"#usda 1.0\n(\n    subLayers = [@{shot.scene}@]\n)\n\n{stage}\n")
        raw = folder.with_name(f"{folder.name} raw")
        shot.render(raw, scene=scene, photons=photons, **{"seed": FAULTY_SEED, **changes})
        for path in sorted(raw.glob("*.exr")):
            save(folder / path.name, read_image(path)[0], read_image(shot.frames / path.name)[1])
        shutil.rmtree(raw)

    return make


def traced(photons: Photons) -> Fault:
    """A debug layer of altered photons."""

    def make(shot: Shot, folder: Path) -> None:
        shot.render(folder / "unused", folder, photons=photons)
        shutil.rmtree(folder / "unused")

    return make


def painted(change: Callable[[Channels, int], Channels | None], metadata: dict[str, Any] | None = None) -> Fault:
    """Honest frames whose pixels are changed, frame by frame; None leaves a frame out."""

    def make(shot: Shot, folder: Path) -> None:
        for number, path in enumerate(sorted(shot.honest.glob("*.exr")), start=1):
            channels = change(read_image(path)[0], number)
            if channels is not None:
                save(folder / path.name, channels, read_image(shot.frames / path.name)[1] | (metadata or {}))

    return make


def save(path: Path, channels: Channels, metadata: dict[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_frame(path, channels, metadata)


def filed(change: Callable[[Path], None]) -> Fault:
    """Honest frames in a folder in which files are changed."""

    def make(shot: Shot, folder: Path) -> None:
        painted(lambda channels, number: channels)(shot, folder)
        change(folder)

    return make


def colors(change: Callable[[np.ndarray], np.ndarray], only: int = 0) -> Fault:
    """Changes the colour planes of all frames, or of one."""

    def paint(channels: Channels, number: int) -> Channels:
        chosen = {name for name in channels if name.rpartition(".")[2] in ("R", "G", "B")}
        if only in (0, number):
            return {name: change(plane) if name in chosen else plane for name, plane in channels.items()}
        return channels

    return painted(paint)


def placed(name: str, value: float) -> Callable[[Channels, int], Channels]:
    """Sets one pixel of one channel in frame 2."""

    def paint(channels: Channels, number: int) -> Channels:
        if number == 2:
            channels[name][20, 50] = value
        return channels

    return paint


def with_pixel(value: float) -> Fault:
    """Sets a pixel to what the program itself would refuse to write."""

    def change(folder: Path) -> None:
        rewrite(folder / "wave.0002.exr", lambda pixels, spec: pixels.__setitem__((20, 50, 0), value))

    return filed(change)


def rewrite(path: Path, change: Callable[[np.ndarray, oiio.ImageSpec], None]) -> None:
    """Changes an image's pixels or header in place."""
    source = oiio.ImageInput.open(str(path))
    spec, pixels = source.spec(), source.read_image("float")
    source.close()
    change(pixels, spec)
    output = oiio.ImageOutput.create(str(path))
    if not (output.open(str(path), spec) and output.write_image(pixels) and output.close()):
        raise SystemExit(f"{path}: {output.geterror()}")


def half_depth(pixels: np.ndarray, spec: oiio.ImageSpec) -> None:
    spec.channelformats = ()
    spec.set_format("half")


def swapped(folder: Path) -> None:
    """Frames 2 and 3 change names, and keep the pixels of the other."""
    second, third = folder / "wave.0002.exr", folder / "wave.0003.exr"
    pictures, metadata = zip(*(read_image(path) for path in (second, third)), strict=True)
    save(second, pictures[1], metadata[0])
    save(third, pictures[0], metadata[1])


def truncated(folder: Path) -> None:
    path = folder / "wave.0003.exr"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def duplicated(folder: Path) -> None:
    shutil.copy(folder / "wave.0002.exr", folder / "wave.2.exr")


def without_tile(plane: np.ndarray) -> np.ndarray:
    plane[16:32, 32:48] = 0
    return plane


def nothing(folder: Path) -> None:
    """Leaves everything as it is."""


def some(photons: PhotonMap, kept: np.ndarray) -> PhotonMap:
    return photons.rows(kept)


def displaced(photons: PhotonMap, part: float) -> PhotonMap:
    """Photons that lie a part of a typical footprint's size aside, along their D_u x (long cells are thin there)."""
    size = np.sqrt(np.median(np.linalg.norm(np.cross(photons.dxdu, photons.dxdv), axis=1)))
    along = photons.dxdu / np.linalg.norm(photons.dxdu, axis=1, keepdims=True)
    return replace(photons, position=photons.position + np.float32(part * size) * along)


def flickering(channels: Channels, number: int) -> Channels:
    factor = np.float32(1.015 if number % 2 else 0.985)
    return {name: plane * factor if name[-1] in "RGB" else plane for name, plane in channels.items()}


def over(*path: str, opinion: str) -> str:
    """An opinion on a prim, as text of a layer."""
    text = opinion
    for name in reversed(path):
        text = f'over "{name}"\n{{\n{text}\n}}'
    return text


SURFACE = ("World", "Materials", "Water", "Surface")

FRAME_FAULTS: dict[str, Fault] = {
    "shutter off by half a frame": rendered(shutter=(0.5, 1.0)),
    "shutter open twice as long": rendered(exposure=1.0),
    "no motion blur": rendered(exposure=0.0),
    "D_t x forgotten": rendered(photons=lambda p: replace(p, dxdt=np.zeros_like(p.dxdt))),
    "D_t x twice as long": rendered(photons=lambda p: replace(p, dxdt=2 * p.dxdt)),
    "kernel unnormalised (1/π missing)": rendered(photons=lambda p: replace(p, flux=p.flux / np.float32(np.pi))),
    "footprints three times as wide": rendered(smoothing=3.0),
    "photons half a footprint off": rendered(photons=lambda p: displaced(p, 0.5)),
    "one photon in fifty lost": rendered(photons=lambda p: some(p, p.ids % 50 != 0)),
    "index of refraction wrong by 1 %": rendered(over(*SURFACE, opinion="float inputs:ior = 1.3433")),
    "light 1 % dimmer": rendered(over("World", "Sun", opinion="float inputs:intensity = 0.99")),
    "normals faceted": rendered(over("World", "Water", opinion="normal3f[] normals = None")),
    "a frame swapped with its neighbour": filed(swapped),
    "one hot pixel": painted(placed("R", 100.0)),
    "one NaN": with_pixel(np.nan),
    "one infinity": with_pixel(np.inf),
    "an AOV missing": painted(lambda c, k: {name: plane for name, plane in c.items() if name[:7] != "caustic"}),
    "a setting changed in the metadata": painted(lambda c, k: c, {"tpdwarp:settings": '{"photons": 1}'}),
    "another shutter in the metadata": painted(lambda c, k: c, {"tpdwarp:shutterClose": 9.0}),
    "gamma applied": colors(lambda plane: plane ** np.float32(1 / 2.2)),
    "image flipped left to right": painted(lambda c, k: {n: np.ascontiguousarray(p[:, ::-1]) for n, p in c.items()}),
    "image upside down": painted(lambda c, k: {n: np.ascontiguousarray(p[::-1]) for n, p in c.items()}),
    "one pixel to the right": painted(lambda c, k: {n: np.roll(p, 1, axis=1) for n, p in c.items()}),
    "red 1 % down and blue 1 % up": painted(
        lambda c, k: {**c, "R": c["R"] * np.float32(0.99), "B": c["B"] * np.float32(1.01)}
    ),
    "half in place of float": filed(lambda folder: rewrite(folder / "wave.0001.exr", half_depth)),
    "a frame missing": painted(lambda c, k: None if k == 3 else c),
    "a frame there twice": filed(duplicated),
    "a frame truncated": filed(truncated),
    "a frame black": colors(np.zeros_like, only=2),
    "a tile missing": colors(without_tile, only=2),
    "highlights clipped": colors(lambda plane: np.minimum(plane, np.float32(0.4))),
    "brightness that flickers by 1.5 %": painted(flickering),
    "one row too few": painted(lambda c, k: {name: plane[:-1] for name, plane in c.items()}),
    "depth off by 2 %": painted(lambda c, k: {**c, "Z": c["Z"] * np.float32(1.02)}),
    "alpha lost": painted(lambda c, k: {**c, "A": 0 * c["A"]}),
}
LAYER_FAULTS: dict[str, Fault] = {
    "D_t x of the wrong sign": traced(lambda p: replace(p, dxdt=-p.dxdt)),
    "D_u x and D_v x exchanged": traced(lambda p: replace(p, dxdu=p.dxdv, dxdv=p.dxdu)),
    "stale ids": traced(lambda p: replace(p, ids=np.roll(p.ids, 1))),
    "one photon in fifty lost (layer)": traced(lambda p: some(p, p.ids % 50 != 0)),
    "photons 2 % dimmer": traced(lambda p: replace(p, flux=np.float32(0.98) * p.flux)),
    "photons a tenth of a footprint off": traced(lambda p: displaced(p, 0.1)),
}

# What makes faults, without one: a check that found something here would catch faults for a wrong reason.
NO_FAULTS: dict[str, Fault] = {
    "no fault, rendered": rendered(over("World", opinion="")),
    "no fault, painted": painted(lambda channels, number: channels),
    "no fault, filed": filed(nothing),
}
NO_LAYER_FAULTS: dict[str, Fault] = {"no fault, traced": traced(lambda photons: photons)}


# Most of these take a render each, or a trace; the others cost milliseconds.
FEW = (
    "shutter off by half a frame",
    "D_t x forgotten",
    "one photon in fifty lost",
    "index of refraction wrong by 1 %",
    "light 1 % dimmer",
    "D_t x of the wrong sign",
    "stale ids",
)


def chosen(faults: dict[str, Fault], few: bool) -> dict[str, Fault]:
    """Faults to try: all, or those that cost next to nothing and those of ``FEW``."""
    dear = ("rendered", "traced")
    return {
        name: fault
        for name, fault in faults.items()
        if not few or name in FEW or not fault.__qualname__.startswith(dear)
    }


def found(shot: Shot, name: str, fault: Fault, baseline: Path) -> CheckResult:
    """What a check finds of a fault."""
    folder = shot.folder / f"fault {''.join(filter(str.isalnum, name))}"
    fault(shot, folder)
    try:
        return tpdwarp.check(folder, baseline)
    finally:
        shutil.rmtree(folder)


def honest(shot: Shot, **changes: Any) -> CheckResult:
    """What a check finds of an honest render."""
    folder = shot.folder / "honest render"
    shot.render(folder, **changes)
    try:
        return tpdwarp.check(folder, shot.frames)
    finally:
        shutil.rmtree(folder)


def main() -> int:
    """Prints the table; returns 1 where a fault went unnoticed or an honest render raised an alarm."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20, help="Other seeds rendered honestly. [20]")
    parser.add_argument(
        "--renders", type=int, default=100, help="Renders of the baseline's seed, 1 to 4 threads. [100]"
    )
    parser.add_argument("--width", type=int, default=96, help="Width of the frames in pixels. [96]")
    parser.add_argument("--few", action="store_true", help="Leave out most faults that take a render each.")
    options = parser.parse_args()
    wrong = 0
    with tempfile.TemporaryDirectory() as folder:
        shot = Shot(Path(folder), options.width)
        print((shot.frames / LIMITS_FILE).read_text())
        for name, fault, baseline, faulty in (
            *((name, fault, shot.frames, True) for name, fault in chosen(FRAME_FAULTS, options.few).items()),
            *((name, fault, shot.layer, True) for name, fault in chosen(LAYER_FAULTS, options.few).items()),
            *((name, fault, shot.frames, False) for name, fault in NO_FAULTS.items()),
            *((name, fault, shot.layer, False) for name, fault in NO_LAYER_FAULTS.items()),
        ):
            result = found(shot, name, fault, baseline)
            kinds = ", ".join(dict.fromkeys(finding.kind for frame in result.failed for finding in frame.failures))
            wrong += result.ok == faulty
            verdict = f"caught by {kinds}" if kinds else "passes"
            print(f"{name:44} {verdict}{' – WRONG' if result.ok == faulty else ''}", flush=True)
        for what, count, change in (
            ("other seeds", options.seeds, lambda number: {"seed": 1000 + number}),
            ("other thread counts", options.renders, lambda number: {"threads": 1 + number % 4}),
        ):
            alarms = sum(not honest(shot, **change(number)).ok for number in range(count))
            wrong += alarms
            print(f"{count} honest renders, {what}: {alarms} alarms", flush=True)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
