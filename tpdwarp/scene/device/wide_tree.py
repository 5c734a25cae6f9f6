"""Trees of triangles for rays on the CPU, eight wide, made of those that Warp builds.

The nodes of Warp's binary tree are opened from the root, the widest box first, until each has eight children, and
subtrees of no more than eight triangles become blocks of their corners (:mod:`tpdwarp.scene.device.ray_tree`). As
points move, the boxes of blocks follow them and those of nodes follow these, from the last node to the first; where
part of the meshes move, only what stands above them.
"""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.scene.device.ray_tree import BLOCK_FLOATS, MOST_LEVELS, NODE_FLOATS, WIDTH, RayTree

# Blocks of a launch that only copies, at least: to begin one takes as long as to copy thousands of corners.
LEAST_COPIED = 1 << 11
# Trees of fewer triangles follow their points whole: it takes less than a millisecond. Chosen, not derived.
FOLLOWED_IN_PARTS = 1 << 14
# Of how many sets of moving parts it is known for longer than a frame what stands above them. Chosen, not derived.
MOST_KNOWN = 16


@wp.func_native(f"""
    using namespace wp;
    const BVH& tree = mesh_get(mesh).bvh;
    const auto* lowers = tree.node_lowers;
    const auto* uppers = tree.node_uppers;
    int first, last;
    const auto is_block = [&](int node) {{
        int left = node, right = node;
        while (!lowers[left].b) left = lowers[left].i;
        while (!lowers[right].b) right = uppers[right].i;
        first = lowers[left].i, last = uppers[right].i;
        return last - first <= {WIDTH};
    }};
    const auto half_area = [&](int node) {{
        const float x = uppers[node].x - lowers[node].x, y = uppers[node].y - lowers[node].y;
        const float z = uppers[node].z - lowers[node].z;
        return x * y + y * z + z * x;
    }};
    int nodes = 1, blocks = 0, levels = 0, next_level = 0;
    opened[0] = *tree.root;
    for (int node = 0; node < nodes; ++node) {{
        if (node == next_level) next_level = nodes, ++levels;
        int child[{WIDTH}] = {{opened[node]}}, children = 1;
        bool block[{WIDTH}] = {{is_block(child[0])}};
        while (children < {WIDTH}) {{
            int widest = -1;
            for (int i = 0; i < children; ++i)
                if (!block[i] && !lowers[child[i]].b && (widest < 0 || half_area(child[i]) > half_area(child[widest])))
                    widest = i;
            if (widest < 0) break;
            const int open = child[widest];
            child[widest] = lowers[open].i, block[widest] = is_block(lowers[open].i);
            child[children] = uppers[open].i, block[children] = is_block(uppers[open].i);
            ++children;
        }}
        for (int i = 0; i < {WIDTH}; ++i) {{
            const int slot = {WIDTH} * node + i;
            links[slot] = -1;
            if (i < children && block[i]) {{
                is_block(child[i]);
                for (int k = 0; k < {WIDTH}; ++k)
                    faces[{WIDTH} * blocks + k] = first + k < last ? tree.primitive_indices[first + k] : -1;
                slots[blocks] = slot;
                links[slot] = -2 - blocks++;
            }} else if (i < children && lowers[child[i]].b) {{
                counts[2] = {MOST_LEVELS + 1};
                return;
            }} else if (i < children) {{
                opened[nodes] = child[i];
                links[slot] = nodes++;
            }}
        }}
    }}
    counts[0] = nodes, counts[1] = blocks, counts[2] = levels;
""")
def make_wide(
    mesh: wp.uint64,
    opened: wp.array(dtype=wp.int32),
    slots: wp.array(dtype=wp.int32),
    links: wp.array(dtype=wp.int32),
    faces: wp.array(dtype=wp.int32),
    counts: wp.array(dtype=wp.int32),
):
    """Opens the nodes of Warp's tree, breadth first; leaves that are larger than a block count as too many levels."""
    ...


