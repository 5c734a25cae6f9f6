"""How much memory a frame will need, known before it is begun."""

from __future__ import annotations

from dataclasses import dataclass

from tpdwarp.errors import InputError
from tpdwarp.photons.strips import PHOTONS_OF_STRIP
from tpdwarp.scene.description import SceneSource, Shutter
from tpdwarp.settings import Settings

# Peaks of whole processes, as printed by scripts/benchmarks/run.py memory. Libraries and kernels, before anything is
# read:
BYTES_AT_REST = 330e6
# Arrays of the stage, of the tracer and the tree over them.
BYTES_A_TRIANGLE = 1140.0
# Rows of two photon maps at a time, keyframes, footprints and the tree over them.
BYTES_A_PHOTON = 1200.0
# Of photons of earlier strips of the light nothing is left but these, where they are wanted themselves.
BYTES_A_KEPT_PHOTON = 250.0
# Visible points of a batch, sums and channels of the film.
BYTES_A_PIXEL = 430.0


@dataclass(frozen=True)
class FrameNeed:
    """What a frame is made of, and the memory that it will need.

    Attributes:
        triangles: Triangles, those of all instances counted.
        photons: Photons that are sent.
        pixels: Pixels of the image; 0 where photons are only traced.
        at_once: Photons that are traced and looked up at once; of a render that also writes a debug layer all are kept
            besides, which is not counted.
    """

    triangles: int
    photons: int
    pixels: int
    at_once: int

    @property
    def bytes(self) -> float:
        """Bytes of memory at most, about; within a factor of two on the scenes that were measured."""
        parts = BYTES_A_TRIANGLE * self.triangles + BYTES_A_PHOTON * self.at_once + BYTES_A_PIXEL * self.pixels
        if not self.pixels:
            parts += BYTES_A_KEPT_PHOTON * (self.photons - self.at_once)
        return BYTES_AT_REST + parts

    def __str__(self) -> str:
        pixels = f", {self.pixels} pixels" if self.pixels else ""
        return f"{self.bytes / 2**30:.3g} GB of memory ({self.triangles} triangles, {self.photons} photons{pixels})"


def need_of(
    source: SceneSource, shutter: Shutter, settings: Settings, pixels: int, *, shared: bool = False
) -> FrameNeed:
    """What the frame over ``shutter`` will need.

    Args:
        pixels: Of the image; 0 where photons are only traced.
        shared: Whether several images look up the same photons, so that all are kept.

    Raises:
        InputError: The scene cannot be used there.
    """
    meshes = source.at(Shutter(shutter.frame, shutter.middle, shutter.middle)).meshes
    in_strips = settings.estimator == "tpd" and not shared
    at_once = min(settings.photons, PHOTONS_OF_STRIP) if in_strips else settings.photons
    return FrameNeed(sum(len(mesh.triangles) for mesh in meshes), settings.photons, pixels, at_once)


def refuse_beyond(need: FrameNeed, allowed: float, file: str) -> None:
    """Refuses a frame that needs more memory than it may have.

    Raises:
        InputError: It does.
    """
    if need.bytes > allowed:
        raise InputError(
            f"a frame would need about {need}, and {allowed / 2**30:.3g} may be taken (fewer --photons, a smaller "
            "--imageWidth, --mask, or more --max-memory)",
            file=file,
        )
