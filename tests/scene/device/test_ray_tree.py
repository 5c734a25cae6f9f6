"""What rays meet first in eight-wide trees, against Warp's own ray query and against every triangle in double."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from tpdwarp.device import Launcher
from tpdwarp.scene.device.ray_tree import MOST_LEVELS, RayTree, first_met
from tpdwarp.scene.device.wide_tree import WideTree

RAYS = 4000


@wp.kernel(enable_backward=False)
def ask_both(
    base: int,
    tree: RayTree,
    x: wp.array(dtype=wp.vec3),
    w: wp.array(dtype=wp.vec3),
    end: float,
    wide: wp.array2d(dtype=wp.float32),
    warps: wp.array2d(dtype=wp.float32),
):
    i = base + wp.tid()
    met = first_met(tree, x[i], w[i], end)
    wide[i, 0] = float(met.triangle)
    query = wp.mesh_query_ray(tree.mesh, x[i], w[i], end)
    warps[i, 0] = -1.0
    if met.triangle >= 0:
        wide[i, 1] = met.distance
        wide[i, 2] = met.u
        wide[i, 3] = met.v
    if query.result:
        warps[i, 0] = float(query.face)
        warps[i, 1] = query.t
        warps[i, 2] = query.u
        warps[i, 3] = query.v


def tree_of(
    points: np.ndarray, triangles: np.ndarray, launcher: Launcher, ends: np.ndarray | None = None
) -> WideTree:
    mesh = wp.Mesh(
        points=wp.array(points.astype(np.float32), dtype=wp.vec3, device="cpu"),
        indices=wp.array(triangles.astype(np.int32).ravel(), dtype=wp.int32, device="cpu"),
    )
    return WideTree(mesh, launcher, ends)


def answers(
    tree: WideTree, x: np.ndarray, w: np.ndarray, launcher: Launcher, end: float = 1e6
) -> tuple[np.ndarray, np.ndarray]:
    """Triangle, distance and weights by the wide tree and by Warp's, shape [n, 4] each."""
    wide, warps = (wp.zeros((len(x), 4), dtype=wp.float32, device="cpu") for _ in range(2))
    rays = [launcher.array(values.astype(np.float32), wp.vec3) for values in (x, w)]
    assert tree.mesh.id == tree.tree.mesh
    launcher(ask_both, len(x), [tree.tree, *rays, end, wide, warps])
    return wide.numpy(), warps.numpy()


def soup(count: int, size: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    middles = random.uniform(-1, 1, (count, 1, 3))
    corners = middles + size * random.normal(size=(count, 3, 3))
    return corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)


def grid(side: int) -> tuple[np.ndarray, np.ndarray]:
    """A height field: neighbours share edges, and its cells are squares along the axes."""
    u, v = np.meshgrid(np.linspace(-1, 1, side), np.linspace(-1, 1, side), indexing="ij")
    points = np.stack([u, v, 0.1 * np.sin(5 * u) * np.cos(4 * v)], axis=-1).reshape(-1, 3)
    a = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    first, second = np.stack([a, a + side, a + 1], 1), np.stack([a + 1, a + side, a + side + 1], 1)
    return points, np.concatenate([first, second])


