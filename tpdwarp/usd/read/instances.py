"""Point instancers: the meshes they place, at any depth of nesting."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from pxr import Usd, UsdGeom

from tpdwarp.errors import InputError, WarnOnce
from tpdwarp.usd.read.instance_limits import refuse_too_many
from tpdwarp.usd.read.jumps import Jump
from tpdwarp.usd.read.meshes import PlacedMesh, Placement
from tpdwarp.usd.read.primvars import flattened
from tpdwarp.usd.read.samples import sample_times
from tpdwarp.usd.read.transforms import Transforms, union, usable
from tpdwarp.usd.read.values import ROWS, indices_at, text_at, value_at

# From so many instances of a mesh on they are read together. Chosen, not derived: fewer cost nothing one by one.
FEWEST_TOGETHER = 64
MATRICES_KEPT = 12
# A mesh looks at no more times over a shutter: its middle, two beside it, and two at the end of an animation.
WORLDS_KEPT = 6


@dataclass
class Prototype:
    """What lies below a prototype's root: its meshes, lights, and instancers nested in it."""

    root: Usd.Prim
    meshes: list[Usd.Prim] = field(default_factory=list)
    lights: list[Usd.Prim] = field(default_factory=list)
    instancers: list[Instancer] = field(default_factory=list)


