"""Skeletons and blend shapes: what UsdSkel makes of the points and normals of a mesh at any time.

The points are those that ``UsdSkel.BakeSkinning`` would write: offset by blend shapes, skinned in the space of the
skeleton, and carried into that of the mesh; linear between frames and the samples of whatever deforms them.
"""

from __future__ import annotations

import math

import numpy as np
from pxr import Gf, Usd, UsdGeom, UsdSkel, Vt

from tpdwarp.usd.read.samples import sample_times
from tpdwarp.usd.read.transforms import Transforms

# Animations longer than this are looked at where they have samples alone.
MOST_FRAMES = 1_000_000
# Prototypes of instancers are often abstract, or lie below an over.
PREDICATE = Usd.TraverseInstanceProxies(Usd.PrimIsActive & Usd.PrimHasDefiningSpecifier & Usd.PrimIsLoaded)


Binding = tuple[UsdSkel.SkinningQuery, UsdSkel.SkeletonQuery, Usd.Prim]


class Deformation:
    """What a skeleton and blend shapes make of one mesh.

    Args:
        query: How the mesh is bound.
        skeleton: Its skeleton and what animates it.
        prim: The skeleton where it stands; ``skeleton`` knows that of the prototype alone.
        transforms: Transforms of the stage.

    Attributes:
        times: Sample times of all that deforms it, in increasing order; empty where nothing changes.
    """

    def __init__(
        self, query: UsdSkel.SkinningQuery, skeleton: UsdSkel.SkeletonQuery, prim: Usd.Prim, transforms: Transforms
    ) -> None:
        self._query, self._skeleton, self._skeleton_prim, self._transforms = query, skeleton, prim, transforms
        self._prim = query.GetPrim()
        self._animation = skeleton.GetAnimQuery()
        self._shapes = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(self._prim)) if query.HasBlendShapes() else None
        if self._shapes is not None:
            self._shape_points = self._shapes.ComputeBlendShapePointIndices()
            self._shape_offsets = self._shapes.ComputeSubShapePointOffsets()
        self.times = self._sample_times()

    def points(self, points: np.ndarray, time: float) -> np.ndarray:
        """The deformed points for authored ones, shapes [v, 3], at a time code."""
        code = Usd.TimeCode(time)
        found = Vt.Vec3fArray.FromNumpy(points.astype(np.float32))
        self._blend(found, code)
        if not self._query.HasJointInfluences():
            return np.array(found, dtype=np.float64)
        joints = self._skeleton.ComputeSkinningTransforms(code)
        if not joints or not self._query.ComputeSkinnedPoints(joints, found, code):
            return np.array(found, dtype=np.float64)
        to_mesh = self._to_mesh(code)
        return np.array(found, dtype=np.float64) @ to_mesh[:3, :3] + to_mesh[3, :3]

    def normals(self, normals: np.ndarray, points_of: np.ndarray, point_count: int, time: float) -> np.ndarray:
        """The deformed normals for authored ones, shapes [k, 3], not of unit length.

        Args:
            normals: Authored normals.
            points_of: The point that each belongs to, shape [k].
            point_count: Points of the mesh.
            time: Time code.
        """
        code = Usd.TimeCode(time)
        if len(normals) == point_count:
            normals = self._blended_normals(normals, code)
        if not self._query.HasJointInfluences():
            return normals
        joints = self._skeleton.ComputeSkinningTransforms(code)
        influences = self._query.ComputeVaryingJointInfluences(point_count, code)
        if not joints or not influences:
            return normals
        mapper = self._query.GetJointMapper()
        if mapper and not mapper.IsIdentity():
            order = len(self._query.GetJointOrder())
            joints = mapper.RemapTransforms(joints, Vt.Matrix4dArray(order, Gf.Matrix4d(1)))
        indices, weights = (np.array(part).reshape(point_count, -1)[points_of] for part in influences)
        turned = [_of_normals(matrix) for matrix in joints]
        found = Vt.Vec3fArray.FromNumpy(normals.astype(np.float32))
        method = self._query.GetSkinningMethod()
        bind = _of_normals(self._query.GetGeomBindTransform(code))
        flat = [Vt.IntArray.FromNumpy(np.ascontiguousarray(indices.ravel(), dtype=np.int32))]
        flat.append(Vt.FloatArray.FromNumpy(np.ascontiguousarray(weights.ravel(), dtype=np.float32)))
        UsdSkel.SkinNormals(method, bind, Vt.Matrix3dArray(turned), *flat, indices.shape[1], found)
        to_mesh = np.linalg.inv(self._to_mesh(code)[:3, :3]).T
        return np.array(found, dtype=np.float64) @ to_mesh

    def _blend(self, points: Vt.Vec3fArray, code: Usd.TimeCode) -> None:
        """Adds the offsets of blend shapes to ``points``, in place."""
        sub_shapes = self._sub_shapes(code)
        if sub_shapes is not None:
            self._shapes.ComputeDeformedPoints(*sub_shapes, self._shape_points, self._shape_offsets, points)

    def _blended_normals(self, normals: np.ndarray, code: Usd.TimeCode) -> np.ndarray:
        """One normal a point with the offsets of blend shapes that have them."""
        sub_shapes = self._sub_shapes(code)
        if sub_shapes is None:
            return normals
        found = Vt.Vec3fArray.FromNumpy(normals.astype(np.float32))
        for weight, shape, sub_shape in zip(*sub_shapes, strict=True):
            between = self._shapes.GetInbetween(sub_shape)
            whole = self._shapes.GetBlendShape(shape)
            offsets = between.GetNormalOffsets() if between else whole.GetNormalOffsetsAttr().Get()
            if offsets:
                UsdSkel.ApplyBlendShape(weight, offsets, self._shape_points[shape], found)
        return np.array(found, dtype=np.float64)

    def _sub_shapes(self, code: Usd.TimeCode) -> tuple[Vt.FloatArray, Vt.UIntArray, Vt.UIntArray] | None:
        """Weights of the blend shapes' parts with the numbers of shape and part; None where there are none."""
        if self._shapes is None or not self._animation:
            return None
        weights = self._animation.ComputeBlendShapeWeights(code)
        if not weights:
            return None
        mapper = self._query.GetBlendShapeMapper()
        return self._shapes.ComputeSubShapeWeights(mapper.Remap(weights) if mapper else weights)

    def _to_mesh(self, code: Usd.TimeCode) -> np.ndarray:
        """From the skeleton's space to the mesh's, shape [4, 4]."""
        skeleton = self._transforms.world(self._skeleton_prim, code.GetValue())
        return skeleton @ np.linalg.inv(self._transforms.world(self._prim, code.GetValue()))

    def _sample_times(self) -> list[float]:
        # USD's own times of a binding end in an error where it has no geomBindTransform.
        binding = UsdSkel.BindingAPI(self._prim)
        attributes = (
            UsdGeom.PointBased(self._prim).GetPointsAttr(),
            binding.GetGeomBindTransformAttr(),
            binding.GetJointIndicesAttr(),
            binding.GetJointWeightsAttr(),
        )
        times = {time for attribute in attributes if attribute for time in sample_times(attribute)}
        if self._animation:
            times |= {*self._animation.GetJointTransformTimeSamples()}
            if self._shapes is not None:
                times |= {*self._animation.GetBlendShapeWeightTimeSamples()}
        if self._query.HasJointInfluences():
            for prim in (self._prim, self._skeleton_prim):
                times |= self._transform_times(prim)
        if len(times) < 2:
            return []
        # Joints turn between their samples, and points do not move straight: as baking does, each frame is looked at.
        stage = self._prim.GetStage()
        first, last = min(times), max(times)
        phase = stage.GetStartTimeCode() % 1.0
        if last - first <= MOST_FRAMES:
            times |= {phase + k for k in range(math.ceil(first - phase), math.floor(last - phase) + 1)}
        return sorted(times)

    def _transform_times(self, prim: Usd.Prim) -> set[float]:
        """Sample times of the transforms from ``prim`` up to the SkelRoot, which moves mesh and skeleton alike."""
        times: set[float] = set()
        while prim and not prim.IsPseudoRoot() and not prim.IsA(UsdSkel.Root):
            for op in UsdGeom.Xformable(prim).GetOrderedXformOps() if prim.IsA(UsdGeom.Xformable) else ():
                found = sample_times(op.GetAttr())
                times |= {*found} if len(found) > 1 else set()
            prim = prim.GetParent()
        return times


