"""Local-to-world transforms of prims at any time, linear as USD has them or with cubic xformOps."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom

from tpdwarp.errors import InputError, WarnOnce
from tpdwarp.usd.read.diagnostics import errors_at, first_error
from tpdwarp.usd.read.jumps import Jump, jumps_of
from tpdwarp.usd.read.motion_breaks import moves
from tpdwarp.usd.read.samples import SampledArray, of_attribute, sample_times
from tpdwarp.usd.read.values import texts_at

# Beyond this numbers in a transform are refused: their squares, and those of points times them, stay numbers.
LARGEST = 1e30

AXES = {"X": Gf.Vec3d.XAxis(), "Y": Gf.Vec3d.YAxis(), "Z": Gf.Vec3d.ZAxis()}
CACHES_KEPT = 8
# What stands before the name of an xformOp in xformOpOrder whose inverse is meant.
INVERTED = "!invert!"


class Transforms:
    """Row-vector matrices (as USD stores them) of a stage's prims.

    An xformOp that USD cannot make a matrix of counts as none, as USD has it, and is warned about.

    Args:
        warnings: Takes such xformOps; without, they are errors.
        cubic: Whether numeric xformOps (all but ``orient``, which stays a spherical interpolation) are interpolated
            by the cubic Hermite through their samples. Splines are evaluated as authored either way.
    """

    def __init__(self, cubic: bool, warnings: WarnOnce | None = None) -> None:
        self.cubic = cubic
        self._warnings = warnings
        self._caches: dict[float, UsdGeom.XformCache] = {}
        self._locals: dict[str, _LocalTransform] = {}
        self._jumps: dict[str, tuple[Jump, ...]] = {}
        self._spans: dict[str, tuple[float, float] | None] = {}

    def world(self, prim: Usd.Prim, time: float) -> np.ndarray:
        """Local-to-world matrix, shape [4, 4].

        Raises:
            InputError: It is not usable.
        """
        if self.cubic:
            return self._composed(prim, time, None)
        try:
            found = np.array(self._cache(time).GetLocalToWorldTransform(prim))
        except Tf.ErrorException:
            found = self._composed(prim, time, None)
        return usable(found, time, prim.GetPath())

    def below(self, prim: Usd.Prim, ancestor: Usd.Prim, time: float) -> np.ndarray:
        """Matrix from ``prim`` to ``ancestor``'s own space, shape [4, 4]; identity for the ancestor itself."""
        if prim == ancestor:
            return np.eye(4)
        if self.cubic:
            return self._composed(prim, time, ancestor)
        try:
            found = np.array(self._cache(time).ComputeRelativeTransform(prim, ancestor)[0])
        except Tf.ErrorException:
            found = self._composed(prim, time, ancestor)
        return usable(found, time, prim.GetPath())

    def own(self, prim: Usd.Prim, time: float) -> np.ndarray:
        """The prim's own local matrix, shape [4, 4]."""
        with errors_at(prim.GetPath()):
            return usable(self._local(prim).at(time), time, prim.GetPath())

    def own_span(self, prim: Usd.Prim) -> tuple[float, float] | None:
        """First and last sample time of the prim's own local matrix; None where it cannot vary."""
        return self._local(prim).span

    def span(self, prim: Usd.Prim, ancestor: Usd.Prim | None = None) -> tuple[float, float] | None:
        """First and last sample time of the transforms above ``prim`` (up to but without ``ancestor``).

        None where nothing can vary.
        """
        if not prim or prim.IsPseudoRoot() or (ancestor is not None and prim == ancestor):
            return None
        key = f"{prim.GetPath()} {ancestor.GetPath() if ancestor is not None else ''}"
        if key not in self._spans:
            local = self._local(prim)
            above = None if local.resets else self.span(prim.GetParent(), ancestor)
            self._spans[key] = union(local.span, above)
        return self._spans[key]

    def jumps(self, prim: Usd.Prim) -> tuple[Jump, ...]:
        """Pairs of times between which ``prim``, or what it lies below, jumps."""
        if not prim or prim.IsPseudoRoot():
            return ()
        key = str(prim.GetPath())
        if key not in self._jumps:
            own = [jump for a in prim.GetAuthoredAttributes() if moves(a) for jump in jumps_of(a.GetTimeSamples())]
            self._jumps[key] = (*own, *self.jumps(prim.GetParent()))
        return self._jumps[key]

    def _cache(self, time: float) -> UsdGeom.XformCache:
        if time not in self._caches:
            while len(self._caches) >= CACHES_KEPT:
                del self._caches[next(iter(self._caches))]
            self._caches[time] = UsdGeom.XformCache(time)
        return self._caches[time]

    def _composed(self, prim: Usd.Prim, time: float, ancestor: Usd.Prim | None) -> np.ndarray:
        matrix, path = np.eye(4), prim.GetPath()
        while prim and not prim.IsPseudoRoot() and not (ancestor is not None and prim == ancestor):
            local = self._local(prim)
            with errors_at(prim.GetPath()):
                matrix = matrix @ usable(local.at(time), time, prim.GetPath())
            if local.resets:
                break
            prim = prim.GetParent()
        return usable(matrix, time, path)

    def _local(self, prim: Usd.Prim) -> _LocalTransform:
        key = str(prim.GetPath())
        if key not in self._locals:
            with errors_at(key):
                self._locals[key] = _LocalTransform(UsdGeom.Xformable(prim), self.cubic, self._warnings)
        return self._locals[key]


