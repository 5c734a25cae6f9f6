"""Rounding: photons traced in single precision against the float64 oracle, on the same triangles and lattice.

    .venv/bin/python -m tests.rounding        # the table of docs/rounding.md; --json FILE also keeps it
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path as FilePath

import numpy as np

from tests.photons.moving_scenes import GRID, flying_ball, turning_prism, walls, wave
from tests.photons.oracle_comparison import reference
from tests.photons.shapes import floor, glass, mesh, moving, ripples
from tests.photons.traced import Traced, emission_of, lamp, scene_of, sun, traced
from tests.properties.placed import placed
from tpdwarp.scene.description import Interaction, LightKind, SceneAtShutter, Shutter
from tpdwarp.settings import Settings
from tpdwarp.usd.read.stage import StageScene
from usd_scenes.oracle import Path, surfaces_of

ROOT = FilePath(__file__).resolve().parents[1]
PHOTONS = 1500
COMPARED = 120
QUANTITIES = ("position", "D_u x", "D_v x", "D_t x", "footprint axes", "flux", "irradiance")


def shipped(name: str) -> SceneAtShutter:
    """A shipped scene over a shutter of one frame in the middle of its animation."""
    stage = StageScene.open(ROOT / "usd_scenes" / f"{name}.usdc", Settings())
    frame = math.floor(0.5 * (stage.start + stage.end))
    return stage.at(Shutter(frame, frame, frame + 1))


def wedge(before_critical: float) -> SceneAtShutter:
    """Light that leaves a moving wedge of glass ``before_critical`` radians short of total reflection."""
    slope = math.tan(math.asin(1 / 1.5) - before_critical)
    low, high, near = -0.3 * slope, 0.3 * slope, 0.4
    points = [(x, y, z) for y in (-0.3, 0.3) for x, z in ((-0.3, low), (0.3, high), (0.3, near), (-0.3, near))]
    points = np.add(points, (0.0, 0.0, 1.0))
    sides = [(0, 1, 2, 3), (7, 6, 5, 4), (4, 5, 1, 0), (5, 6, 2, 1), (6, 7, 3, 2), (7, 4, 0, 3)]
    triangles = [t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))]
    body = mesh("/wedge", points, triangles, glass())
    return scene_of([moving(body, (0.02, 0.01, 0.03)), *walls()], sun())


def grazing(from_plane: float) -> SceneAtShutter:
    """Light on gentle ripples, ``from_plane`` radians above the horizon."""
    water = ripples(GRID, GRID, 1.0, 0.05 * from_plane, glass(1.33), True)
    return scene_of([water, floor()], sun((math.cos(from_plane), 0.0, -math.sin(from_plane))))


def far_lamp(distance: float) -> SceneAtShutter:
    """Water under a lamp ``distance`` scene units away, as bright there as one at three."""
    light = lamp((0.3 * distance / 3, 0.1 * distance / 3, distance), (0.1, -0.1, 0.2), intensity=(distance / 3) ** 2)
    return wave(True, light)


SCENES: dict[str, Callable[[], SceneAtShutter]] = {
    "wave": lambda: shipped("wave"),
    "cylinder": lambda: shipped("cylinder"),
    "mirror": lambda: shipped("mirror"),
    "sea": lambda: shipped("sea"),
    "ripples": lambda: wave(True),
    "turning prism": turning_prism,
    "ball lens": lambda: flying_ball(glass(), cells=16),
    "10⁵ units off": lambda: placed(wave(True), shift=(1e5, -1e5, 1e5)),
    "in units of 10⁻⁶": lambda: placed(wave(True), scale=1e-6),
    "in units of 10⁶": lambda: placed(wave(True), scale=1e6),
    "grazing by 10⁻²": lambda: grazing(1e-2),
    "grazing by 10⁻³": lambda: grazing(1e-3),
    "10⁻² from critical": lambda: wedge(1e-2),
    "10⁻⁴ from critical": lambda: wedge(1e-4),
    "lamp at 10²": lambda: far_lamp(1e2),
    "lamp at 10⁴": lambda: far_lamp(1e4),
}


def errors(scene: SceneAtShutter) -> dict[str, np.ndarray]:
    """Relative errors of each quantity, one a photon compared.

    Positions are relative to the size of what photons fall on, the rest to itself (D_t x at least to a hundredth of
    its root mean square, since it passes through zero). Photons within 2·10⁻⁴ of an edge are left out: they may meet
    the neighbouring triangle.
    """
    # One light, so that its photons can be told by their numbers alone.
    result = traced(replace(scene, lights=scene.lights[:1]), PHOTONS)
    rows = np.flatnonzero(result.masks == 0)
    rows = rows[np.linspace(0, len(rows) - 1, min(COMPARED, len(rows))).astype(int)]
    exact, away = reference(result, rows)
    photons = result.pick(rows[away])
    path = exact.path.rays(away)
    truth = {name: getattr(exact, name)[away] for name in ("dxdu", "dxdv", "dxdt_relative")}
    size = np.ptp(path.positions, axis=0).max()
    flux = emitted(result, rows[away]) * path.throughput * tints(scene, path)
    found = {"position": np.linalg.norm(photons.positions - path.positions, axis=1) / size}
    for name, rows_ in (("D_u x", photons.dxdu), ("D_v x", photons.dxdv), ("D_t x", photons.dxdt)):
        expected = truth["dxd" + name[2] + ("_relative" if name[2] == "t" else "")]
        length = np.linalg.norm(expected, axis=1)
        floor_ = 0.01 * np.sqrt(np.mean(length**2)) if name[2] == "t" else 0.0
        found[name] = np.linalg.norm(rows_ - expected, axis=1) / np.maximum(length, floor_)
    axes, exact_axes = semi_axes(photons.dxdu, photons.dxdv), semi_axes(truth["dxdu"], truth["dxdv"])
    found["footprint axes"] = (np.abs(axes - exact_axes) / exact_axes).max(axis=1)
    carried = photons.flux[:, 0]
    found["flux"] = np.abs(carried / flux - 1)
    area, exact_area = axes.prod(axis=1), exact_axes.prod(axis=1)
    found["irradiance"] = np.abs((carried / area) / (flux / exact_area) - 1)
    return found


def semi_axes(dxdu: np.ndarray, dxdv: np.ndarray) -> np.ndarray:
    """Semi-axes of footprints, longest first, shape [n, 2]."""
    return 0.5 * np.linalg.svd(np.stack([dxdu, dxdv], axis=2), compute_uv=False)


def emitted(result: Traced, rows: np.ndarray) -> np.ndarray:
    """Flux of the lattice cells of photons in the first channel [W], double precision; one light of one lattice."""
    (light,), lattice = result.scene.lights, result.plan.lattices[0]
    area = lattice.step[0] * lattice.step[1]
    if light.kind == LightKind.DISTANT:
        return np.full(len(rows), light.power[0] * area / result.plan.normalization.scale**2)
    directions = emission_of(result, rows=rows)[1] @ lattice.axes.T
    u, v = directions[:, 0] / directions[:, 2], directions[:, 1] / directions[:, 2]
    return light.power[0] * area * (1 + u**2) * (1 + v**2) / (1 + u**2 + v**2) ** 1.5


def tints(scene: SceneAtShutter, path: Path) -> np.ndarray:
    """What the mirrors on each photon's way leave of the first channel, shape [n]."""
    colors = np.ones(len(surfaces_of(scene)))
    names = [surface.name for surface in surfaces_of(scene)]
    for one in scene.meshes:
        for material in one.materials:
            if material.interaction == Interaction.MIRROR:
                colors[names.index(one.path)] = material.color[0]
    met = np.where(np.arange(len(path.surfaces))[:, None] < path.bounces, path.surfaces, -1)
    return np.where(met >= 0, colors[met], 1.0).prod(axis=0)


