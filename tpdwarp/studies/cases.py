"""What a study renders: methods and the settings that matter to each, crossed."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from tpdwarp.errors import InputError
from tpdwarp.presets import PRESETS
from tpdwarp.settings import CHOICES, Settings


@dataclass(frozen=True)
class Case:
    """One way to render the frames.

    Attributes:
        series: What stays the same while photons are added, in words.
        exposure: In frames; None takes the camera's shutter.
        settings: How it is rendered.
        preset: Name of the preset it is, or empty.
        outside: Whether another renderer made the frames; ``settings`` then say nothing of them.
    """

    series: str
    exposure: float | None
    settings: Settings
    preset: str = ""
    outside: bool = False

    @property
    def label(self) -> str:
        """The case in words, for tables and progress."""
        return self.series if self.outside else f"{self.series}, {self.settings.photons} photons"


@dataclass(frozen=True)
class Sweep:
    """The values that are tried.

    Attributes:
        methods: Estimators.
        photons: Photons a frame (an instant, for ``accumulation``).
        segments: K, or ``auto``, for ``tpd``.
        kernels: Filter kernels, for all but ``tdpm``.
        exposures: In frames; None takes the camera's shutter.
        neighbours: k, for ``tdpm``.
        between: In-between frames, for ``tdpm``; None for random times.
        presets: Presets tried beside all that, as they are.
    """

    methods: Sequence[str] = ("tpd", "pd", "tdpm", "distribution", "accumulation")
    photons: Sequence[int] = (1024, 4096, 16384, 65536)
    segments: Sequence[int | str] = (1, 4)
    kernels: Sequence[str] = ("bspline",)
    exposures: Sequence[float | None] = (None,)
    neighbours: Sequence[int] = (25, 100)
    between: Sequence[int | None] = (None,)
    presets: Sequence[str] = field(default=())

    def cases(self, base: Settings) -> list[Case]:
        """All cases, those with few photons first, so that a study cut short has seen every method.

        Args:
            base: Settings of all cases, but for what is swept.

        Raises:
            InputError: A value is not usable.
        """
        for name, allowed in (("methods", CHOICES["estimator"]), ("presets", tuple(PRESETS))):
            unknown = [value for value in getattr(self, name) if value not in allowed]
            if unknown:
                raise InputError(f"--{name} knows no {unknown[0]!r}; there are {', '.join(allowed)}")
        cases = [
            Case(self._series(changes), exposure, Settings.of(base, exposure=exposure, **changes))
            for exposure in self.exposures
            for photons in sorted(self.photons)
            for method in self.methods
            for changes in self._changes(method, photons)
        ]
        cases += [
            Case(f"preset {name}", exposure, Settings.of(base, preset=name, exposure=exposure), name)
            for exposure in self.exposures
            for name in self.presets
        ]
        return list(dict.fromkeys(cases))

    def _changes(self, method: str, photons: int) -> list[dict[str, Any]]:
        """What is changed for each case of a method; only what it heeds."""
        if method == "tdpm":
            axes = {"tdpm_neighbours": self.neighbours, "tdpm_between": self.between}
        elif method == "tpd":
            axes = {"segments": self.segments, "kernel": self.kernels}
        else:
            axes = {"kernel": self.kernels}
        common = {"estimator": method, "photons": photons}
        return [
            {"segments": 1, **common, **dict(zip(axes, values, strict=True))}
            for values in itertools.product(*axes.values())
        ]

    def _series(self, changes: dict[str, Any]) -> str:
        words = [changes["estimator"]]
        if changes["estimator"] == "tpd":
            words.append(f"K={changes['segments']}")
        if changes["estimator"] == "tdpm":
            between = changes["tdpm_between"]
            words += [f"k={changes['tdpm_neighbours']}", "random times" if between is None else f"B={between}"]
        elif len(self.kernels) > 1:
            words.append(changes["kernel"])
        return " ".join(words)
