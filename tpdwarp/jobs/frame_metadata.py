"""What a frame's image file says about how it was made."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np

from tpdwarp.io.float32 import to_float32
from tpdwarp.io.images import FINGERPRINT
from tpdwarp.jobs.existing_frames import STATISTICS, statistics_text
from tpdwarp.jobs.fingerprint import Fingerprint
from tpdwarp.rendering.error_target import ErrorTarget
from tpdwarp.rendering.frame import Frame, Traced
from tpdwarp.scene.description import CameraAtShutter, Shutter
from tpdwarp.settings import Settings
from tpdwarp.usd.read.stage import StageScene
from tpdwarp.version import VERSION
from tpdwarp.view.cryptomatte import metadata_of as cryptomatte_metadata
from tpdwarp.view.object_ids import object_ids


def frame_metadata(
    source: StageScene,
    frame: float,
    shutter: Shutter,
    settings: Settings,
    made: Traced,
    fingerprint: Fingerprint,
    target: ErrorTarget | None = None,
) -> dict[str, Any]:
    """Image attributes of one frame, by their EXR names.

    Camera matrices are at mid shutter, multiply row vectors and follow the definitions of OpenEXR's attributes;
    ``tpdwarp:shutterOpen`` and ``tpdwarp:shutterClose`` are time codes, ``expTime`` is in seconds, fluxes are in watts
    summed over the channels, ``tpdwarp:ids`` says whose the numbers of ``id`` are. At the default time, which is no
    number, whatever depends on it is left out.

    Args:
        source: The stage rendered.
        frame: Which frame it is; NaN for the default time.
        shutter: When it was exposed.
        settings: How it was rendered.
        made: What came out; textures have no camera.
        fingerprint: What the sequence is made from.
        target: What photons and segments were chosen for.
    """
    energy = made.energy
    metadata: dict[str, Any] = {
        "Software": f"tpdwarp {VERSION}",
        "framesPerSecond": source.frames_per_second,
        **(_view_attributes(source, made.camera) if isinstance(made, Frame) else {}),
        "tpdwarp:version": VERSION,
        "tpdwarp:scene": source.file,
        "tpdwarp:settings": json.dumps(settings.as_dict(), sort_keys=True),
        FINGERPRINT: fingerprint.text(frame),
        STATISTICS: statistics_text(len(made.landed), energy, made.seconds),
        "tpdwarp:seed": settings.seed,
        "tpdwarp:renderSeconds": sum(made.seconds.values()),
        "tpdwarp:photonsLanded": len(made.landed),
        "tpdwarp:fluxSent": float(to_float32(energy.sent)),
        "tpdwarp:fluxDeposited": float(to_float32(energy.deposited)),
        "tpdwarp:fluxEscaped": float(to_float32(energy.escaped)),
        "tpdwarp:fluxAbsorbed": float(to_float32(energy.absorbed)),
        "tpdwarp:fluxLost": float(to_float32(energy.lost_total)),
    }
    if "id" in settings.aovs:
        numbers = object_ids(made.landed.receiver_paths)
        metadata["tpdwarp:ids"] = json.dumps({str(number): path for path, number in numbers.items()})
    if "cryptomatte" in settings.aovs:
        metadata |= cryptomatte_metadata(made.landed.receiver_paths)
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


def _view_attributes(source: StageScene, camera: CameraAtShutter) -> dict[str, Any]:
    """The shape of pixels, and the camera's matrices as OpenEXR defines them: looks along +z, NDC (0, 0) is upper left.
    """
    attributes: dict[str, Any] = {"PixelAspectRatio": source.pixel_aspect, "tpdwarp:camera": camera.path}
    if camera.world_to_camera is not None:
        attributes["worldToCamera"] = camera.world_to_camera @ np.diag([1.0, 1.0, -1.0, 1.0])
    if camera.world_to_ndc is not None:
        to_image = np.array([[0.5, 0, 0, 0], [0, -0.5, 0, 0], [0, 0, 1, 0], [0.5, 0.5, 0, 1]])
        attributes["worldToNDC"] = camera.world_to_ndc @ to_image
    return attributes
