"""Lights in the prototypes of point instancers, wherever these place them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from pxr import Usd

from tpdwarp.errors import InputError, WarnOnce
from tpdwarp.usd.read.instances import Below, Instancer, OfInstances, name_below
from tpdwarp.usd.read.jumps import Jump
from tpdwarp.usd.read.lights import Light, changing_visibilities
from tpdwarp.usd.read.mesh_lights import MeshLight
from tpdwarp.usd.read.meshes import Placement
from tpdwarp.usd.read.transforms import Transforms

# Every light takes a lattice of its own, and a shadow ray from each place that is seen: so many take as long as
# anybody waits.
MOST_PLACED = 4096


class _TransformsOfInstance:
    """The transforms of a prim where one instance stands around a frame, as :class:`Transforms` has them."""

    def __init__(self, place: OfInstances, cubic: bool, frame: float) -> None:
        self.cubic, self.frame, self.place = cubic, frame, place

    def world(self, prim: Usd.Prim, time: float) -> np.ndarray:
        return self.place.worlds(time, self.frame)[0]

    def span(self, prim: Usd.Prim) -> tuple[float, float] | None:
        return self.place.span

    def jumps(self, prim: Usd.Prim) -> tuple[Jump, ...]:
        return self.place.jumps()


class InstancedLight(Light):
    """A light of one instance; :meth:`around` says at which frame it is looked at."""

    def __init__(
        self,
        prim: Usd.Prim,
        below: Below,
        index: int,
        path: str,
        cubic: bool,
        animation: tuple[float, float],
        warnings: WarnOnce,
    ) -> None:
        self._place = OfInstances(below, np.array([index]))
        self._around = _TransformsOfInstance(self._place, cubic, animation[0])
        super().__init__(prim, self._around, animation, warnings, path)
        self._visibilities += changing_visibilities(below.instancer.instancer.GetPrim())

    def around(self, frame: float) -> InstancedLight:
        self._around.frame = frame
        return self

    @property
    def ever_visible(self) -> bool:
        return True

    def visible(self, frame: float) -> bool:
        return self._place.visible(frame)


class InstancedMeshLight(MeshLight):
    """A mesh of one instance that shines; it is asked only where the mesh is visible."""

    @property
    def ever_visible(self) -> bool:
        return True

    def visible(self, frame: float) -> bool:
        return True


class InstancedLights:
    """All lights of one instancer on the stage, by frame.

    Args:
        instancer: The instancer.
        placement: Where it stands.
        transforms: Transforms of the stage.
        animation: First and last time code of the stage.
        warnings: Takes what is not supported, and names the file in errors.
    """

    def __init__(
        self,
        instancer: Instancer,
        placement: Placement,
        transforms: Transforms,
        animation: tuple[float, float],
        warnings: WarnOnce,
    ) -> None:
        self._instancer, self._placement, self._transforms = instancer, placement, transforms
        self._animation, self._warnings = animation, warnings
        self._below: dict[tuple[str, str], Below] = {}
        self._made: dict[tuple[str, int], InstancedLight] = {}

    def at(self, frame: float) -> Iterator[InstancedLight]:
        """The lights of every instance at a time code; the same objects on later calls.

        Raises:
            InputError: They are too many.
        """
        count = self._instancer.placed_lights(frame)
        if count > MOST_PLACED:
            raise InputError(
                f"places {count} lights (at most {MOST_PLACED}; see --mask)", self._warnings.file, self._instancer.path
            )
        yield from self._of(self._instancer, self._instancer.path, self._placement, frame)

    def _of(self, instancer: Instancer, label: str, placement: Placement, frame: float) -> Iterator[InstancedLight]:
        for index, number in zip(*instancer.instances(frame), strict=True):
            prototype = instancer.prototypes[number]
            for prim in prototype.lights:
                below = self._common(prim, prototype.root, instancer, label, placement)
                key = f"{label}[{index}]{name_below(prim, prototype.root)}", id(below)
                if key not in self._made:
                    self._made[key] = InstancedLight(
                        prim, below, int(index), key[0], self._transforms.cubic, self._animation, self._warnings
                    )
                yield self._made[key].around(frame)
            for nested in prototype.instancers:
                prim = nested.instancer.GetPrim()
                below = self._common(prim, prototype.root, instancer, label, placement)
                name = f"{label}[{index}]{name_below(prim, prototype.root)}"
                yield from self._of(nested, name, OfInstances(below, np.array([index])), frame)

    def _common(
        self, prim: Usd.Prim, root: Usd.Prim, instancer: Instancer, label: str, placement: Placement
    ) -> Below:
        key = label, str(prim.GetPath())
        if key not in self._below:
            self._below[key] = Below(prim, root, instancer, placement, self._transforms)
        return self._below[key]
