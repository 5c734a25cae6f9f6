"""Light groups: the light of photons, apart by the lights that they come from."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np

from tpdwarp.clock import Clock
from tpdwarp.errors import InputError
from tpdwarp.estimators.estimator import IrradianceField, Part, reshaped
from tpdwarp.footprints.shaping import PixelSize
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.photons.tracer import PhotonTracer
from tpdwarp.scene.description import SceneSource
from tpdwarp.scene.light_places import prim_of
from tpdwarp.settings import AUTOMATIC_GROUPS

# The group of lights that no other takes.
REST = "other"


@dataclass(frozen=True)
class LightGroups:
    """Which light is in which group.

    Attributes:
        group_of: Group of each light, by its path; empty where light is not kept apart.
        names: The groups, in the order in which they were asked for.
    """

    group_of: Mapping[str, str]
    names: tuple[str, ...]

    @classmethod
    def of(cls, asked: Iterable[str], source: SceneSource) -> LightGroups:
        """The groups that were asked for.

        Args:
            asked: Entries ``NAME=PATTERN``, of which a light takes the first that it matches, or ``auto``; see
                ``light_groups`` of :class:`tpdwarp.settings.ViewSettings`.
            source: Knows the lights, and the groups that they name.

        Raises:
            InputError: A pattern matches no light.
        """
        entries = [entry.partition("=")[::2] for entry in asked]
        if not entries:
            return cls({}, ())
        lights = source.light_groups()
        for entry, pattern in entries:
            if pattern and not any(_matches(path, pattern) for path in lights):
                known = ", ".join(lights) or "none"
                raise InputError(f"no light matches --light-groups {entry}={pattern} (there are {known})", source.file)
        found = {path: _group(path, own, entries) for path, own in lights.items()}
        names = [name for name, pattern in entries if pattern]
        return cls(found, tuple(dict.fromkeys([*(n for n in names if n in found.values()), *found.values()])))

    def maps_of(self, maps: Iterable[PhotonMap], name: str) -> list[PhotonMap]:
        """The photons of one group."""
        chosen = []
        for photons in maps:
            groups = [self.group_of.get(prim_of(path), REST) for path in photons.light_paths]
            inside = np.array([group == name for group in groups], bool)
            # A map without photons knows no lights.
            rows = inside[photons.light] if len(photons) else np.zeros(0, bool)
            chosen.append(photons.rows(rows))
        return chosen

    def fields(self, part: Part, pixel: PixelSize | None, tracer: PhotonTracer, clock: Clock) -> Fields:
        """The light of each group of a part of a frame, by its name; all of it, without a name, where there are none.

        Args:
            pixel: What queries stand for; None for what the part's own light is shaped for.
        """
        light = part.light if pixel is None else reshaped(part, pixel, tracer, clock)
        if light is None:
            return {}
        if not self.names:
            return {"": light}
        with clock.stage("footprints"):
            maps = {name: self.maps_of(part.maps, name) for name in self.names}
            return {name: light.of_photons(photons) for name, photons in maps.items() if any(map(len, photons))}


Fields = dict[str, IrradianceField]


def _group(path: str, own: str, entries: list[tuple[str, str]]) -> str:
    for name, pattern in entries:
        if name == AUTOMATIC_GROUPS and not pattern:
            return re.sub(r"\W", "_", own or path.rpartition("/")[2])
        if _matches(path, pattern):
            return name
    return REST


def _matches(path: str, pattern: str) -> bool:
    """Whether a pattern with wildcards matches a path, what lies above it, or, without a slash, its last name."""
    if "/" not in pattern:
        return fnmatchcase(path.rpartition("/")[2], pattern)
    return fnmatchcase(path, pattern) or path.startswith(f"{pattern.rstrip('/')}/")