def fan(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Long thin triangles about one corner."""
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
    rim = np.stack([np.cos(angles), np.sin(angles), 0 * angles], 1)
    k = np.arange(count)
    return np.concatenate([[[0, 0, 0.2]], rim]), np.stack([0 * k, 1 + k, 1 + (k + 1) % count], 1)


def rays(seed: int, count: int = RAYS) -> tuple[np.ndarray, np.ndarray]:
    """Rays from within and from without, some along axes."""
    random = np.random.default_rng(seed)
    x = random.uniform(-1.5, 1.5, (count, 3))
    w = random.normal(size=(count, 3))
    w /= np.linalg.norm(w, axis=1, keepdims=True)
    w[: count // 4] = np.eye(3)[random.integers(0, 3, count // 4)] * random.choice([-1, 1], (count // 4, 1))
    return x, w


SHAPES = {
    "one triangle": soup(1, 1.0),
    "eight triangles": soup(8, 0.5),
    "nine triangles": soup(9, 0.5),
    "small ones": soup(3000, 0.04),
    "large ones": soup(500, 1.0),
    "height field": grid(60),
    "flat": (grid(40)[0] * [1, 1, 0], grid(40)[1]),
    "fan": fan(300),
    "one upon the other": (np.tile(soup(5, 0.5)[0], (20, 1)), np.arange(300).reshape(-1, 3)),
    "without area": (np.repeat(soup(100, 0.5)[0][::3], 3, axis=0), np.arange(300).reshape(-1, 3)),
}


@pytest.mark.parametrize("name", SHAPES)
def test_rays_meet_what_they_meet_by_warp(name: str) -> None:
    launcher = Launcher("cpu", 1)
    tree = tree_of(*SHAPES[name], launcher)
    assert len(tree.tree.links)
    for end in (1e6, 0.5):
        wide, warps = answers(tree, *rays(1), launcher, end)
        np.testing.assert_array_equal(wide[:, 0] >= 0, warps[:, 0] >= 0)
        np.testing.assert_array_equal(wide[:, 1], warps[:, 1])
        same = wide[:, 0] == warps[:, 0]
        np.testing.assert_array_equal(wide[same], warps[same])
        if name != "one upon the other":
            # Of triangles that share an edge either may be said to be met there.
            assert same.mean() > 0.999


@pytest.mark.parametrize("name", ["small ones", "height field", "fan"])
def test_rays_meet_the_nearest_of_all_triangles(name: str) -> None:
    points, triangles = SHAPES[name]
    launcher = Launcher("cpu", 1)
    x, w = (values.astype(np.float32) for values in rays(2, 500))
    wide, _ = answers(tree_of(points, triangles, launcher), x, w, launcher)
    corners = points.astype(np.float32).astype(np.float64)[triangles]
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = np.cross(w[:, None].astype(float), e2)
    with np.errstate(all="ignore"):
        inverse = 1.0 / (p * e1).sum(-1)
        s = x[:, None] - corners[:, 0]
        u, q = (s * p).sum(-1) * inverse, np.cross(s, e1)
        v, t = (w[:, None] * q).sum(-1) * inverse, (e2 * q).sum(-1) * inverse
        least = np.minimum(np.minimum(u, v), np.minimum(1 - u - v, t))
    perhaps, surely = least > -1e-6, least > 1e-6
    nearest = [np.where(there, t, np.inf).min(axis=1) for there in (perhaps, surely)]
    found = np.where(wide[:, 0] >= 0, wide[:, 1], np.inf)
    assert np.all(found >= nearest[0] - 1e-5) and np.all(found <= nearest[1] + 1e-5)
    assert np.isfinite(found).sum() > 20


@pytest.mark.parametrize("name", SHAPES)
def test_what_rays_meet_does_not_depend_on_how_the_tree_was_built(name: str) -> None:
    points, triangles = SHAPES[name]
    launcher = Launcher("cpu", 1)
    # Rays at vertices and along edges meet several triangles as near.
    x, w = rays(6)
    places = points[triangles[np.arange(len(x)) % len(triangles), 0]]
    w[::2] = ((places - x) / np.linalg.norm(places - x, axis=1, keepdims=True))[::2]
    found, _ = answers(tree_of(points, triangles, launcher), x, w, launcher)
    for change in (np.array([3.0, 0.1, 1.0]), np.array([0.1, 1.0, 5.0])):
        # Built elsewhere and brought back, so that its boxes are others.
        tree = tree_of(points * change, triangles, launcher)
        tree.move(launcher.array(points.astype(np.float32), wp.vec3))
        np.testing.assert_array_equal(answers(tree, x, w, launcher)[0], found)


def test_trees_follow_their_mesh() -> None:
    points, triangles = soup(2000, 0.05)
    launcher = Launcher("cpu", 1)
    tree = tree_of(points, triangles, launcher)
    moved = points @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 2.0]]) + [0.1, 0.2, 0.3]
    tree.move(launcher.array(moved.astype(np.float32), wp.vec3))
    wide, warps = answers(tree, *rays(3), launcher)
    np.testing.assert_array_equal(wide, warps)
    anew, _ = answers(tree_of(moved, triangles, launcher), *rays(3), launcher)
    np.testing.assert_array_equal(wide, anew)


def test_what_is_not_finite_meets_nothing_and_is_not_met() -> None:
    points, triangles = soup(200, 0.3)
    points[triangles[7]] = np.nan
    launcher = Launcher("cpu", 1)
    x, w = rays(4)
    x[::50], w[1::50], x[2::50] = np.nan, np.nan, np.inf
    wide, _ = answers(tree_of(points, triangles, launcher), x, w, launcher)
    for broken in (slice(0, None, 50), slice(1, None, 50), slice(2, None, 50)):
        assert np.all(wide[broken, 0] == -1)
    assert not np.any(wide[:, 0] == 7) and (wide[:, 0] >= 0).mean() > 0.2


def test_trees_that_are_too_deep_are_left_to_warp(monkeypatch: pytest.MonkeyPatch) -> None:
    points, triangles = soup(300, 0.3)
    launcher = Launcher("cpu", 1)
    monkeypatch.setattr("tpdwarp.scene.device.wide_tree.MOST_LEVELS", 0)
    none = tree_of(points, triangles, launcher)
    assert not len(none.tree.links) and none.grown == np.inf
    wide, warps = answers(none, *rays(5), launcher)
    np.testing.assert_array_equal(wide, warps)
    assert MOST_LEVELS * 7 <= 256


@pytest.fixture
def in_parts(monkeypatch: pytest.MonkeyPatch) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, triangles and ends of three parts, of which trees follow each by itself."""
    monkeypatch.setattr("tpdwarp.scene.device.wide_tree.FOLLOWED_IN_PARTS", 1)
    parts = [grid(30), soup(200, 0.1), grid(40)]
    begins = np.cumsum([0, *(len(points) for points, _ in parts)])
    points = np.concatenate([of for of, _ in parts])
    triangles = np.concatenate([of + begin for (_, of), begin in zip(parts, begins[:-1], strict=True)])
    return points, triangles, np.column_stack([begins[1:], np.cumsum([len(of) for _, of in parts])])


@pytest.mark.parametrize("known", [(1,), None])
def test_a_tree_follows_the_part_that_moves_as_if_it_followed_all(
    in_parts: tuple[np.ndarray, np.ndarray, np.ndarray], known: tuple[int, ...] | None
) -> None:
    points, triangles, ends = in_parts
    launcher = Launcher("cpu", 1)
    whole, parted = tree_of(points, triangles, launcher), tree_of(points, triangles, launcher, ends)
    for shift in (0.7, -0.3):
        moved = points.astype(np.float32)
        moved[ends[0, 0] : ends[1, 0]] += np.float32(shift)
        for tree, parts in ((whole, None), (parted, known)):
            tree.move(launcher.array(moved, wp.vec3), parts)
        for name in ("boxes", "corners"):
            np.testing.assert_array_equal(getattr(parted.tree, name).numpy(), getattr(whole.tree, name).numpy())
        wide, warps = answers(parted, *rays(7), launcher)
        np.testing.assert_array_equal(wide[:, 1], warps[:, 1])


def test_what_stands_still_is_not_touched(in_parts: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    points, triangles, ends = in_parts
    launcher = Launcher("cpu", 1)
    tree = tree_of(points, triangles, launcher, ends)
    faces = tree.tree.faces.numpy().reshape(-1, 8)
    still = ~((faces >= ends[0, 1]) & (faces < ends[1, 1])).any(axis=1)
    # Written over, it stays so.
    corners = tree.tree.corners.numpy().reshape(len(faces), -1)
    corners[still] = 7.0
    moved = points.astype(np.float32)
    moved[ends[0, 0] : ends[1, 0]] += np.float32(0.1)
    tree.move(launcher.array(moved, wp.vec3))
    assert still.sum() > 100 and np.all(corners[still] == 7.0) and not np.any(corners[~still] == 7.0)


def test_boxes_that_grow_are_told_of(in_parts: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    points, triangles, ends = in_parts
    launcher = Launcher("cpu", 1)
    tree = tree_of(points, triangles, launcher, ends)
    moved = points.astype(np.float32)
    own = slice(ends[0, 0], ends[1, 0])
    moved[own] = np.random.default_rng(8).permutation(moved[own])
    tree.move(launcher.array(moved, wp.vec3))
    assert tree.grown > 2.0
    tree.move(launcher.array(points.astype(np.float32), wp.vec3))
    assert tree.grown == pytest.approx(1.0)


def test_trees_beside_each_other_answer_where_each_stands(in_parts: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    points, triangles, ends = in_parts
    launcher = Launcher("cpu", 1)
    tree = tree_of(points, triangles, launcher, ends)
    moved = points + np.array([0.3, -0.2, 0.1])
    other = tree.beside(launcher.array(moved.astype(np.float32), wp.vec3))
    assert other.grown == pytest.approx(1.0, abs=1e-5)
    anew = tree_of(moved, triangles, launcher, ends)
    for seed, one in enumerate((tree, other, tree)):
        wide, warps = answers(one, *rays(seed), launcher)
        np.testing.assert_array_equal(wide[:, 1], warps[:, 1])
    np.testing.assert_array_equal(answers(other, *rays(3), launcher)[0], answers(anew, *rays(3), launcher)[0])
    # What moves on from there leaves the first where it was, too.
    other.move(launcher.array(points[::-1].astype(np.float32), wp.vec3))
    wide, warps = answers(other, *rays(5), launcher)
    np.testing.assert_array_equal(wide[:, 1], warps[:, 1])
    wide, warps = answers(tree, *rays(6), launcher)
    np.testing.assert_array_equal(wide[:, 1], warps[:, 1])
    scattered = np.random.default_rng(4).permutation(points).astype(np.float32)
    assert tree.beside(launcher.array(scattered, wp.vec3)).grown > 2.0