def documented(document: FilePath) -> dict[str, dict[str, tuple[float, float]]]:
    """Median and worst relative error by scene and quantity, as the table of ``document`` states them."""
    rows = [line.strip("| \n").split(" | ") for line in document.read_text().splitlines() if line.startswith("| ")]
    header, *rows = rows
    return {
        name: {
            quantity: tuple(map(float, cell.split())) for quantity, cell in zip(header[1:], cells, strict=True)
        }
        for name, *cells in rows
    }


def main() -> None:
    """Prints median and worst relative error of each quantity on each scene, as the table of docs/rounding.md."""
    parser = argparse.ArgumentParser(description="Measures the rounding of photons.")
    parser.add_argument("--json", type=FilePath, help="also write the results to this file")
    options = parser.parse_args()
    results = []
    print("| scene | " + " | ".join(QUANTITIES) + " |")
    print("|---|" + "---|" * len(QUANTITIES))
    for name, make in SCENES.items():
        found = errors(make())
        row = {quantity: (float(np.median(found[quantity])), float(found[quantity].max())) for quantity in QUANTITIES}
        print(f"| {name} | " + " | ".join(f"{a:.0e} {b:.0e}" for a, b in row.values()) + " |", flush=True)
        results.append({"scene": name, "photons": len(found["flux"]), **row})
    if options.json:
        options.json.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
