"""Baking sequences: light on receivers as textures over their coordinates, and a layer that binds these to them."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import asdict, replace
from numbers import Integral
from pathlib import Path
from typing import Any

from tpdwarp.errors import FrameError, InputError, logger
from tpdwarp.io.files import file_name
from tpdwarp.jobs.bake_work import AtlasStore, BakeSettings, BakeWork, Receiver, receivers_of
from tpdwarp.jobs.fingerprint import Fingerprint
from tpdwarp.jobs.frame_loop import FrameLoop, Persistence, reason_of
from tpdwarp.jobs.frame_work import LazyContext
from tpdwarp.jobs.opening import FilePath, Frames, chosen_settings, opened, shutter_of
from tpdwarp.jobs.outputs import prepare_outputs
from tpdwarp.jobs.plan import SequencePlan
from tpdwarp.jobs.progress import Progress, progress_of
from tpdwarp.jobs.reports import SequenceReports
from tpdwarp.jobs.results import SequenceResult
from tpdwarp.jobs.sequence import planned
from tpdwarp.jobs.stage_files import StageFiles
from tpdwarp.jobs.texture_names import TextureNames, light_layer_path
from tpdwarp.rendering.baking import QUANTITIES
from tpdwarp.usd.read.stage import StageLike
from tpdwarp.usd.write.light_layer import BoundTexture, write_light_layer


def bake(
    scene: StageLike,
    out: FilePath,
    *,
    receiver: str | Sequence[str] | None = None,
    uv: str = "st",
    resolution: int = 1024,
    what: str = "irradiance",
    gutter: int = 8,
    frames: Frames = None,
    default_time: bool = False,
    progress: str | Progress | None = None,
    stats: FilePath | None = None,
    skip_existing: bool = False,
    strict: bool = False,
    frame_timeout: float | None = None,
    retries: int = 0,
    max_failures: int | None = None,
    max_memory: float | None = None,
    **settings: Any,
) -> SequenceResult:
    """Bakes the light that photons leave on receivers as textures over their coordinates.

    The light rides with surfaces that move or bend, and light on both sides of one is added up. Beside the textures of
    light a layer (``caustic.light.usda`` for ``caustic.####.exr``) shows them on their receivers in the scene.

    Args:
        scene: The stage: a file, an ``Sdf.Layer`` or a ``Usd.Stage``.
        out: EXR file, with ``####`` where the frame number goes, and ``<UDIM>`` where that of a tile does. See
            :class:`tpdwarp.jobs.texture_names.TextureNames`.
        receiver: Meshes, or prims above them; None for the meshes that photons land on in the first frame.
        uv: Primvar of texture coordinates. Meshes without it are projected along their thinnest axis.
        resolution: Texels along each side of a tile.
        what: ``irradiance`` [W/m²], ``caustic`` (radiance: albedo/π × irradiance) or ``motion`` (flux-weighted mean of
            D_t x over the shutter [scene units]).
        gutter: How far beyond charts texels are filled.
        frames, default_time, progress, stats, skip_existing, strict, frame_timeout, retries, max_failures,
            max_memory: As for :func:`tpdwarp.render`.
        **settings: Fields of :class:`tpdwarp.settings.Settings`.

    Raises:
        InputError: The input or the settings cannot be used, or no frame at all could be baked because of the input.
    """
    started, begun = time.perf_counter(), time.time()
    single = isinstance(receiver, str) or hasattr(receiver, "pathString")
    listed = () if receiver is None else (receiver,) if single else receiver
    # Paths of USD's own are as good as their texts.
    wanted = BakeSettings(tuple(map(str, listed)), uv, _whole(resolution), what, _whole(gutter))
    if what not in QUANTITIES:
        raise InputError(f"--what must be one of {', '.join(QUANTITIES)}, not {what!r}")
    if not file_name(out).lower().endswith(".exr"):
        raise InputError("light needs the range of .exr (name the textures so)", file=file_name(out))
    persistence, shown = Persistence(frame_timeout, retries, max_failures), progress_of(progress)
    chosen = chosen_settings(settings)
    source, times = opened(scene, chosen, frames, default_time, strict, max_memory)
    files = StageFiles(source)
    plan = planned(source, files, times, chosen, strict, max_memory)
    fingerprint = Fingerprint({**plan.fingerprint.settings, "bake": asdict(wanted)}, plan.fingerprint.stage)
    plan = replace(plan, fingerprint=fingerprint)
    context, atlases = LazyContext(plan, wanted.resolution**2), AtlasStore(source, wanted)
    receivers = _first_receivers(plan, wanted, context, atlases)
    names = TextureNames(out, {found.path: found.tiles for found in receivers})
    names.check(times)
    layer = None if what == "motion" else light_layer_path(out)
    others = {} if layer is None else {"the layer that binds them": layer}
    prepare_outputs(source, files, stats, None, [path for frame in times for path in names.paths(frame)], others)
    work = BakeWork(plan, wanted, receivers, names, atlases, context, skip_existing, begun)
    reports = SequenceReports(source.file, stats, skip_existing)
    loop = FrameLoop(work, lambda frame: names.paths(frame)[0], shown, persistence, reports.add)
    loop.run(times, None)
    done = [outcome.frame for outcome in loop.outcomes if outcome.status != "failed"]
    if layer is not None and done:
        try:
            _write_layer(layer, plan, wanted, receivers, names, done)
        except (FrameError, InputError, OSError) as error:
            loop.problems.append(reason_of(error))
    seconds = time.perf_counter() - started
    return reports.finished(plan.settings, plan.target, loop.outcomes, loop.problems, seconds, work.existing.anew)


def _whole(number: Any) -> Any:
    """NumPy's whole numbers as Python's; what is no number is refused with the other settings."""
    return int(number) if isinstance(number, Integral) and not isinstance(number, bool) else number


def _first_receivers(
    plan: SequencePlan, settings: BakeSettings, context: LazyContext, atlases: AtlasStore
) -> list[Receiver]:
    """The receivers of the first frame that can be used.

    Raises:
        InputError: None can.
        FrameError: Likewise.
    """
    refused: InputError | FrameError | None = None
    for frame in plan.frames:
        try:
            shutter = shutter_of(plan.source, frame, plan.settings)
            return receivers_of(settings, plan.source, context(shutter), atlases, shutter)
        except (InputError, FrameError) as error:
            refused = refused or error
    raise refused


def _write_layer(
    path: Path,
    plan: SequencePlan,
    settings: BakeSettings,
    receivers: Sequence[Receiver],
    names: TextureNames,
    frames: Sequence[float],
) -> None:
    bound = []
    for found in receivers:
        files = {frame: names.pattern(found.path, frame) for frame in frames}
        # Radiance is emitted as it is, irradiance as a diffuse surface turns it into radiance.
        scale = (1.0, 1.0, 1.0) if settings.what == "caustic" else tuple(part / math.pi for part in found.albedo)
        bound.append(BoundTexture(found.path, files, settings.uv, found.projected, found.albedo, scale))
    for line in write_light_layer(path, plan.source.stage, bound):
        logger.warning(line)
