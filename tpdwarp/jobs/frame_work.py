"""The work on one frame of a sequence: render or trace it, and keep what came out."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace

from tpdwarp.clock import Clock
from tpdwarp.errors import FrameError, logger
from tpdwarp.io.frame_names import FrameNames
from tpdwarp.io.images import write_frame
from tpdwarp.jobs.aov_pictures import picture_of
from tpdwarp.jobs.claims import Claims
from tpdwarp.jobs.dark_frames import DarkWatch
from tpdwarp.jobs.energy_warnings import EnergyWatch
from tpdwarp.jobs.existing_frames import ExistingFrames, KeptFrame, statistics_text
from tpdwarp.jobs.frame_metadata import frame_metadata
from tpdwarp.jobs.frame_need import need_of, refuse_beyond
from tpdwarp.jobs.holdouts import held_out
from tpdwarp.jobs.layer_job import DebugLayerJob
from tpdwarp.jobs.opening import shutter_of
from tpdwarp.jobs.plan import SequencePlan
from tpdwarp.jobs.progress import Progress
from tpdwarp.jobs.results import FrameOutcome
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame, trace_frame
from tpdwarp.scene.description import Shutter

# Paths of photons in a frame of a debug layer: more of them hide each other. Chosen, not derived.
MOST_PATHS = 1000


class RenderWork:
    """Renders one frame after the other to image files.

    Args:
        plan: The sequence.
        names: The frames' files.
        layer: A debug layer that takes their photons; None without.
        context: Gives the context of the sequence; it is told the shutter of the frame that asks.
        skip_existing: Whether frames stay that are there, whole and up to date, of whatever age.
        begun: When the sequence was begun, as ``time.time()`` has it: frames of the same made since then stay, for
            another process has made them meanwhile.
        shown: Is told the stages of the work.

    Attributes:
        existing: What became of files that were there.
    """

    def __init__(
        self,
        plan: SequencePlan,
        names: FrameNames,
        layer: DebugLayerJob | None,
        context: Callable[[Shutter], RenderContext],
        skip_existing: bool,
        begun: float,
        shown: Progress | None = None,
    ) -> None:
        self._plan, self._names, self._layer = plan, names, layer
        self._skips, self._begun, self._shown = skip_existing, begun, shown or Progress()
        self.existing = ExistingFrames(plan.fingerprint)
        self._region = plan.source.region()
        self._claims, self._context = Claims(), context
        self._watch = EnergyWatch(plan.source)
        self._dark = DarkWatch(plan.source.file)

    def __call__(self, frame: float) -> FrameOutcome:
        """Renders a frame, or leaves it alone.

        Raises:
            ClaimedElsewhere: Another process renders it.
            InputError: The stage cannot be used there.
            FrameError: It cannot be rendered or written.
            OSError: Likewise.
        """
        plan, path = self._plan, self._names.path(frame)
        shutter = shutter_of(plan.source, frame, plan.settings)
        with self._claims.held(path):
            kept = self.existing.kept(path, frame) if self._skips or is_newer(path, self._begun) else None
            if kept is not None and (self._layer is None or not self._layer.lacks(frame)):
                return skipped(frame, path, kept)
            clock = Clock(begins=self._shown.stage)
            with plan.files.unchanged(plan.strict):
                if kept is not None:
                    made = trace_frame(self._context(shutter), shutter, clock, MOST_PATHS)
                else:
                    region, keeping = self._region, self._layer is not None
                    size, options = (region.width, region.height), {"region": region, "keeping": keeping}
                    paths = MOST_PATHS if keeping else 0
                    made = render_frame(self._context(shutter), shutter, *size, clock, paths=paths, **options)
                    self._dark(frame, made.channels)
                    made = replace(made, channels=held_out(made.channels, plan.settings.holdout, frame, region))
            self._watch(frame, shutter, made.energy)
            refusal: FrameError | OSError | None = None
            if self._layer is not None:
                # Photons first: a frame whose image is there has them, whenever the process is killed. That they
                # cannot be kept makes the frame fail, but costs no image.
                try:
                    statistics = statistics_text(len(made.landed), made.energy, made.seconds)
                    self._layer.add(frame, made.photons, statistics, made.paths)
                except (FrameError, OSError) as error:
                    refusal = error
            if kept is None:
                metadata = frame_metadata(
                    plan.source, frame, shutter, plan.settings, made, plan.fingerprint, plan.target
                )
                settings, channels = plan.settings, made.channels
                if not path.lower().endswith(".exr") and (settings.view or settings.view_exposure):
                    channels = picture_of(channels, settings.view, settings.view_exposure)
                with clock.stage("write"):
                    write_frame(path, channels, metadata, settings.exr_type or None, self._region)
        if refusal is not None:
            raise refusal
        status = "written" if kept is None else "skipped"
        return FrameOutcome(frame, status, path, "", len(made.landed), made.energy, dict(made.seconds))


class TraceWork:
    """Traces the photons of one frame after the other for a debug layer.

    Args:
        plan: The sequence.
        layer: The layer.
        shown: Is told the stages of the work.
    """

    def __init__(self, plan: SequencePlan, layer: DebugLayerJob, shown: Progress | None = None) -> None:
        self._plan, self._layer, self._shown = plan, layer, shown or Progress()
        self._context = LazyContext(plan, 0)
        self._watch = EnergyWatch(plan.source)

    def __call__(self, frame: float) -> FrameOutcome:
        """Traces a frame, unless an earlier run has.

        Raises:
            InputError: The stage cannot be used there.
            FrameError: Its photons cannot be traced or kept.
            OSError: Likewise.
        """
        plan = self._plan
        shutter = shutter_of(plan.source, frame, plan.settings)
        kept = self._layer.kept(frame)
        if kept is not None:
            return skipped(frame, "", kept)
        with plan.files.unchanged(plan.strict):
            traced = trace_frame(self._context(shutter), shutter, Clock(begins=self._shown.stage), MOST_PATHS)
        self._watch(frame, shutter, traced.energy)
        statistics = statistics_text(len(traced.landed), traced.energy, traced.seconds)
        self._layer.add(frame, traced.photons, statistics, traced.paths)
        return FrameOutcome(frame, "traced", "", "", len(traced.landed), traced.energy, dict(traced.seconds))


class LazyContext:
    """The context of a sequence, made by its first frame: what cannot be used fails frames, not the sequence.

    Before, it is said what memory a frame will need; one that needs too much is not begun.
    """

    def __init__(self, plan: SequencePlan, pixels: int, *, shared: bool = False) -> None:
        self._plan, self._pixels, self._shared = plan, pixels, shared
        self._context: RenderContext | None = None

    def __call__(self, shutter: Shutter) -> RenderContext:
        """The context.

        Args:
            shutter: Of the frame that asks first.

        Raises:
            InputError: The stage cannot be used, or a frame needs more memory than may be taken.
        """
        if self._context is None:
            source, settings = self._plan.source, self._plan.settings
            need = need_of(source, shutter, settings, self._pixels, shared=self._shared)
            logger.info(f"{source.file}: a frame needs about {need}")
            refuse_beyond(need, self._plan.max_memory, source.file)
            self._context = RenderContext(source, settings)
        return self._context


def skipped(frame: float, path: str, kept: KeptFrame) -> FrameOutcome:
    """The outcome of a frame that stays."""
    return FrameOutcome(frame, "skipped", path, "", kept.photons, kept.energy, dict(kept.seconds))


def is_newer(path: str, begun: float) -> bool:
    """Whether a file was written after ``begun``, as ``time.time()`` has it."""
    try:
        return os.stat(path).st_mtime > begun
    except OSError:
        return False