@wp.func_native(f"""
    using namespace wp;
    const int* face = &faces[{WIDTH} * block];
    float* corner = &corners[{BLOCK_FLOATS} * block];
    float box[6];
    for (int side = 0; side < 6; ++side) box[side] = side < 3 ? FLT_MAX : -FLT_MAX;
    for (int i = 0; i < {WIDTH}; ++i)
        for (int k = 0; k < 3; ++k) {{
            // No ray meets what is not a number.
            vec3 point = vec3(__builtin_nanf(""), __builtin_nanf(""), __builtin_nanf(""));
            if (face[i] >= 0) point = points[indices[3 * face[i] + k]];
            for (int axis = 0; axis < 3; ++axis) {{
                const float at = point[axis];
                corner[{WIDTH} * (3 * k + axis) + i] = at;
                box[axis] = at < box[axis] ? at : box[axis];
                box[3 + axis] = at > box[3 + axis] ? at : box[3 + axis];
            }}
        }}
    float* own = &boxes[{NODE_FLOATS} * (slots[block] / {WIDTH}) + slots[block] % {WIDTH}];
    for (int side = 0; side < 6; ++side) own[{WIDTH} * side] = box[side];
""")
def copy_block(
    block: int,
    points: wp.array(dtype=wp.vec3),
    indices: wp.array(dtype=wp.int32),
    faces: wp.array(dtype=wp.int32),
    slots: wp.array(dtype=wp.int32),
    corners: wp.array(dtype=wp.float32),
    boxes: wp.array(dtype=wp.float32),
):
    """Takes the corners of a block from the points, and its box."""
    ...


@wp.func_native(f"""
    using namespace wp;
    typedef float Floats __attribute__((ext_vector_type({WIDTH})));
    typedef float Stored __attribute__((ext_vector_type({WIDTH}), aligned(4)));
    const int count = nodes.shape[0] ? nodes.shape[0] : links.shape[0] / {WIDTH};
    double before = 0.0, after = 0.0;
    const auto half_area = [](const float* box) {{
        const float x = box[3 * {WIDTH}] - box[0], y = box[4 * {WIDTH}] - box[{WIDTH}];
        const float z = box[5 * {WIDTH}] - box[2 * {WIDTH}];
        return (double)x * y + (double)y * z + (double)z * x;
    }};
    for (int number = count - 1; number >= 0; --number) {{
        const int node = nodes.shape[0] ? nodes[number] : number;
        for (int i = 0; i < {WIDTH}; ++i) {{
            const int link = links[{WIDTH} * node + i];
            float* box = &boxes[{NODE_FLOATS} * node + i];
            if (link == -1)
                for (int side = 0; side < 6; ++side) box[{WIDTH} * side] = side < 3 ? FLT_MAX : -FLT_MAX;
            if (link < 0) continue;
            before += half_area(box);
            const float* inner = &boxes[{NODE_FLOATS} * link];
            for (int side = 0; side < 6; ++side) {{
                const Floats of = *(const Stored*)(inner + {WIDTH} * side);
                box[{WIDTH} * side] = side < 3 ? __builtin_reduce_min(of) : __builtin_reduce_max(of);
            }}
            after += half_area(box);
        }}
    }}
    areas[0] = before, areas[1] = after;
""")
def follow_blocks(
    nodes: wp.array(dtype=wp.int32),
    links: wp.array(dtype=wp.int32),
    boxes: wp.array(dtype=wp.float32),
    areas: wp.array(dtype=wp.float64),
):
    """Makes the boxes of ``nodes``, of all where there are none, from those below them; sums half areas of those that
    are nodes themselves, before and after. What is no child has a box that no ray meets."""
    ...


@wp.kernel(enable_backward=False)
def make_wide_tree(
    base: int,
    mesh: wp.uint64,
    opened: wp.array(dtype=wp.int32),
    slots: wp.array(dtype=wp.int32),
    links: wp.array(dtype=wp.int32),
    faces: wp.array(dtype=wp.int32),
    counts: wp.array(dtype=wp.int32),
):
    make_wide(mesh, opened, slots, links, faces, counts)


