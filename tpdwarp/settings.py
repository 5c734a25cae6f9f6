"""Settings of a render or a trace: one frozen dataclass, validated once, the same for Python and the command line."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

from tpdwarp.errors import InputError
from tpdwarp.presets import PRESETS

CHOICES: dict[str, tuple[str, ...]] = {
    "motion": ("linear", "cubic"),
    "estimator": ("tpd", "pd", "tdpm", "accumulation", "distribution"),
    "kernel": ("bspline", "uniform", "cone", "epanechnikov", "quartic", "gaussian"),
    "footprint": ("shutter", "swept"),
    "emission": ("lattice", "jittered"),
    "anchor": ("surface", "light"),
    "trace_at": ("middle", "open"),
    "path": ("curved", "straight"),
    "time_filter": ("none", "uniform", "cone", "epanechnikov", "quartic", "gaussian"),
}
PURPOSES = ("default", "render", "proxy", "guide")
AOVS = ("caustic", "direct", "irradiance", "Z", "N", "P", "motion", "photons")


@dataclass(frozen=True)
class Settings:
    """How frames are rendered.

    Attributes:
        photons: Photons emitted towards specular geometry, a frame.
        samples: Camera samples a pixel.
        segments: Parts of the shutter traced apart; ``auto``: what pays, by mesh.
        target_error: Wanted relative RMSE of caustics; chooses photons and segments.
        exposure: Exposure in frames, opening at the frame; None takes the camera's ``shutter:open/close``.
        shutter: (open, close) in frames relative to the frame; overrides ``exposure``.
        motion: How positions between time samples are found: ``linear`` (USD's meaning) or ``cubic``.
        estimator: ``tpd`` (temporal photon differentials), ``pd`` (no time column), ``tdpm`` (nearest photons),
            ``accumulation`` (brute force), ``distribution`` (random times).
        kernel: Filter kernel of a footprint.
        footprint: ``shutter`` (true time average) or ``swept`` (Eq. 7 of the paper).
        emission: ``lattice`` or ``jittered``.
        anchor: What a photon rides on over the shutter: the ``surface`` it first hit, or its emission point
            (``light``).
        trace_at: When in the shutter ``tpd`` traces: ``middle``, or ``open`` (the paper's forward differences).
        path: Way of a B-spline footprint of ``tpd``: ``straight`` along D_t x, or ``curved`` as it changes.
        smoothing: Footprint size in lattice cells.
        time_filter: Shutter response of Eq. 9, for ``swept``.
        seed: Seed of all random choices.
        device: Warp device, for instance ``cpu`` or ``cuda:0``.
        threads: CPU threads; 0 for all cores.
        accumulation_times: Instants that ``accumulation`` averages, or random times stem from.
        tdpm_neighbours: Photons in an estimate of ``tdpm``.
        tdpm_between: In-between frames of ``tdpm``; else times are random.
        image_width: Width in pixels; None takes the render settings' resolution, or 960.
        complexity: As in usdrecord: each tenth above 1 refines subdivision surfaces once more.
        purposes: Purposes rendered beside ``default``.
        mask: Prim paths that alone are read; empty for all.
        camera: Camera path or name; empty takes the render settings' camera, or the only one.
        render_settings: Path of the RenderSettings prim; empty takes the stage's own.
        aovs: Extra channel groups to write.
    """

    photons: int = 65536
    samples: int = 4
    segments: int | str = 1
    target_error: float | None = None
    exposure: float | None = None
    shutter: tuple[float, float] | None = None
    motion: str = "linear"
    estimator: str = "tpd"
    kernel: str = "bspline"
    footprint: str = "shutter"
    emission: str = "lattice"
    anchor: str = "surface"
    trace_at: str = "middle"
    path: str = "curved"
    smoothing: float = 1.0
    time_filter: str = "none"
    seed: int = 0
    device: str = "cpu"
    threads: int = 0
    accumulation_times: int = 64
    tdpm_neighbours: int = 100
    tdpm_between: int | None = None
    image_width: int | None = None
    complexity: float = 1.0
    purposes: tuple[str, ...] = ("render",)
    mask: tuple[str, ...] = ()
    camera: str = ""
    render_settings: str = ""
    aovs: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        def refuse(name: str, why: str) -> None:
            raise InputError(f"--{name.replace('_', '-')} {why}")

        if isinstance(self.segments, str) and self.segments != "auto":
            refuse("segments", f"must be a whole number above 0 or auto, not {self.segments!r}")
        for name in ("photons", "samples", "segments", "accumulation_times", "tdpm_neighbours", "image_width"):
            value = getattr(self, name)
            if value is None or (name, value) == ("segments", "auto"):
                continue
            if not isinstance(value, int) or isinstance(value, bool) or value < 1:
                refuse("imageWidth" if name == "image_width" else name, f"must be a whole number above 0, not {value}")
        if self.target_error is not None:
            if not 1e-4 <= self.target_error <= 1:
                refuse("target_error", f"must lie in 0.0001 … 1, not {self.target_error}")
            method = (self.estimator, self.kernel, self.emission, self.trace_at)
            if method != ("tpd", "bspline", "lattice", "middle"):
                refuse("target_error", "is for tpd on a lattice (leave --estimator, --kernel and --emission out)")
        if self.photons > 2**28:
            refuse("photons", f"must be at most {2**28}, not {self.photons}")
        if self.tdpm_neighbours < 2:
            refuse("tdpm_neighbours", "must be at least 2: the last of them marks the edge and adds nothing")
        if self.tdpm_between is not None and (not isinstance(self.tdpm_between, int) or self.tdpm_between < 0):
            refuse("tdpm_between", f"must be a whole number, 0 or more, not {self.tdpm_between}")
        if not isinstance(self.threads, int) or self.threads < 0:
            refuse("threads", f"must be 0 (all cores) or more, not {self.threads}")
        if not 0 <= self.seed < 2**31:
            refuse("seed", f"must lie in 0 … 2^31−1, not {self.seed}")
        if not (math.isfinite(self.smoothing) and self.smoothing > 0):
            refuse("smoothing", f"must be above 0, not {self.smoothing}")
        if self.exposure is not None and not (math.isfinite(self.exposure) and self.exposure >= 0):
            refuse("exposure", f"must be 0 frames or more, not {self.exposure}")
        if self.shutter is not None:
            opening, closing = self.shutter
            if not (math.isfinite(opening) and math.isfinite(closing) and opening <= closing):
                refuse("shutter", f"must open before it closes, not {opening} {closing}")
        for name, allowed in CHOICES.items():
            if getattr(self, name) not in allowed:
                refuse(name, f"must be one of {', '.join(allowed)}, not {getattr(self, name)!r}")
        if self.time_filter != "none" and self.footprint != "swept":
            refuse("time_filter", "weights the swept footprint of Eq. 9 (add --footprint swept)")
        if self.kernel == "bspline" and self.footprint == "swept":
            refuse("footprint", "swept is defined for the radial kernels of Eq. 7 (add --kernel epanechnikov)")
        for name, given, known in (("aov", self.aovs, AOVS), ("purposes", self.purposes, PURPOSES)):
            unknown = [entry for entry in given if entry not in known]
            if unknown:
                refuse(name, f"knows no {unknown[0]!r}; there are {', '.join(known)}")

    @classmethod
    def of(cls, settings: Settings | None = None, preset: str | None = None, **changes: Any) -> Settings:
        """``settings`` (or the defaults) with those of a preset, then with ``changes``; unknown names are refused.

        Raises:
            InputError: A name or a value is not usable.
        """
        known = {field.name for field in fields(cls)}
        for name in changes:
            if name not in known:
                raise InputError(f"unknown setting {name!r}; there are {', '.join(sorted(known))}")
        if changes.get("target_error") is not None:
            chosen = [name for name in ("photons", "segments", "smoothing") if name in changes]
            if chosen:
                raise InputError(f"--target-error chooses photons and segments itself (leave --{chosen[0]} out)")
        if preset is not None and preset not in PRESETS:
            raise InputError(f"--preset must be one of {', '.join(PRESETS)}, not {preset!r}")
        return replace(settings or cls(), **{**PRESETS.get(preset, {}), **changes})

    def as_dict(self) -> dict[str, Any]:
        """The settings as plain JSON values."""
        return asdict(self)
