"""A case: a mutated stage on disk and a command line, both made from one number."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from random import Random

from pxr import Sdf, Tf

from usd_scenes.hostile.mutations import mutate_bytes, mutate_layer, mutate_text
from usd_scenes.hostile.stages import HANDMADE, SCENES, SHIPPED

_QUICK = ["--photons", "200", "--samples", "1", "--progress", "plain"]
_SETTINGS = [
    line.split()
    for line in """


    --motion cubic
    --exposure 1
    --shutter -1.5 2
    --segments 2
    --segments auto
    --emission jittered
    --kernel epanechnikov --footprint swept
    --trace-at open
    --anchor light
    --estimator pd
    --estimator tdpm --tdpm-between 2
    --estimator accumulation --accumulation-times 3
    --estimator distribution --accumulation-times 4
    --default-time
    """.splitlines()
]
_AOVS = ([], ["--aov", "caustic,direct,irradiance,Z,N,P,motion,photons"])


@dataclass(frozen=True)
class Case:
    """What is run.

    Attributes:
        seed: The number it is made from.
        stage: The stage's file.
        changes: What was done to the stage.
        arguments: The command line.
        pictures: Names of the images and the layers that a success must leave, as patterns.
        statistics: The statistics file it is asked for, or None.
    """

    seed: int
    stage: Path
    changes: tuple[str, ...]
    arguments: tuple[str, ...]
    pictures: tuple[str, ...]
    statistics: Path | None


@cache
def _text(name: str) -> str:
    return HANDMADE[name]


@cache
def _bytes(name: str) -> bytes:
    return (SCENES / f"{name}.usdc").read_bytes()


def make_case(seed: int, folder: Path, binary: bool = False) -> Case:
    """Writes the stage of case ``seed`` to ``folder``.

    Args:
        binary: Whether the bytes of binary layers may be changed: that tries USD's own reader more than ours.
    """
    random = Random(seed)
    stage, changes = _mutated(random, folder, seed, binary)
    command = random.choices(("render", "photons", "info"), (6, 2, 2))[0]
    arguments, pictures, statistics = [command, str(stage)], [], None
    if command == "info":
        arguments += random.choice(([], ["--json"]))
        arguments += random.choice(([], ["--exposure", "1"], ["--motion", "cubic"], ["-d"]))
        return Case(seed, stage, changes, tuple(arguments), (), None)
    statistics = folder / f"{seed}.json"
    if command == "render":
        arguments += ["", *random.choice(_AOVS), *_width(random, changes[0])]
        pictures.append(f"{seed}.*.exr")
        if random.random() < 0.2:
            arguments += ["--debug-layer", str(folder / f"{seed}.debug.usdc")]
            pictures.append(f"{seed}.debug.usdc")
    else:
        arguments.append(str(folder / f"{seed}.debug.usda"))
        pictures.append(f"{seed}.debug.usda")
    chosen = random.choice(_SETTINGS)
    if command == "render":
        # The default time has no number.
        arguments[2] = str(folder / (f"{seed}.0.exr" if "--default-time" in chosen else f"{seed}.####.#.exr"))
    arguments += [*chosen, *_QUICK[: 2 if command == "photons" else 4], "--stats", str(statistics)]
    if "--default-time" not in chosen:
        whole = [[], []] if changes[0] in HANDMADE else []
        arguments += random.choice([*whole, ["-f", "2"], ["-f", "1,2.5"], ["-f", "-5:40x22"]])
    return Case(seed, stage, changes, tuple(arguments), tuple(pictures), statistics)


def _width(random: Random, name: str) -> list[str]:
    """Small pictures, except where the stage asks for a size of its own."""
    return [] if name == "water" and random.random() < 0.5 else ["-w", "16"]


def _mutated(random: Random, folder: Path, seed: int, binary: bool) -> tuple[Path, tuple[str, ...]]:
    name = random.choice(tuple(HANDMADE))
    how = random.choices(("layer", "text", "shipped", "bytes"), (70, 15, 15, 4 if binary else 0))[0]
    if how == "text":
        text, done = mutate_text(random, _text(name))
        stage = folder / f"{seed}.usda"
        stage.write_text(text, encoding="utf-8", errors="replace")
        return stage, (name, *done)
    if how == "bytes":
        name = random.choice(("cylinder", "mirror"))
        data, done = mutate_bytes(random, _bytes(name))
        stage = folder / f"{seed}.usdc"
        stage.write_bytes(data)
        return stage, (name, *done)
    layer = Sdf.Layer.CreateAnonymous(".usda")
    if how == "shipped":
        name = random.choices(SHIPPED, (10, 10, 4, 1))[0]
        layer.TransferContent(Sdf.Layer.FindOrOpen(str(SCENES / f"{name}.usdc")))
    else:
        layer.ImportFromString(_text(name))
    done = mutate_layer(random, layer)
    stage = folder / f"{seed}.{'usdc' if how == 'shipped' else random.choice(('usda', 'usdc'))}"
    with suppress(Tf.ErrorException):
        # What cannot be stored is left out.
        layer.Export(str(stage))
    return stage, (name, *done)
