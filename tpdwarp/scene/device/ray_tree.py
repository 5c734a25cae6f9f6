"""What a ray meets first: on the CPU eight boxes or eight triangles at a time, in vectors.

It is what ``wp.mesh_query_ray`` finds, to the last bit, for a third of the time or less (Wald, Benthin & Boulos 2008,
*Getting Rid of Packets*). Of triangles that are met as near, the first one counts, so that it does not matter how the
tree was built. On a GPU, where there is no such tree (:mod:`tpdwarp.scene.device.wide_tree`), Warp's is
asked.
"""

from __future__ import annotations

import warp as wp

# Children of a node, and triangles of a block: a register of eight floats.
WIDTH = 8
# Floats of a node's boxes and of a block's corners.
NODE_FLOATS, BLOCK_FLOATS = 6 * WIDTH, 9 * WIDTH
# Of a deeper tree a ray might have more left to visit than it keeps; it is left to Warp's.
STACK = 256
MOST_LEVELS = STACK // (WIDTH - 1)


@wp.struct
class RayTree:
    """Nodes and blocks one after the other; nothing of either where Warp's tree is to be asked.

    Attributes:
        mesh: Warp's mesh.
        boxes: Of each node the least x, y, z and the greatest x, y, z of eight children, each eight in a row.
        links: Of each child the number of its node, or −2 − the number of its block; −1 where there is none.
        corners: Of each block x, y, z of the first corners, of the second and of the third, each eight in a row.
        faces: Of each block the numbers of its triangles, −1 where there is none.
    """

    mesh: wp.uint64
    boxes: wp.array(dtype=wp.float32)
    links: wp.array(dtype=wp.int32)
    corners: wp.array(dtype=wp.float32)
    faces: wp.array(dtype=wp.int32)


@wp.struct
class Met:
    """The triangle that a ray meets first, −1 for none, how far off, and the weights of its first two corners."""

    triangle: int
    distance: float
    u: float
    v: float