class Skeletons:
    """The bindings of meshes to skeletons on a stage.

    Args:
        transforms: Transforms of the stage.
    """

    def __init__(self, transforms: Transforms) -> None:
        self._transforms = transforms
        self._bound: dict[str, dict[str, Binding]] = {}

    def deformation(self, prim: Usd.Prim) -> Deformation | None:
        """What deforms a mesh; None where nothing does, as outside a SkelRoot (baked stages keep their bindings)."""
        root = prim
        while root and not root.IsA(UsdSkel.Root):
            root = root.GetParent()
        if not root:
            return None
        key = str(root.GetPath())
        if key not in self._bound:
            self._bound[key] = self._bindings(UsdSkel.Root(root))
        found = self._bound[key].get(str(prim.GetPath()))
        return None if found is None else Deformation(*found, self._transforms)

    def _bindings(self, root: UsdSkel.Root) -> dict[str, Binding]:
        cache = UsdSkel.Cache()
        cache.Populate(root, PREDICATE)
        bound = {}
        for binding in cache.ComputeSkelBindings(root, PREDICATE):
            skeleton = cache.GetSkelQuery(binding.GetSkeleton())
            for query in binding.GetSkinningTargets() if skeleton else ():
                bound[str(query.GetPrim().GetPath())] = query, skeleton, binding.GetSkeleton().GetPrim()
        return bound


def _of_normals(matrix: Gf.Matrix4d) -> Gf.Matrix3d:
    """What a transform does to normals."""
    return matrix.ExtractRotationMatrix().GetInverse().GetTranspose()
