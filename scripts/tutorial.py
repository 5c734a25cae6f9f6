"""A tour for researchers, cell by cell: trace photons, look at their Jacobians, splat them, compare with the program.

    .venv/bin/python scripts/tutorial.py

Each ``# %%`` begins a cell, which editors (VS Code, Spyder, PyCharm, Jupytext) run one by one.
"""

# %% The scene: a wave of water over a floor, lit straight from above. It stays open from frame to frame.
from pathlib import Path

import numpy as np

import tpdwarp

FRAME = 2
WAVE = Path(__file__).resolve().parent.parent / "usd_scenes" / "wave.usdc"
# Of a still, so that a photon's footprint stands where the photon is.
scene = tpdwarp.Scene(WAVE, photons=16384, exposure=0.0)
print(scene, "with", len(scene.frames), "frames")

# %% Photons: each is a beam that landed on the floor, with the derivatives of the place where it did.
photons = scene.trace_photons(FRAME)
print(f"{len(photons)} photons carry {photons.flux.sum(axis=0)} W")

# %% Jacobians: J = [D_u x, D_v x] says how far photons that start a lattice step apart land from each other. A photon
# shares its flux over the cell |D_u x × D_v x|, and so the caustic is bright where that is small.
cells = np.linalg.norm(np.cross(photons.dxdu, photons.dxdv), axis=1)
print(f"cells from {cells.min():.2e} to {cells.max():.2e} square units; concentration {cells.max() / cells.min():.0f}")

# %% The time column: D_t x is where a photon goes while the shutter is open. A photon rides on the point of the water
# that it passed. That goes up and down, and where it lands the photon swings to and fro: the bands of light go to the
# right with the wave, though no photon goes with them.
moving = scene.trace_photons(FRAME, exposure=1.0, segments=1)
ways = moving.dxdt[:, 0]
print(f"photons go {ways.mean():.3f} ± {ways.std():.3f} units along x within the shutter")

# %% Splatting by hand: what photons leave on a strip of the floor, by a uniform kernel over each photon's cell. Nothing
# changes along y, so that a cell is as wide as D_u x and D_v x go along x.
EDGES = np.linspace(-1.0, 1.0, 65)
near = np.abs(photons.positions[:, 1]) < 0.5
x, flux = photons.positions[near, 0], photons.flux[near, 1]
half = 0.5 * (np.abs(photons.dxdu[near, 0]) + np.abs(photons.dxdv[near, 0]))
# The part of each photon's cell, from x − half to x + half, that lies in each bin.
low, high = EDGES[:-1, None], EDGES[1:, None]
shares = np.clip(np.minimum(high, x + half) - np.maximum(low, x - half), 0.0, None) / (2.0 * half)
splatted = (shares * flux).sum(axis=1) / (EDGES[1] - EDGES[0])

# %% The program's own irradiance at the same places: each value is the mean over a square as wide as a bin.
middles = 0.5 * (EDGES[1:] + EDGES[:-1])
points = np.stack([middles, np.zeros(64), np.zeros(64)], axis=1)
normals = np.tile([0.0, 0.0, 1.0], (64, 1))
computed = scene.irradiance(FRAME, points, normals, spacing=EDGES[1] - EDGES[0])[:, 1]

# %% The two agree but for the kernel: the program's is the B-spline, smoother and as wide as the cell on the whole.
difference = np.sqrt(np.mean((splatted - computed) ** 2)) / computed.mean()
print(f"splatted by hand and computed differ by {difference:.1%} of the mean")
