"""Settings of a render or a trace, validated once, the same for Python and the command line.

Four small groups say what each room needs to know: the stage reader takes :class:`StageSettings`, the photon tracer and
the estimators :class:`LightSettings`. :class:`Settings` is all four behind flat names, and so can be given to either.
"""

from __future__ import annotations

import math
import os
import re
from dataclasses import Field, asdict, dataclass, fields, replace
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
    "refracted_radiance": ("scaled", "unscaled"),
    "time_filter": ("none", "uniform", "cone", "epanechnikov", "quartic", "gaussian"),
}
PURPOSES = ("default", "render", "proxy", "guide")
AOVS = (
    "caustic",
    "direct",
    "irradiance",
    "Z",
    "N",
    "P",
    "motion",
    "photons",
    "albedo",
    "shadow",
    "vector",
    "id",
    "cryptomatte",
)
# What else people call them.
AOV_ALIASES = {"caustics": "caustic", "depth": "Z", "normal": "N", "normals": "N", "position": "P"}
EXR_TYPES = ("half", "float")
# What asks for more is a slip of the hand: samples of a pixel are looked at together, in arrays that take a tenth of a
# gigabyte for so many, so many traces take days, and kernels know no number beyond 2³¹.
MOST = {
    "photons": 2**28,
    "samples": 2**16,
    "segments": 2**12,
    "accumulation_times": 2**16,
    "light_splits": 2**16,
    "bounces": 2**16,
    "tdpm_neighbours": 2**16,
}
MOST_THREADS = 1024
# The entry of light groups that puts lights into those that they name themselves.
AUTOMATIC_GROUPS = "auto"
_GROUP_ENTRY = re.compile(r"[A-Za-z]\w*=.+", re.ASCII)


def _refuse(name: str, why: str) -> None:
    raise InputError(f"--{name.replace('_', '-')} {why}")


def _plain(value: Any) -> Any:
    """NumPy's numbers and arrays as Python's numbers and tuples, lists as tuples."""
    plain = value.tolist() if hasattr(value, "tolist") else value
    return tuple(map(_plain, plain)) if isinstance(plain, list | tuple) else plain


def _text(value: Any) -> Any:
    """Paths of prims and of files as texts."""
    return str(value) if hasattr(value, "pathString") or isinstance(value, os.PathLike) else value


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


class _Group:
    """A group of settings, made plain and checked when it is made."""

    def __post_init__(self) -> None:
        for field in fields(self):
            object.__setattr__(self, field.name, self._of_kind(field, _plain(getattr(self, field.name))))
        for group in type(self).__mro__:
            if "_check" in vars(group):
                group._check(self)
        for name, allowed in CHOICES.items():
            if getattr(self, name, allowed[0]) not in allowed:
                _refuse(name, f"must be one of {', '.join(allowed)}, not {getattr(self, name)!r}")

    @staticmethod
    def _of_kind(field: Field[Any], value: Any) -> Any:
        """A value of the kind that a setting takes: lists may be a text with commas, texts may be paths."""
        kinds = str(field.type).split(" | ")
        if value is None and "None" in kinds:
            return None
        if kinds[0] == "tuple[str, ...]":
            listed = tuple(filter(None, map(str.strip, value.split(",")))) if isinstance(value, str) else value
            if not isinstance(listed, tuple) or not all(isinstance(entry, str) for entry in map(_text, listed)):
                _refuse(field.name, f"must be a list of names, not {value!r}")
            return tuple(map(_text, listed))
        if kinds[0].startswith("tuple"):
            count = kinds[0].count(",") + 1
            numbers = isinstance(value, tuple) and len(value) == count and all(map(_is_number, value))
            if not numbers:
                _refuse(field.name, f"must be {count} numbers, not {value!r}")
            return tuple(map(float, value)) if "float" in kinds[0] else value
        if kinds[0] == "float":
            if not _is_number(value):
                _refuse(field.name, f"must be a number, not {value!r}")
            return float(value)
        if kinds[0] == "str":
            value = _text(value)
            if not isinstance(value, str):
                _refuse(field.name, f"must be a text, not {value!r}")
        return value

    def _check_counts(self, *names: str) -> None:
        for name in names:
            value = getattr(self, name)
            if value is None or (name in ("segments", "light_splits") and value == "auto"):
                continue
            if not isinstance(value, int) or isinstance(value, bool) or value < 1:
                _refuse("imageWidth" if name == "image_width" else name, f"must be a whole number above 0, not {value}")
            if value > MOST.get(name, math.inf):
                _refuse(name, f"must be at most {MOST[name]}, not {value}")

    def _check_parts(self, *names: str) -> None:
        for name in names:
            if not 0 <= getattr(self, name) <= 1:
                _refuse(name, f"must lie in 0 … 1, not {getattr(self, name)}")

    def _check_known(self, option: str, given: tuple[str, ...], known: tuple[str, ...]) -> None:
        unknown = [entry for entry in given if entry not in known]
        if unknown:
            _refuse(option, f"knows no {unknown[0]!r}; there are {', '.join(known)}")


