"""tpdwarp renders USD animations with motion-blurred caustics from one photon trace a frame.

    import tpdwarp

    result = tpdwarp.render("wave.usdc", "out/wave.####.exr", frames="1:24", exposure=1.0)
    photons = tpdwarp.trace_photons("wave.usdc", 12)
    measured = tpdwarp.study("wave.usdc", report="study.html")
    differences = tpdwarp.check("out", "baseline", report="report.html")
    result = tpdwarp.farm("wave.usdc", "out/wave.####.exr", scheduler="tcp://host:8786")
    holdings = tpdwarp.info("wave.usdc")
    pixels = tpdwarp.render_frame("wave.usdc", 12).channels
    result = tpdwarp.bake("wave.usdc", "out/caustic.####.exr", receiver="/World/Floor")
    scene = tpdwarp.Scene("wave.usdc")  # stays open from frame to frame

Names load what they need when they are first used, so that importing the package costs next to nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from tpdwarp.loading import collector_paused
from tpdwarp.version import VERSION

if TYPE_CHECKING:
    from tpdwarp.checks.findings import CheckResult
    from tpdwarp.checks.run import check
    from tpdwarp.errors import FrameError, InputError
    from tpdwarp.farms.farm import farm
    from tpdwarp.farms.open_job import open_job_template
    from tpdwarp.jobs.bake import bake
    from tpdwarp.jobs.live_scene import RenderedFrame, Scene, irradiance, render_frame
    from tpdwarp.jobs.results import FrameOutcome, SequenceResult
    from tpdwarp.jobs.sequence import render, trace_photons, write_photons
    from tpdwarp.jobs.stage_info import info
    from tpdwarp.settings import Settings
    from tpdwarp.studies.cases import Sweep
    from tpdwarp.studies.result import StudyResult
    from tpdwarp.studies.run import study
    from tpdwarp.studies.truth import TruthSettings

__version__ = VERSION

__all__ = [
    "CheckResult",
    "FrameError",
    "FrameOutcome",
    "InputError",
    "RenderedFrame",
    "Scene",
    "SequenceResult",
    "Settings",
    "StudyResult",
    "Sweep",
    "TruthSettings",
    "bake",
    "check",
    "farm",
    "info",
    "irradiance",
    "open_job_template",
    "render",
    "render_frame",
    "study",
    "trace_photons",
    "write_photons",
]

_HOMES = {
    "CheckResult": "tpdwarp.checks.findings",
    "FrameError": "tpdwarp.errors",
    "FrameOutcome": "tpdwarp.jobs.results",
    "InputError": "tpdwarp.errors",
    "RenderedFrame": "tpdwarp.jobs.live_scene",
    "Scene": "tpdwarp.jobs.live_scene",
    "SequenceResult": "tpdwarp.jobs.results",
    "Settings": "tpdwarp.settings",
    "StudyResult": "tpdwarp.studies.result",
    "Sweep": "tpdwarp.studies.cases",
    "TruthSettings": "tpdwarp.studies.truth",
    "bake": "tpdwarp.jobs.bake",
    "check": "tpdwarp.checks.run",
    "farm": "tpdwarp.farms.farm",
    "info": "tpdwarp.jobs.stage_info",
    "irradiance": "tpdwarp.jobs.live_scene",
    "open_job_template": "tpdwarp.farms.open_job",
    "render": "tpdwarp.jobs.sequence",
    "render_frame": "tpdwarp.jobs.live_scene",
    "study": "tpdwarp.studies.run",
    "trace_photons": "tpdwarp.jobs.sequence",
    "write_photons": "tpdwarp.jobs.sequence",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    with collector_paused():
        value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