def usable(matrix: np.ndarray, time: float, prim: Sdf.Path | str, file: str = "") -> np.ndarray:
    """A transform [4, 4] of ``prim`` as it is.

    Raises:
        InputError: No geometry survives it: it holds NaN, infinity or a number beyond ``LARGEST``.
    """
    if not np.abs(matrix).max() <= LARGEST:
        what = "NaN or infinity" if not np.isfinite(matrix).all() else f"numbers beyond {LARGEST:g}"
        raise InputError(f"its transform holds {what} at time code {time:g} (author finite xformOps)", file, str(prim))
    return matrix


def union(first: tuple[float, float] | None, second: tuple[float, float] | None) -> tuple[float, float] | None:
    """The smallest span that holds both; None holds nothing."""
    if first is None or second is None:
        return first or second
    return min(first[0], second[0]), max(first[1], second[1])


class _LocalTransform:
    """The xformOps of one prim."""

    def __init__(self, xformable: UsdGeom.Xformable, cubic: bool, warnings: WarnOnce | None) -> None:
        self._warnings = warnings
        self.span: tuple[float, float] | None = None
        self.resets = False
        self._ops: list[tuple[UsdGeom.XformOp, SampledArray | None]] = []
        self._still: np.ndarray | None = None
        if not xformable:
            return
        self.resets = xformable.GetResetXformStack()
        for op in self._ordered(xformable):
            attribute = op.GetAttr()
            times = sample_times(attribute) if op.MightBeTimeVarying() else []
            if len(times) > 1:
                self.span = union(self.span, (times[0], times[-1]))
            numeric = op.GetOpType() != UsdGeom.XformOp.TypeOrient and not attribute.HasSpline()
            curve = of_attribute(attribute, cubic=True) if cubic and numeric and len(times) > 1 else None
            self._ops.append((op, curve))

    def at(self, time: float) -> np.ndarray:
        if self.span is None and self._still is not None:
            return self._still
        matrix = np.eye(4)
        for op, curve in reversed(self._ops):
            value = None if curve is None else curve.at(time)
            # Without a value at this time (it may be blocked), the op does what USD makes of that: nothing.
            found = self._stored(op, time) if value is None else _op_matrix(op, value)
            with np.errstate(over="ignore", invalid="ignore"):
                matrix = matrix @ found
        self._still = matrix
        return matrix

    def _stored(self, op: UsdGeom.XformOp, time: float) -> np.ndarray:
        """The matrix USD makes of an op's value."""
        try:
            return np.array(op.GetOpTransform(time))
        except Tf.ErrorException as error:
            if self._warnings is None:
                raise
            found = f"{first_error(error)} (author what its name says)"
            self._warnings(str(op.GetAttr().GetPath()), found, "bad xformOps")
            return np.eye(4)

    def _ordered(self, xformable: UsdGeom.Xformable) -> list[UsdGeom.XformOp]:
        """The ops in their order, without those that are not there."""
        try:
            return xformable.GetOrderedXformOps()
        except Tf.ErrorException as error:
            if self._warnings is None:
                raise
            order = xformable.GetXformOpOrderAttr()
            left_out = f"{first_error(error)} It is left out (correct the order)"
            self._warnings(str(order.GetPath()), left_out, "no xformOps")
            found = []
            for name in texts_at(order):
                attribute = xformable.GetPrim().GetAttribute(name.removeprefix(INVERTED))
                with suppress(Tf.ErrorException):
                    found += [UsdGeom.XformOp(attribute, name.startswith(INVERTED))] if attribute else []
            return found


def _op_matrix(op: UsdGeom.XformOp, value: np.ndarray) -> np.ndarray:
    """An xformOp's matrix for a given value, as ``XformOp.GetOpTransform`` has it for a stored one."""
    kind = str(op.GetOpType()).split("Type")[-1]
    if kind == "Transform":
        matrix = value
    elif kind.startswith(("Translate", "Scale")):
        default, axis = (0.0, kind[9:]) if kind.startswith("Translate") else (1.0, kind[5:])
        vector = np.full(3, default)
        vector["XYZ".index(axis) if axis else slice(None)] = value
        matrix = np.eye(4)
        if default:
            np.fill_diagonal(matrix[:3, :3], vector)
        else:
            matrix[3, :3] = vector
    else:
        matrix = np.eye(4)
        for axis in kind.removeprefix("Rotate"):
            angle = float(value) if value.ndim == 0 else float(value["XYZ".index(axis)])
            matrix = matrix @ np.array(Gf.Matrix4d().SetRotate(Gf.Rotation(AXES[axis], angle)))
    return np.linalg.inv(matrix) if op.IsInverseOp() else matrix


def transform_points(points: np.ndarray, matrices: np.ndarray) -> np.ndarray:
    """Points [k, 3] carried by row-vector matrices [n, 4, 4], those of one after those of the other, [n k, 3].

    What one matrix leaves where it is, is not copied: large meshes often stand in the world's own space.
    """
    if len(matrices) == 1 and np.array_equal(matrices[0], np.eye(4)):
        return points
    carried = points @ matrices[:, :3, :3]
    carried += matrices[:, 3:, :3]
    return carried.reshape(-1, 3)