@dataclass(frozen=True)
class StageSettings(_Group):
    """How a stage is read.

    Attributes:
        exposure: How long the shutter is open [frames, not stops], from the frame on; None takes the camera's
            ``shutter:open/close``.
        shutter: (open, close) in frames relative to the frame; overrides ``exposure``.
        motion: How positions between time samples are found: ``linear`` (USD's meaning) or ``cubic``.
        image_width: Width in pixels; None takes the render settings' resolution, or 960.
        resolution: Width and height in pixels; overrides ``image_width`` and the render settings.
        crop: Part of the image that is rendered: left, bottom, right and top in 0 … 1 from its lower left (as
            dataWindowNDC), or left, upper, right and lower edge in pixels from its upper left; overrides the render
            settings.
        complexity: As in usdrecord: each tenth above 1 refines subdivision surfaces once more.
        purposes: Purposes rendered beside ``default``.
        mask: Prim paths that alone are read; empty for all.
        camera: Camera path or name; empty takes the render settings' camera, or the only one.
        render_settings: Path of the RenderSettings prim; empty takes the stage's own.
        product: Path or name of the RenderProduct; empty takes the first.
    """

    exposure: float | None = None
    shutter: tuple[float, float] | None = None
    motion: str = "linear"
    image_width: int | None = None
    resolution: tuple[int, int] | None = None
    crop: tuple[float, float, float, float] | None = None
    complexity: float = 1.0
    purposes: tuple[str, ...] = ("render",)
    mask: tuple[str, ...] = ()
    camera: str = ""
    render_settings: str = ""
    product: str = ""

    def _check(self) -> None:
        self._check_counts("image_width")
        self._check_known("purposes", self.purposes, PURPOSES)
        if self.resolution is not None:
            if not all(isinstance(side, int) and side > 0 for side in self.resolution):
                _refuse("resolution", f"must be a width and a height in pixels, not {self.resolution}")
            if self.image_width is not None:
                _refuse("resolution", "says all that --imageWidth says (leave one out)")
        if self.crop is not None:
            self._check_crop(self.crop)
        if not 1 <= self.complexity <= 2:
            _refuse("complexity", f"must lie in 1 … 2, not {self.complexity:g}")
        if self.exposure is not None and not (math.isfinite(self.exposure) and self.exposure >= 0):
            _refuse("exposure", f"must be 0 frames or more, not {self.exposure}")
        if self.shutter is not None:
            opening, closing = self.shutter
            if not (math.isfinite(opening) and math.isfinite(closing) and opening <= closing):
                _refuse("shutter", f"must open before it closes, not {opening} {closing}")

    def _check_crop(self, crop: tuple[float, ...]) -> None:
        if not (all(map(math.isfinite, crop)) and crop[0] < crop[2] and crop[1] < crop[3]):
            _refuse("crop", f"takes X0 Y0 X1 Y1 with X0 < X1 and Y0 < Y1, not {' '.join(f'{edge:g}' for edge in crop)}")
        if max(crop) > 1.0 and any(edge != int(edge) or edge < 0 for edge in crop):
            _refuse("crop", f"takes parts of 0 … 1, or whole pixels, not {' '.join(f'{edge:g}' for edge in crop)}")