@wp.kernel(enable_backward=False)
def copy_blocks(
    base: int,
    chosen: wp.array(dtype=wp.int32),
    points: wp.array(dtype=wp.vec3),
    indices: wp.array(dtype=wp.int32),
    faces: wp.array(dtype=wp.int32),
    slots: wp.array(dtype=wp.int32),
    corners: wp.array(dtype=wp.float32),
    boxes: wp.array(dtype=wp.float32),
):
    block = base + wp.tid()
    if chosen.shape[0] > 0:
        block = chosen[block]
    copy_block(block, points, indices, faces, slots, corners, boxes)


@wp.kernel(enable_backward=False)
def follow_all_blocks(
    base: int,
    nodes: wp.array(dtype=wp.int32),
    links: wp.array(dtype=wp.int32),
    boxes: wp.array(dtype=wp.float32),
    areas: wp.array(dtype=wp.float64),
):
    follow_blocks(nodes, links, boxes, areas)


@dataclass(eq=False)
class _Above:
    """What stands above some triangles: blocks, and nodes in their order; none of either for all there are.

    ``area`` is the sum of the boxes' half areas as they were built, ``grown`` how many times as much it has become.
    """

    blocks: wp.array
    nodes: wp.array
    area: float | None = None
    grown: float = 1.0


@dataclass(eq=False)
class _SharedMesh:
    """Warp's mesh of trees beside each other, which stands where the one of them does that asked for it last.

    ``boxes`` are those of that tree: it has this itself, and a circle would keep both.
    """

    mesh: wp.Mesh
    boxes: wp.array | None

    def left_by(self, tree: RayTree) -> None:
        """Says that a tree has moved."""
        if self.boxes is tree.boxes:
            self.boxes = None

    def at(self, points: wp.array, tree: RayTree) -> wp.Mesh:
        """The mesh at the points of a tree."""
        if self.boxes is not tree.boxes:
            self.mesh.points, self.boxes = points, tree.boxes
        return self.mesh


