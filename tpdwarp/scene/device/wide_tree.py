"""Trees of triangles for rays on the CPU, eight wide, made of those that Warp builds and refits.

The nodes of Warp's binary tree are opened from the root, the widest box first, until each has eight children, and
subtrees of no more than eight triangles become blocks of their corners (:mod:`tpdwarp.scene.device.ray_tree`).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.scene.device.ray_tree import BLOCK_FLOATS, MOST_LEVELS, NODE_FLOATS, WIDTH, RayTree

# Items of a launch that only copies, at least: to begin one takes as long as to copy thousands.
LEAST_COPIED = 1 << 14


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
            sources[slot] = i < children ? child[i] : -1;
            links[slot] = -1;
            if (i < children && block[i]) {{
                is_block(child[i]);
                for (int k = 0; k < {WIDTH}; ++k)
                    faces[{WIDTH} * blocks + k] = first + k < last ? tree.primitive_indices[first + k] : -1;
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
    sources: wp.array(dtype=wp.int32),
    links: wp.array(dtype=wp.int32),
    faces: wp.array(dtype=wp.int32),
    counts: wp.array(dtype=wp.int32),
):
    """Opens the nodes of Warp's tree, breadth first; leaves that are larger than a block count as too many levels."""
    ...


@wp.func_native(f"""
    using namespace wp;
    const BVH& tree = mesh_get(mesh).bvh;
    float* box = &boxes[{NODE_FLOATS} * (slot / {WIDTH}) + slot % {WIDTH}];
    const int node = sources[slot];
    const auto lower = tree.node_lowers[node < 0 ? 0 : node], upper = tree.node_uppers[node < 0 ? 0 : node];
    const float least[3] = {{lower.x, lower.y, lower.z}}, greatest[3] = {{upper.x, upper.y, upper.z}};
    for (int axis = 0; axis < 3; ++axis) {{
        box[{WIDTH} * axis] = node < 0 ? FLT_MAX : least[axis];
        box[{WIDTH} * (3 + axis)] = node < 0 ? -FLT_MAX : greatest[axis];
    }}
""")
def copy_box(
    mesh: wp.uint64, sources: wp.array(dtype=wp.int32), boxes: wp.array(dtype=wp.float32), slot: int
):
    """Takes the box of one child from Warp's tree; what is no child has a box that no ray meets."""
    ...


@wp.kernel(enable_backward=False)
def make_wide_tree(
    base: int,
    mesh: wp.uint64,
    opened: wp.array(dtype=wp.int32),
    sources: wp.array(dtype=wp.int32),
    links: wp.array(dtype=wp.int32),
    faces: wp.array(dtype=wp.int32),
    counts: wp.array(dtype=wp.int32),
):
    make_wide(mesh, opened, sources, links, faces, counts)


@wp.kernel(enable_backward=False)
def copy_boxes(base: int, mesh: wp.uint64, sources: wp.array(dtype=wp.int32), boxes: wp.array(dtype=wp.float32)):
    copy_box(mesh, sources, boxes, base + wp.tid())


@wp.kernel(enable_backward=False)
def copy_corners(
    base: int,
    points: wp.array(dtype=wp.vec3),
    indices: wp.array(dtype=wp.int32),
    faces: wp.array(dtype=wp.int32),
    corners: wp.array(dtype=wp.float32),
):
    slot = base + wp.tid()
    face = faces[slot]
    first = wp.static(BLOCK_FLOATS) * (slot // WIDTH) + slot % WIDTH
    for corner in range(3):
        # No ray meets what is not a number.
        point = wp.vec3(wp.nan, wp.nan, wp.nan)
        if face >= 0:
            point = points[indices[3 * face + corner]]
        for axis in range(3):
            corners[first + WIDTH * (3 * corner + axis)] = point[axis]


@dataclass(frozen=True, eq=False)
class WideTree:
    """The tree of a mesh.

    Attributes:
        mesh: Whose tree it is; its own tree stays in use.
        tree: For kernels.
    """

    mesh: wp.Mesh
    tree: RayTree
    _sources: wp.array = field(repr=False)
    _launcher: Launcher = field(repr=False)

    @classmethod
    def of(cls, mesh: wp.Mesh, launcher: Launcher) -> WideTree:
        """The tree of ``mesh`` as it stands."""
        tree = RayTree()
        tree.mesh = mesh.id
        nothing = launcher.zeros(0, wp.int32)
        tree.boxes = tree.corners = launcher.zeros(0, wp.float32)
        tree.links = tree.faces = nothing
        if launcher.device.is_cuda:
            return cls(mesh, tree, nothing, launcher)
        # Room for the worst, of which memory is taken up only as it is written.
        most = len(mesh.indices) // 3 + 1
        opened, counts = (wp.empty(n, dtype=wp.int32, device=launcher.device) for n in (most, 3))
        sources, links, faces = (
            wp.empty(WIDTH * most, dtype=wp.int32, device=launcher.device) for _ in range(3)
        )
        launcher(make_wide_tree, 1, [mesh.id, opened, sources, links, faces, counts])
        nodes, blocks, levels = map(int, counts.numpy())
        if levels > MOST_LEVELS:
            return cls(mesh, tree, nothing, launcher)
        tree.links, tree.faces = links[: WIDTH * nodes], faces[: WIDTH * blocks]
        tree.boxes = wp.empty(NODE_FLOATS * nodes, dtype=wp.float32, device=launcher.device)
        tree.corners = wp.empty(BLOCK_FLOATS * blocks, dtype=wp.float32, device=launcher.device)
        made = cls(mesh, tree, sources[: WIDTH * nodes], launcher)
        made._fit()
        return made

    def move(self, points: wp.array) -> None:
        """Moves the mesh and its trees to ``points`` on the device, shape [n] of vec3, which become its own."""
        self.mesh.points = points
        self._fit()

    def refit(self) -> None:
        """Has the trees follow what has become of the mesh's own points."""
        self.mesh.refit()
        self._fit()

    def _fit(self) -> None:
        tree, mesh = self.tree, self.mesh
        self._launcher(copy_boxes, len(tree.links), [mesh.id, self._sources, tree.boxes], LEAST_COPIED)
        inputs = [mesh.points, mesh.indices, tree.faces, tree.corners]
        self._launcher(copy_corners, len(tree.faces), inputs, LEAST_COPIED)