@dataclass(frozen=True)
class LightSettings(_Group):
    """How photons are traced and their light is estimated.

    Attributes:
        photons: Photons emitted towards specular geometry, a frame.
        segments: Parts of the shutter that are traced apart, each with its share of the photons; ``auto`` chooses.
        light_splits: Parts that a light with extent is cut into, each traced from its middle with its share of the
            photons; ``auto`` chooses.
        bounces: Specular interactions followed along a path; None for as many as light takes (up to 64).
        branch_cutoff: Part of the emitted flux below which reflected branches of photons are given up, and counted.
        target_error: Wanted relative RMSE of caustics; chooses photons, segments and, where needed, more samples.
        estimator: ``tpd`` (temporal photon differentials), ``pd`` (photons of mid shutter, which stand still), ``tdpm``
            (nearest photons), ``accumulation`` (brute force), ``distribution`` (random times).
        kernel: Filter kernel of a footprint.
        footprint: ``shutter`` (true time average) or ``swept`` (Eq. 7 of the paper).
        emission: ``lattice`` or ``jittered``.
        anchor: What a photon rides on over the shutter: the ``surface`` it first hit, or its emission point
            (``light``).
        trace_at: When in the shutter ``tpd`` traces: ``middle``, or ``open`` (the paper's forward differences).
        path: Trajectory of a B-spline footprint of ``tpd``: ``straight`` along D_t x, or ``curved`` as it changes.
        smoothing: Footprint size in lattice cells.
        time_filter: Shutter response of Eq. 9, for ``swept``.
        accumulation_times: Instants, and places on lights with extent, that ``accumulation`` averages, or instants from
            which random times are taken.
        tdpm_neighbours: Photons in an estimate of ``tdpm``.
        tdpm_between: In-between frames of ``tdpm``; else times are random.
    """

    photons: int = 65536
    segments: int | str = "auto"
    light_splits: int | str = "auto"
    bounces: int | None = None
    branch_cutoff: float = 2.0e-3
    target_error: float | None = None
    estimator: str = "tpd"
    kernel: str = "bspline"
    footprint: str = "shutter"
    emission: str = "lattice"
    anchor: str = "surface"
    trace_at: str = "middle"
    path: str = "curved"
    smoothing: float = 1.0
    time_filter: str = "none"
    accumulation_times: int = 64
    tdpm_neighbours: int = 100
    tdpm_between: int | None = None

    def _check(self) -> None:
        for name in ("segments", "light_splits"):
            value = getattr(self, name)
            if isinstance(value, str) and value != "auto":
                _refuse(name, f"must be a whole number above 0 or auto, not {value!r}")
        self._check_counts("photons", "segments", "light_splits", "bounces", "accumulation_times", "tdpm_neighbours")
        if self.target_error is not None:
            if not 1e-4 <= self.target_error <= 1:
                _refuse("target_error", f"must lie in 0.0001 … 1, not {self.target_error}")
            method = (self.estimator, self.kernel, self.emission, self.trace_at)
            if method != ("tpd", "bspline", "lattice", "middle"):
                _refuse("target_error", "is for tpd on a lattice (leave --estimator, --kernel and --emission out)")
        self._check_parts("branch_cutoff")
        if self.tdpm_neighbours < 2:
            _refuse("tdpm_neighbours", "must be at least 2: the last of them marks the edge and adds nothing")
        if self.tdpm_between is not None and (not isinstance(self.tdpm_between, int) or self.tdpm_between < 0):
            _refuse("tdpm_between", f"must be a whole number, 0 or more, not {self.tdpm_between}")
        if not (math.isfinite(self.smoothing) and self.smoothing > 0):
            _refuse("smoothing", f"must be above 0, not {self.smoothing}")
        if self.time_filter != "none" and self.footprint != "swept":
            _refuse("time_filter", "weights the swept footprint of Eq. 9 (add --footprint swept)")
        if self.kernel == "bspline" and self.footprint == "swept":
            _refuse("footprint", "swept is defined for the radial kernels of Eq. 7 (add --kernel epanechnikov)")