# The test of a triangle is Woop's, Benthin's & Wald's (2013, Watertight Ray/Triangle Intersection) as Warp has it.
@wp.func_native(f"""
    using namespace wp;
    float nearest = end, met_u = 0.0f, met_v = 0.0f;
    int met = -1;
#if !defined(__CUDA_ARCH__)
    if (links.shape[0] > 0) {{
        typedef float Floats __attribute__((ext_vector_type({WIDTH})));
        typedef float Stored __attribute__((ext_vector_type({WIDTH}), aligned(4)));
        typedef bool Bits __attribute__((ext_vector_type({WIDTH})));
        const auto load = [](const float* from) {{ return (Floats)*(const Stored*)from; }};
        const auto lesser = [](Floats a, Floats b) {{ return a < b ? a : b; }};
        const auto greater = [](Floats a, Floats b) {{ return a > b ? a : b; }};
        const auto bits = [](auto which) {{
            return (unsigned)__builtin_bit_cast(unsigned char, __builtin_convertvector(which, Bits));
        }};
        const auto next = [](unsigned& which) {{
            const int i = __builtin_ctz(which);
            which &= which - 1;
            return i;
        }};

        // No part of the direction is zero here, so that no product below is zero times infinity.
        vec3 inverse;
        for (int axis = 0; axis < 3; ++axis)
            inverse[axis] = 1.0f / (w[axis] > -1e-20f && w[axis] < 1e-20f ? 1e-20f : w[axis]);
        const int near_x = inverse[0] < 0.0f ? 3 : 0, near_y = inverse[1] < 0.0f ? 4 : 1;
        const int near_z = inverse[2] < 0.0f ? 5 : 2;

        const int z = max_dim(w), first = z == 2 ? 0 : z + 1, second = first == 2 ? 0 : first + 1;
        const int a = w[z] < 0.0f ? second : first, b = w[z] < 0.0f ? first : second;
        const float shear_a = w[a] / w[z], shear_b = w[b] / w[z], shear_z = 1.0f / w[z];

        int left[{STACK}];
        float left_from[{STACK}];
        int waiting = 0, node = 0;
        while (true) {{
            if (node >= 0) {{
                const float* box = &boxes[{NODE_FLOATS} * node];
                const auto slab = [&](int side, int axis) {{
                    return (load(box + {WIDTH} * side) - x[axis]) * inverse[axis];
                }};
                Floats from = greater(greater(slab(near_x, 0), slab(near_y, 1)), slab(near_z, 2));
                from = greater(from, (Floats)0.0f);
                Floats to = lesser(lesser(slab(3 - near_x, 0), slab(5 - near_y, 1)), slab(7 - near_z, 2));
                // What rounding of three products may take away (Ize 2013, Robust BVH Ray Traversal), also from what
                // has been met: all that is met as near is looked at, so that it does not matter what comes first.
                to = lesser(to, (Floats)nearest) * 1.0000004f;
                unsigned entered = bits(from <= to);
                if (entered) {{
                    const int* link = &links[{WIDTH} * node];
                    int i = next(entered);
                    node = link[i];
                    float here = from[i];
                    while (entered) {{
                        i = next(entered);
                        const bool closer = from[i] < here;
                        left[waiting] = closer ? node : link[i];
                        left_from[waiting++] = closer ? here : from[i];
                        node = closer ? link[i] : node;
                        here = closer ? from[i] : here;
                    }}
                    continue;
                }}
            }} else {{
                const int block = -2 - node;
                const float* corner = &corners[{BLOCK_FLOATS} * block];
                const auto part = [&](int number, int axis) {{
                    return load(corner + {WIDTH} * (3 * number + axis)) - x[axis];
                }};
                const Floats z0 = part(0, z), z1 = part(1, z), z2 = part(2, z);
                const Floats a0 = part(0, a) - shear_a * z0, b0 = part(0, b) - shear_b * z0;
                const Floats a1 = part(1, a) - shear_a * z1, b1 = part(1, b) - shear_b * z1;
                const Floats a2 = part(2, a) - shear_a * z2, b2 = part(2, b) - shear_b * z2;
                // pq − rs with one rounding (Kahan).
                const auto difference = [](Floats p, Floats q, Floats r, Floats s) {{
                    const Floats other = r * s;
                    return __builtin_elementwise_fma(p, q, -other) + __builtin_elementwise_fma(-r, s, other);
                }};
                Floats u = difference(a2, b1, b2, a1), v = difference(a0, b2, b0, a2);
                Floats t = difference(a1, b0, b1, a0);
                for (unsigned edges = bits((u == 0.0f) | (v == 0.0f) | (t == 0.0f)); edges;) {{
                    const int i = next(edges);
                    u[i] = (float)((double)a2[i] * (double)b1[i] - (double)b2[i] * (double)a1[i]);
                    v[i] = (float)((double)a0[i] * (double)b2[i] - (double)b0[i] * (double)a2[i]);
                    t[i] = (float)((double)a1[i] * (double)b0[i] - (double)b1[i] * (double)a0[i]);
                }}
                const Floats sum = u + v + t;
                const auto inside = (lesser(lesser(u, v), t) >= 0.0f) | (greater(greater(u, v), t) <= 0.0f);
                unsigned hits = bits(inside & (sum != 0.0f));
                if (hits) {{
                    const Floats height = u * (shear_z * z0) + v * (shear_z * z1) + t * (shear_z * z2);
                    while (hits) {{
                        const int i = next(hits);
                        const float part_of_sum = 1.0f / sum[i], distance = height[i] * part_of_sum;
                        const int face = faces[{WIDTH} * block + i];
                        if (distance >= 0.0f && (distance < nearest || (distance == nearest && face < met))) {{
                            nearest = distance;
                            met = face;
                            met_u = u[i] * part_of_sum;
                            met_v = v[i] * part_of_sum;
                        }}
                    }}
                }}
            }}
            do {{
                if (waiting == 0) return vec_t<4, double>((double)met, (double)nearest, (double)met_u, (double)met_v);
            }} while (left_from[--waiting] > nearest * 1.0000004f);
            node = left[waiting];
        }}
    }}
#endif
    float sign;
    vec3 normal;
    if (!mesh_query_ray(mesh, x, w, end, nearest, met_u, met_v, sign, normal, met)) met = -1;
    return vec_t<4, double>((double)met, (double)nearest, (double)met_u, (double)met_v);
""")
def nearest_triangle(
    mesh: wp.uint64,
    boxes: wp.array(dtype=wp.float32),
    links: wp.array(dtype=wp.int32),
    corners: wp.array(dtype=wp.float32),
    faces: wp.array(dtype=wp.int32),
    x: wp.vec3,
    w: wp.vec3,
    end: float,
) -> wp.vec4d:
    """Number, distance and weights of the triangle that a ray meets first before ``end``."""
    ...


@wp.func
def first_met(tree: RayTree, x: wp.vec3, w: wp.vec3, end: float) -> Met:
    """What the ray x + λω meets first for λ in [0, end)."""
    found = nearest_triangle(tree.mesh, tree.boxes, tree.links, tree.corners, tree.faces, x, w, end)
    met = Met()
    met.triangle = int(found[0])
    met.distance = float(found[1])
    met.u = float(found[2])
    met.v = float(found[3])
    return met