class Instancer:
    """A PointInstancer's prototypes and matrices; instance motion is USD's own, linear or along velocities.

    Args:
        instancer: The prim.
        prototypes: Its prototypes, in order.
        transforms: Transforms of the stage.
        warnings: Takes what is not supported, and names the file in errors.
    """

    def __init__(
        self,
        instancer: UsdGeom.PointInstancer,
        prototypes: list[Prototype],
        transforms: Transforms,
        warnings: WarnOnce,
    ) -> None:
        self.instancer, self.prototypes = instancer, prototypes
        self.path = str(instancer.GetPath())
        self._transforms, self._warnings = transforms, warnings
        self._matrices: dict[tuple[float, float], np.ndarray] = {}
        primvar = UsdGeom.PrimvarsAPI(instancer).GetPrimvar("displayColor")
        by_instance = primvar.HasValue() and primvar.GetInterpolation() != UsdGeom.Tokens.constant
        self._color_curve = flattened(primvar, warnings.file) if by_instance else None
        self._colors: tuple[float, np.ndarray | None] | None = None
        self._counted: tuple[float, int] | None = None
        self._shown: tuple[float, dict[str, bool]] = (float("nan"), {})
        if UsdGeom.PrimvarsAPI(instancer).GetPrimvar("displayOpacity").HasValue():
            warnings(f"{self.path}.primvars:displayOpacity", "displayOpacity is not rendered: the surface is opaque")
        self.span = self._span()

    @property
    def holds_meshes(self) -> bool:
        """Whether any prototype has a mesh, at any depth."""
        return self.holds(lambda mesh: True)

    def holds(self, wanted: Callable[[Usd.Prim], bool]) -> bool:
        """Whether any prototype has a mesh that is ``wanted``, at any depth."""
        return any(
            any(map(wanted, prototype.meshes)) or any(nested.holds(wanted) for nested in prototype.instancers)
            for prototype in self.prototypes
        )

    @property
    def holds_lights(self) -> bool:
        """Whether any prototype has a light, at any depth."""
        return any(
            prototype.lights or any(nested.holds_lights for nested in prototype.instancers)
            for prototype in self.prototypes
        )

    def placed_lights(self, frame: float) -> int:
        """How many lights it places at a time code, those of instancers in its prototypes included."""
        _, chosen = self.instances(frame)
        times = np.bincount(chosen, minlength=len(self.prototypes))
        total = 0
        for count, prototype in zip(times.tolist(), self.prototypes, strict=True):
            nested = sum(of.placed_lights(frame) for of in prototype.instancers) if count else 0
            total += count * (len(prototype.lights) + nested)
        return total

    def placed_meshes(self, frame: float) -> int:
        """How many meshes it places at a time code, those of instancers in its prototypes included."""
        if self._counted is None or self._counted[0] != frame:
            below = [
                len(prototype.meshes) + sum(of.placed_meshes(frame) for of in prototype.instancers)
                for prototype in self.prototypes
            ]
            _, chosen = self.instances(frame)
            times = np.bincount(chosen, minlength=len(below))
            self._counted = frame, sum(int(k) * meshes for k, meshes in zip(times, below, strict=True))
        return self._counted[1]

    def instances(self, frame: float) -> tuple[np.ndarray, np.ndarray]:
        """Indices and numbers of the prototypes of the instances not masked at a time code, shapes [n] and [n]."""
        none = np.zeros(0, np.int64), np.zeros(0, np.int64)
        if not self.prototypes:
            self._warnings(self.path, "has no prototypes and is left out")
            return none
        if not self.instancer.GetProtoIndicesAttr().HasValue():
            self._warnings(self.path, "has no protoIndices and is left out")
            return none
        try:
            chosen = indices_at(self.instancer.GetProtoIndicesAttr(), frame)
        except InputError as error:
            self._warnings(error.prim, f"{error.message}; until then the instancer is left out")
            return none
        known = (chosen >= 0) & (chosen < len(self.prototypes))
        if not known.all():
            self._warnings(
                f"{self.path}.protoIndices", "names prototypes that do not exist; those instances are left out"
            )
        mask = np.array(self.instancer.ComputeMaskAtTime(frame), dtype=bool)
        if len(mask) == 0:
            mask = np.ones(len(chosen), dtype=bool)
        if len(mask) != len(chosen):
            self._warnings(self.path, "has ids or masks that do not fit its protoIndices and is left out")
            return none
        shown = np.flatnonzero(mask & known)
        return shown, chosen[shown]

    def matrix(self, index: int, time: float, frame: float) -> np.ndarray:
        """Matrix of one instance to the instancer's own space, shape [4, 4], without its prototype's own transform.

        Raises:
            InputError: It cannot be used, or positions do not match ``protoIndices``.
        """
        return usable(self.matrices(time, frame)[index], time, f"{self.path}[{index}]", self._warnings.file)

    def matrices(self, time: float, frame: float) -> np.ndarray:
        """Those of all instances, as they are, shape [n, 4, 4].

        Raises:
            InputError: Positions do not match ``protoIndices``.
        """
        key = time, frame
        if key not in self._matrices:
            while len(self._matrices) >= MATRICES_KEPT:
                del self._matrices[next(iter(self._matrices))]
            self._matrices[key] = self._compute(time, frame)
        return self._matrices[key]

    def shows(self, prim: Usd.Prim, root: Usd.Prim, frame: float) -> bool:
        """Whether nothing from a prim up to its prototype's root is invisible at a time code.

        What lies above a prototype's root concerns the prototype where it stands, and not where it is placed.
        """
        if self._shown[0] != frame:
            self._shown = frame, {}
        known, path = self._shown[1], str(prim.GetPath())
        if path not in known:
            known[path] = _is_shown(prim, root, frame)
        return known[path]

    def colors(self, rows: np.ndarray, frame: float) -> np.ndarray | None:
        """The display colours [n, 3] that the instancer gives to instances at a time code; None where it does not."""
        if self._color_curve is None:
            return None
        if self._colors is None or self._colors[0] != frame:
            try:
                found = self._color_curve.at(frame)
            except InputError as error:
                self._warnings(error.prim, f"{error.message}; until then the colours are ignored")
                found = None
            self._colors = frame, found
        colors = self._colors[1]
        return colors[rows] if colors is not None and rows.max() < len(colors) else None

    def colors_alike(self, rows: np.ndarray, frame: float) -> bool:
        """Whether it gives colours to all of the instances, in increasing order, or to none of them."""
        return self.colors(rows, frame) is not None or self.colors(rows[:1], frame) is None

    def _compute(self, time: float, frame: float) -> np.ndarray:
        exclude, ignore = UsdGeom.PointInstancer.ExcludeProtoXform, UsdGeom.PointInstancer.IgnoreMask
        computed = self.instancer.ComputeInstanceTransformsAtTimes([time], frame, exclude, ignore)
        count = len(indices_at(self.instancer.GetProtoIndicesAttr(), frame))
        matrices = np.array(computed[0]) if len(computed) else np.zeros((0, 4, 4))
        if len(matrices) != count:
            raise InputError(
                f"do not match the {count} instances of protoIndices at time code {frame:g} (author one each)",
                self._warnings.file,
                f"{self.path}.positions",
            )
        if time != frame:
            self._warn_held(time, frame)
        return matrices

    def _warn_held(self, time: float, frame: float) -> None:
        positions = self.instancer.GetPositionsAttr()
        if self.instancer.GetVelocitiesAttr().HasAuthoredValue() or not positions.ValueMightBeTimeVarying():
            return
        times = positions.GetTimeSamples()
        low, high = min(time, frame), max(time, frame)
        first = max((t for t in times if t <= low), default=times[0])
        last = min((t for t in times if t >= high), default=times[-1])
        before, after = value_at(positions, first, ROWS), value_at(positions, last, ROWS)
        if before is not None and after is not None and len(before) != len(after):
            self._warnings(
                self.path,
                "its instances change in number within a shutter and it has no velocities: "
                "they are held over the shutter (author velocities to blur them)",
            )

    def _span(self) -> tuple[float, float] | None:
        of = self.instancer
        span = None
        attributes = (
            of.GetProtoIndicesAttr(),
            of.GetPositionsAttr(),
            of.GetOrientationsAttr(),
            of.GetOrientationsfAttr(),
            of.GetScalesAttr(),
            of.GetIdsAttr(),
        )
        rates = (of.GetVelocitiesAttr(), of.GetAngularVelocitiesAttr(), of.GetAccelerationsAttr())
        moving = any(rate.HasAuthoredValue() for rate in rates)
        for attribute in attributes:
            times = sample_times(attribute)
            if len(times) > 1 or (times and moving):
                span = union(span, (times[0], times[-1]))
        return span