class WideTree:
    """The tree of a mesh.

    Attributes:
        tree: For kernels.
        points: Where it stands, shape [n] of vec3.

    Args:
        mesh: Whose tree it is.
        launcher: Its device.
        ends: Where the vertices and the triangles of each part of it end that moves as one, shape [m, 2]; parts have no
            vertices in common. None for one part.
    """

    def __init__(self, mesh: wp.Mesh, launcher: Launcher, ends: np.ndarray | None = None) -> None:
        self.points: wp.array = mesh.points
        self._launcher = launcher
        triangles = len(mesh.indices) // 3
        self._ends = np.array([[len(mesh.points), triangles]]) if ends is None else ends
        self._above: dict[tuple[int, ...], _Above] = {}
        self._slots = nothing = launcher.zeros(0, wp.int32)
        self.tree = RayTree()
        self.tree.mesh = mesh.id
        self.tree.boxes = self.tree.corners = launcher.zeros(0, wp.float32)
        self.tree.links = self.tree.faces = nothing
        self._mesh = _SharedMesh(mesh, self.tree.boxes)
        if launcher.device.is_cuda:
            return
        # Room for the worst, of which memory is taken up only as it is written.
        most = triangles + 1
        opened, slots, counts = (launcher.empty(n, wp.int32) for n in (most, most, 3))
        links, faces = (launcher.empty(WIDTH * most, wp.int32) for _ in range(2))
        launcher(make_wide_tree, 1, [mesh.id, opened, slots, links, faces, counts])
        nodes, blocks, levels = map(int, counts.numpy())
        if levels > MOST_LEVELS:
            return
        self._slots = slots[:blocks]
        self.tree.links, self.tree.faces = links[: WIDTH * nodes], faces[: WIDTH * blocks]
        self._make_room()
        self._mesh.boxes = self.tree.boxes
        self._follow(())

    def _make_room(self) -> None:
        self._areas = self._launcher.zeros(2, wp.float64)
        self.tree.boxes = self._launcher.zeros(NODE_FLOATS // WIDTH * len(self.tree.links), wp.float32)
        self.tree.corners = self._launcher.empty(BLOCK_FLOATS * len(self._slots), wp.float32)

    def beside(self, points: wp.array) -> WideTree | None:
        """A tree of the same triangles that stands elsewhere, made for a tenth of what building one takes.

        Warp's mesh is one for both, and stands where it was asked for last. None where there is no tree but that.

        Args:
            points: Where, shape [n] of vec3; they become its own.
        """
        if not len(self.tree.links):
            return None
        other = copy(self)
        other.points, other.tree = points, RayTree()
        other.tree.mesh, other.tree.links, other.tree.faces = self.tree.mesh, self.tree.links, self.tree.faces
        other._above = {(): replace(self._above[()])}
        other._make_room()
        other._follow(())
        return other

    @property
    def mesh(self) -> wp.Mesh:
        """Warp's mesh, whose own tree follows where it is asked for."""
        return self._mesh.at(self.points, self.tree)

    @property
    def grown(self) -> float:
        """How many times as large as when they were built boxes have become, where they have grown the most.

        Infinite where that is not known: of Warp's own tree, and where many sets of parts move one after the other.
        """
        known = 0 < len(self._above) <= MOST_KNOWN
        return max(above.grown for above in self._above.values()) if known else math.inf

    def move(self, points: wp.array, moved: tuple[int, ...] | None = None) -> None:
        """Moves the mesh and its tree to ``points`` on the device, shape [n] of vec3, which become its own.

        Args:
            moved: The parts of it that may stand elsewhere; None where that is not known.
        """
        if not len(self.tree.links):
            self._mesh.mesh.points = self.points = points
            return
        if moved is None:
            moved = self._changed(points)
        self.points = points
        self._mesh.left_by(self.tree)
        if moved:
            self._follow(moved)

    def _changed(self, points: wp.array) -> tuple[int, ...]:
        """The parts that stand elsewhere at ``points``; all of them where there is one, or the tree is small."""
        if len(self._ends) == 1 or self._ends[-1, 1] < FOLLOWED_IN_PARTS:
            return tuple(range(len(self._ends)))
        # By bits, so that what is no number is compared too.
        old, new = (of.numpy().view(np.int32) for of in (self.points, points))
        begins = np.append(0, self._ends[:-1, 0])
        spans = enumerate(zip(begins, self._ends[:, 0], strict=True))
        return tuple(number for number, (a, b) in spans if not np.array_equal(old[a:b], new[a:b]))

    def _follow(self, moved: tuple[int, ...]) -> None:
        """Has blocks and nodes above some parts follow their points; above all, for no parts or most of them."""
        tree, above = self.tree, self._above_of(moved)
        blocks = len(above.blocks) or len(self._slots)
        given = [above.blocks, self.points, self._mesh.mesh.indices, tree.faces, self._slots, tree.corners, tree.boxes]
        self._launcher(copy_blocks, blocks, given, LEAST_COPIED)
        self._launcher(follow_all_blocks, 1, [above.nodes, tree.links, tree.boxes, self._areas])
        before, after = map(float, self._areas.numpy())
        if above.area is None:
            above.area = before if len(above.nodes) else after
        above.grown = after / above.area if above.area > 0.0 else 1.0

    def _above_of(self, moved: tuple[int, ...]) -> _Above:
        counts = np.diff(self._ends[:, 1], prepend=0)
        if not moved or 2 * counts[list(moved)].sum() > counts.sum():
            moved = ()
        if moved not in self._above:
            nothing = self._launcher.zeros(0, wp.int32)
            self._above[moved] = self._found_above(moved, counts) if moved else _Above(nothing, nothing)
        return self._above[moved]

    def _found_above(self, moved: tuple[int, ...], counts: np.ndarray) -> _Above:
        links, faces = self.tree.links.numpy(), self.tree.faces.numpy()
        is_moved = np.append(np.repeat(np.isin(np.arange(len(counts)), moved), counts), False)
        blocks = np.flatnonzero(is_moved[faces].reshape(-1, WIDTH).any(axis=1))
        slots = np.flatnonzero(links > 0)
        parents = np.zeros(len(links) // WIDTH, np.int32)
        parents[links[slots]] = slots // WIDTH
        found = np.zeros(len(parents), bool)
        level = self._slots.numpy()[blocks] // WIDTH
        while len(level := np.unique(level)) and not found[level].all():
            found[level] = True
            level = parents[level]
        lists = (blocks, np.flatnonzero(found))
        return _Above(*(self._launcher.array(of.astype(np.int32), wp.int32) for of in lists))
