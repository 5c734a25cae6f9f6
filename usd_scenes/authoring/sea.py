"""The bottom of a shallow sea: a net of light under three waves that cross."""

from __future__ import annotations

from pathlib import Path

from usd_scenes.authoring.scene_writer import SceneWriter
from usd_scenes.authoring.surfaces import PlaneWave, grid_quads, water_at

LEVEL = 1.0
WATER_SIZE = 2.4
GAP_BELOW_TROUGHS = 0.02
# Size relative to the longest wave, and heading in degrees.
TRAIN = ((1.0, 15.0), (0.77, 85.0), (0.62, -40.0))


def write_sea(
    path: Path,
    amplitude: float = 0.06,
    wavelength: float = 1.0,
    speed: float = 1.0 / 8,
    frames: int = 24,
    resolution: int = 101,
) -> None:
    """Writes three crossing waves of one steepness and one period, so that the animation is a loop.

    Args:
        path: The layer to write.
        amplitude: Height of the longest wave, in scene units.
        wavelength: Of the longest wave, in scene units.
        speed: Of the longest wave, in scene units a frame.
        frames: Frames, from 1.
        resolution: Vertices along x and along y.

    Raises:
        ValueError: The waves touch the floor, or a count is too small.
    """
    reach = amplitude * sum(share for share, _ in TRAIN)
    if not 0 <= reach < LEVEL - 2 * GAP_BELOW_TROUGHS:
        raise ValueError(f"--amplitude must be at least 0, and small enough not to reach the floor, not {amplitude}")
    options = {"amplitude": amplitude, "wavelength": wavelength, "speed": speed}
    writer = SceneWriter(frames, options)
    water = writer.material(
        "Water", diffuseColor=(0.0, 0.0, 0.0), metallic=0.0, opacity=0.0, ior=1.33, roughness=0.0
    )
    mesh = writer.mesh("/World/Water", [grid_quads(resolution, resolution)], water)
    waves = [
        PlaneWave(amplitude * share, wavelength * share, speed * share, heading) for share, heading in TRAIN
    ]
    for time in writer.times:
        shape = water_at(time - writer.times[0], waves, LEVEL, WATER_SIZE, resolution, resolution)
        writer.shape(mesh, *shape, time)
    writer.floor(size=8.0, albedo=0.7)
    writer.sun(irradiance=1.0)
    below = LEVEL - reach - GAP_BELOW_TROUGHS
    writer.measuring_camera((0.0, 0.0, below), size=2.0)
    writer.camera(eye=(-0.75, -0.65, 0.98 * below), target=(-0.35, -0.25, 0.0), field_of_view=76.0, exposure=0.5)
    writer.save(path)