class Below:
    """What the instances of a prim below one prototype have in common, where its instancer stands.

    Args:
        prim: The prim.
        root: Its prototype.
        instancer: The instancer.
        parent: Where that stands.
        transforms: Transforms of the stage.
    """

    def __init__(
        self, prim: Usd.Prim, root: Usd.Prim, instancer: Instancer, parent: Placement, transforms: Transforms
    ) -> None:
        self.instancer = instancer
        self._prim, self._root, self._parent, self._transforms = prim, root, parent, transforms
        inner = union(transforms.span(prim, root), transforms.own_span(root))
        self.span = union(union(inner, instancer.span), parent.span)
        self._worlds: dict[tuple[float, float], np.ndarray] = {}
        self._mirrored: tuple[float, np.ndarray] | None = None

    def worlds(self, time: float, frame: float) -> np.ndarray:
        """Local-to-world matrices of all instances, those of other prototypes too, shape [n, 4, 4]."""
        key = time, frame
        if key not in self._worlds:
            while len(self._worlds) >= WORLDS_KEPT:
                del self._worlds[next(iter(self._worlds))]
            inner = self._transforms.below(self._prim, self._root, time) @ self._transforms.own(self._root, time)
            with np.errstate(over="ignore", invalid="ignore"):
                self._worlds[key] = (inner @ self.instancer.matrices(time, frame)) @ self._parent.worlds(time, frame)
        return self._worlds[key]

    def mirrored(self, frame: float) -> np.ndarray:
        """Which instances their matrices mirror at a time code, shape [n]; none where these cannot be used."""
        if self._mirrored is None or self._mirrored[0] != frame:
            try:
                with np.errstate(invalid="ignore", over="ignore"):
                    found = np.linalg.det(self.worlds(frame, frame)[:, :3, :3]) < 0
            except InputError:
                # Said where the instances are placed.
                found = np.zeros(len(indices_at(self.instancer.instancer.GetProtoIndicesAttr(), frame)), bool)
            self._mirrored = frame, found
        return self._mirrored[1]

    @cached_property
    def jumps(self) -> tuple[Jump, ...]:
        of_instancer = self._transforms.jumps(self.instancer.instancer.GetPrim())
        return (*self._transforms.jumps(self._prim), *of_instancer, *self._parent.jumps())

    def visible(self, frame: float) -> bool:
        """Whether the instancer is visible, and what it places there."""
        return self._parent.visible(frame) and self.instancer.shows(self._prim, self._root, frame)


class OfInstances:
    """The placement of a prim below the prototype of one instance, or of several.

    Args:
        below: What they have in common.
        rows: Their indices, shape [n].
    """

    def __init__(self, below: Below, rows: np.ndarray) -> None:
        self._below, self.rows = below, rows
        self.span = below.span

    def worlds(self, time: float, frame: float) -> np.ndarray:
        if len(self.rows) == 1:
            # Asked first: it names the instance whose own matrix cannot be used.
            self._below.instancer.matrix(int(self.rows[0]), time, frame)
        return self._below.worlds(time, frame)[self.rows]

    def jumps(self) -> tuple[Jump, ...]:
        return self._below.jumps

    def visible(self, frame: float) -> bool:
        return self._below.visible(frame)

    def colors(self, frame: float) -> np.ndarray | None:
        return self._below.instancer.colors(self.rows, frame)


# Makes a placed mesh from its label, prim, placement, and the paths of what it stands for where that is many.
Make = Callable[[str, Usd.Prim, Placement, tuple[str, ...]], PlacedMesh]


