"""What a frame's image file says about how it was made."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

import numpy as np

import tpdwarp
from tpdwarp.io.float32 import single
from tpdwarp.rendering.error_target import ErrorTarget
from tpdwarp.scene.description import CameraAtShutter, Shutter
from tpdwarp.settings import Settings

if TYPE_CHECKING:
    from tpdwarp.rendering.frame import Frame
    from tpdwarp.usd.read.stage import StageScene


def frame_metadata(
    source: StageScene,
    frame: float,
    shutter: Shutter,
    settings: Settings,
    made: Frame,
    target: ErrorTarget | None = None,
) -> dict[str, Any]:
    """Image attributes of one frame, by their EXR names.

    Camera matrices are at mid shutter, multiply row vectors and follow the definitions of OpenEXR's attributes;
    ``tpdwarp:shutterOpen`` and ``tpdwarp:shutterClose`` are time codes, ``expTime`` is in seconds, fluxes are in watts
    summed over the channels. At the default time, which is no number, whatever depends on it is left out.

    Args:
        source: The stage rendered.
        frame: Which frame it is; NaN for the default time.
        shutter: When it was exposed.
        settings: How it was rendered.
        made: What came out.
        target: What photons and segments were chosen for.
    """
    energy = made.energy
    metadata: dict[str, Any] = {
        "Software": f"tpdwarp {tpdwarp.__version__}",
        "framesPerSecond": source.frames_per_second,
        "PixelAspectRatio": source.pixel_aspect,
        **_camera_attributes(made.camera),
        "tpdwarp:version": tpdwarp.__version__,
        "tpdwarp:scene": source.file,
        "tpdwarp:settings": json.dumps(settings.as_dict(), sort_keys=True),
        "tpdwarp:seed": settings.seed,
        "tpdwarp:renderSeconds": sum(made.seconds.values()),
        "tpdwarp:photons": len(made.photons),
        "tpdwarp:fluxSent": float(single(energy.sent)),
        "tpdwarp:fluxDeposited": float(single(energy.deposited)),
        "tpdwarp:fluxEscaped": float(single(energy.escaped)),
        "tpdwarp:fluxAbsorbed": float(single(energy.absorbed)),
        "tpdwarp:fluxLost": float(single(energy.lost_total)),
    }
    if target is not None:
        metadata |= {"tpdwarp:targetError": target.wanted, "tpdwarp:expectedError": target.expected}
    if not math.isnan(frame):
        metadata |= {
            "expTime": shutter.exposure / source.time_codes_per_second,
            "tpdwarp:frame": frame,
            "tpdwarp:shutterOpen": shutter.open,
            "tpdwarp:shutterClose": shutter.close,
        }
    return metadata


def _camera_attributes(camera: CameraAtShutter) -> dict[str, Any]:
    """The camera's matrices as OpenEXR defines these attributes: looks along +z, NDC (0, 0) is upper left."""
    attributes: dict[str, Any] = {"tpdwarp:camera": camera.path}
    if camera.world_to_camera is not None:
        attributes["worldToCamera"] = camera.world_to_camera @ np.diag([1.0, 1.0, -1.0, 1.0])
    if camera.world_to_ndc is not None:
        to_image = np.array([[0.5, 0, 0, 0], [0, -0.5, 0, 0], [0, 0, 1, 0], [0.5, 0.5, 0, 1]])
        attributes["worldToNDC"] = camera.world_to_ndc @ to_image
    return attributes