@dataclass(frozen=True)
class ViewSettings(_Group):
    """What the camera records.

    Attributes:
        samples: Camera samples a pixel.
        view_cutoff: Part of a sample below which reflected branches of the view are given up, and counted.
        aovs: Extra channel groups to write; ``caustics``, ``depth``, ``normal`` and ``position`` are understood.
        exr_type: ``half`` or ``float`` for all channels of an EXR; empty for half where colours are, and else float.
        light_groups: Groups of lights whose caustics (and irradiance) are also written apart: NAME=PATTERN, where the
            pattern is a light's name or path, with wildcards; or ``auto``, by the group that a light names (as in
            RenderMan, Karma and Arnold), else by its own name. The first that fits counts; the rest is ``other``.
        holdout: A host's images (``####`` for the frame) whose depth hides what lies behind it: light and alpha are 0
            there.
        view: The channel group that PNG, JPEG and TIFF show in the place of the beauty; empty for the beauty.
        view_exposure: Stops by which these are brighter.
        refracted_radiance: ``scaled`` by the square of the relative index where the camera looks through an interface,
            as light is, or ``unscaled``, for hosts whose renderer leaves that out.
    """

    samples: int = 4
    view_cutoff: float = 4.0e-3
    aovs: tuple[str, ...] = ()
    refracted_radiance: str = "scaled"
    exr_type: str = ""
    light_groups: tuple[str, ...] = ()
    holdout: str = ""
    view: str = ""
    view_exposure: float = 0.0

    def _check(self) -> None:
        self._check_counts("samples")
        view = AOV_ALIASES.get(self.view, self.view)
        asked = [*self.aovs, view] if view else self.aovs
        # What is asked for twice is written once.
        aovs = tuple(dict.fromkeys(AOV_ALIASES.get(name, name) for name in asked))
        object.__setattr__(self, "view", view)
        object.__setattr__(self, "aovs", aovs)
        self._check_parts("view_cutoff")
        self._check_known("aov", self.aovs, AOVS)
        unclear = [
            entry for entry in self.light_groups if entry != AUTOMATIC_GROUPS and not _GROUP_ENTRY.fullmatch(entry)
        ]
        if unclear:
            _refuse("light_groups", f"takes auto and NAME=PATTERN (NAME of letters, digits, _), not {unclear[0]!r}")
        if self.exr_type:
            self._check_known("exr_type", (self.exr_type,), EXR_TYPES)
        if not abs(self.view_exposure) <= 100:
            _refuse("view_exposure", f"must lie in -100 … 100 stops, not {self.view_exposure}")


@dataclass(frozen=True)
class MachineSettings(_Group):
    """Where and how reproducibly it is computed.

    Attributes:
        seed: Seed of all random choices.
        device: Warp device, for instance ``cpu`` or ``cuda:0``.
        threads: CPU threads; 0 for all cores.
    """

    seed: int = 0
    device: str = "cpu"
    threads: int = 0

    def _check(self) -> None:
        if not isinstance(self.threads, int) or not 0 <= self.threads <= MOST_THREADS:
            _refuse("threads", f"must lie in 0 (all cores) … {MOST_THREADS}, not {self.threads}")
        if not isinstance(self.seed, int) or not 0 <= self.seed < 2**31:
            _refuse("seed", f"must lie in 0 … 2^31−1, not {self.seed}")


@dataclass(frozen=True)
class Settings(MachineSettings, ViewSettings, LightSettings, StageSettings):
    """How frames are rendered: the settings of all four groups, whose docstrings explain them."""

    @classmethod
    def of(cls, settings: Settings | None = None, preset: str | None = None, **changes: Any) -> Settings:
        """``settings`` (or the defaults) with those of a preset, then with ``changes``; unknown names are refused.

        Raises:
            InputError: A name or a value is not usable.
        """
        if settings is not None and not isinstance(settings, Settings):
            raise InputError(f"settings must be a tpdwarp.Settings, not {settings!r} (or give each by its name)")
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