class InstancedMeshes:
    """All meshes of one instancer on the stage, by frame.

    Args:
        instancer: The instancer.
        placement: Where it stands.
        make: Makes a placed mesh.
        may_be_specular: Whether a mesh may reflect or refract at a time code; such instances stay apart.
        transforms: Transforms of the stage.
    """

    def __init__(
        self,
        instancer: Instancer,
        placement: Placement,
        make: Make,
        may_be_specular: Callable[[Usd.Prim, float], bool],
        transforms: Transforms,
    ) -> None:
        self.instancer, self._placement, self._make, self._transforms = instancer, placement, make, transforms
        self._may_be_specular = may_be_specular
        self._common: dict[tuple[str, int], list[tuple[list, list]]] = {}
        self._made: dict[tuple[str, int, int], PlacedMesh] = {}
        self._together: dict[tuple[str, int], PlacedMesh] = {}

    def meshes(self, frame: float) -> Iterator[PlacedMesh]:
        """The meshes of every instance at a time code; the same objects on later calls.

        Many of one mesh come as one, each after those that are not mirrored.

        Raises:
            InputError: They are too many.
        """
        return self._all(frame, FEWEST_TOGETHER)

    def apart(self, frame: float) -> Iterator[PlacedMesh]:
        """The same, each instance on its own.

        Raises:
            InputError: They are too many.
        """
        return self._all(frame, None)

    def _all(self, frame: float, fewest: int | None) -> Iterator[PlacedMesh]:
        refuse_too_many(self.instancer.placed_meshes(frame), self.instancer.path)
        yield from self._below(self.instancer, self.instancer.path, self._placement, frame, fewest)

    def _below(
        self, instancer: Instancer, label: str, placement: Placement, frame: float, fewest: int | None
    ) -> Iterator[PlacedMesh]:
        common = self._common_below(instancer, label, placement)
        shown, chosen = instancer.instances(frame)
        apart: list[list] = []
        for number, (meshes, _) in enumerate(common):
            rows = shown[chosen == number]
            many = fewest is not None and len(rows) >= fewest and instancer.colors_alike(rows, frame)
            together = [entry for entry in meshes if many and not self._may_be_specular(entry[0], frame)]
            for entry in together:
                yield from self._joined(label, rows, *entry, frame)
            apart.append([entry for entry in meshes if entry not in together])
        left = np.array([bool(apart[number] or instancers) for number, (_, instancers) in enumerate(common)], bool)
        for index, number in zip(shown[left[chosen]], chosen[left[chosen]], strict=True):
            for mesh, name, below in apart[number]:
                # An instance may take another prototype, whose mesh of the same name is another.
                made = label, int(index), id(below)
                if made not in self._made:
                    self._made[made] = self._make(f"{label}[{index}]{name}", mesh, OfInstances(below, index[None]), ())
                yield self._made[made]
            for nested, name, below in common[number][1]:
                placement_of = OfInstances(below, index[None])
                yield from self._below(nested, f"{label}[{index}]{name}", placement_of, frame, fewest)

    def _joined(
        self, label: str, rows: np.ndarray, mesh: Usd.Prim, name: str, below: Below, frame: float
    ) -> Iterator[PlacedMesh]:
        """Instances of a mesh as one, known by the first of them, and those that are mirrored as another."""
        mirrored = below.mirrored(frame)[rows]
        for those in filter(len, (rows[~mirrored], rows[mirrored])):
            key = f"{label}[{those[0]}]{name}", id(below)
            known = self._together.get(key)
            if known is None or not np.array_equal(known.placement.rows, those):
                copies = tuple(f"{label}[{index}]{name}" for index in those)
                self._together[key] = self._make(key[0], mesh, OfInstances(below, those), copies)
            yield self._together[key]

    def _common_below(self, instancer: Instancer, label: str, placement: Placement) -> list[tuple[list, list]]:
        """What the instances of each prototype have in common: meshes, and instancers, with names and places."""

        def of(prim: Usd.Prim, root: Usd.Prim) -> tuple[str, Below]:
            return name_below(prim, root), Below(prim, root, instancer, placement, self._transforms)

        key = label, id(instancer)
        if key not in self._common:
            self._common[key] = [
                (
                    [(mesh, *of(mesh, prototype.root)) for mesh in prototype.meshes],
                    [(nested, *of(nested.instancer.GetPrim(), prototype.root)) for nested in prototype.instancers],
                )
                for prototype in instancer.prototypes
            ]
        return self._common[key]


def _is_shown(prim: Usd.Prim, root: Usd.Prim, frame: float) -> bool:
    while prim:
        attribute = UsdGeom.Imageable(prim).GetVisibilityAttr() if prim.IsA(UsdGeom.Imageable) else None
        if attribute and text_at(attribute, frame) == UsdGeom.Tokens.invisible:
            return False
        if prim == root:
            return True
        prim = prim.GetParent()
    return True


def name_below(prim: Usd.Prim, root: Usd.Prim) -> str:
    """What a prim below a prototype is called after its instance, from the prototype's own name on."""
    return str(prim.GetPath())[len(str(root.GetPath().GetParentPath()).rstrip("/")) :]
