"""A travelling sinusoid of water over a floor: bands of light that move with the wave."""

from __future__ import annotations

from pathlib import Path

from usd_scenes.authoring.scene_writer import SceneWriter
from usd_scenes.authoring.surfaces import PlaneWave, grid_quads, water_at

LEVEL = 1.0
WATER_SIZE = 4.0
GAP_BELOW_TROUGHS = 0.02


def write_wave(
    path: Path,
    amplitude: float = 0.08,
    wavelength: float = 1.3,
    speed: float = 1.3 / 8,
    frames: int = 24,
    resolution: int = 769,
) -> None:
    """Writes z = 1 + amplitude·cos(2π/wavelength·(x − speed·(frame − 1))) as an open water interface.

    Args:
        path: The layer to write.
        amplitude: Height of the crests over z = 1, in scene units.
        wavelength: In scene units.
        speed: Scene units a frame.
        frames: Frames, from 1.
        resolution: Vertices along x; nothing varies along y, so that two rows do.

    Raises:
        ValueError: The wave touches the floor, or a count is too small.
    """
    if not 0 <= amplitude < LEVEL - 2 * GAP_BELOW_TROUGHS:
        raise ValueError(f"--amplitude must be at least 0 and below {LEVEL - 2 * GAP_BELOW_TROUGHS}, not {amplitude}")
    options = {"amplitude": amplitude, "wavelength": wavelength, "speed": speed}
    writer = SceneWriter(frames, options)
    water = writer.material(
        "Water", diffuseColor=(0.0, 0.0, 0.0), metallic=0.0, opacity=0.0, ior=1.33, roughness=0.0
    )
    mesh = writer.mesh("/World/Water", [grid_quads(resolution, 2)], water)
    waves = [PlaneWave(amplitude, wavelength, speed)]
    for time in writer.times:
        writer.shape(mesh, *water_at(time - writer.times[0], waves, LEVEL, WATER_SIZE, resolution, 2), time)
    writer.floor(size=8.0, albedo=0.8)
    writer.sun(irradiance=1.0)
    below = LEVEL - amplitude - GAP_BELOW_TROUGHS
    writer.measuring_camera((0.0, 0.0, below), size=2.0)
    # Under water, so that the floor is seen straight and the rim of the water's square stays out of the picture.
    writer.camera(eye=(-1.7, -1.45, 0.98 * below), target=(-0.9, -0.85, 0.0), field_of_view=74.0, exposure=0.5)
    writer.save(path)
