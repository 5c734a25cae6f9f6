"""Which solids are nested, and which of two holds where both are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.photons.shapes import MIRROR, ball, box, floor, glass, upside_down
from tests.photons.traced import scene_of, sun
from tpdwarp.scene.description import MeshAtShutter
from tpdwarp.scene.nesting import nesting_of
from tpdwarp.scene.requirements import requirements_of

WATER, ICE, AIR = glass(1.33), glass(1.31), glass(1.0)
POOL = box("/water", (-1, -1, 0), (1, 1, 1), WATER)
INNER = 0.9


def vessel(wall: float = 0.1, material=None) -> MeshAtShutter:
    """A box with thick walls and a bottom, open at its top."""
    outside = box("/vessel", (-1, -1, 0), (1, 1, 1), material or glass())
    inside = upside_down(box("/vessel", (-1 + wall, -1 + wall, wall), (1 - wall, 1 - wall, 1), material or glass()))
    without_lid = [
        part.triangles[np.any(part.points[part.triangles][:, :, 2] < 1, axis=1)] for part in (outside, inside)
    ]
    rim = []
    for a, b in ((4, 5), (5, 7), (7, 6), (6, 4)):
        rim += [[a, b, b + 8], [a, b + 8, a + 8]]
    return replace(
        outside,
        points=np.concatenate([outside.points, inside.points]),
        triangles=np.concatenate([without_lid[0], without_lid[1] + 8, np.array(rim, np.int32)]).astype(np.int32),
    )


def holds(*meshes: MeshAtShutter) -> list[str]:
    """Paths of the nested solids, from the one that gives way to all to the one that holds."""
    nesting = nesting_of(scene_of([floor(-1), *meshes], sun()))
    if nesting is None:
        return []
    media = nesting.media[1:]
    assert nesting.media[0] == -1
    for mesh, medium in zip(meshes, media, strict=True):
        assert medium < 0 or nesting.indices[medium] == mesh.materials[0].ior
    return [meshes[number].path for number in np.argsort(media, kind="stable") if media[number] >= 0]


def filling(grown: float = 0.0, high: float = 0.8) -> MeshAtShutter:
    """Water in :func:`vessel`, grown into its walls."""
    edge = INNER + grown
    return box("/water", (-edge, -edge, 0.1 - grown), (edge, edge, high), WATER)


@pytest.mark.parametrize(
    ("meshes", "order"),
    [
        ((POOL, ball("/ice", (0, 0, 0.5), 0.3, 8, ICE)), ["/water", "/ice"]),
        ((POOL, ball("/ice", (0, 0, 1.0), 0.3, 8, ICE)), ["/water", "/ice"]),
        ((POOL, ball("/bubble", (0, 0, 0.5), 0.3, 8, AIR)), ["/water", "/bubble"]),
        ((POOL, box("/rod", (0, 0, 0.9), (0.1, 0.1, 3.0), glass())), ["/water", "/rod"]),
        ((vessel(), filling()), ["/water", "/vessel"]),
        ((vessel(), filling(0.02)), ["/water", "/vessel"]),
        ((vessel(0.1, glass(1.2)), filling(0.02)), ["/water", "/vessel"]),
        ((filling(0.02), ball("/ice", (0, 0, 0.5), 0.3, 8, ICE), vessel()), ["/water", "/vessel", "/ice"]),
        ((floor(0.5, 2.0, WATER, "/sea"), ball("/ice", (0, 0, 0.4), 0.3, 8, ICE)), ["/sea", "/ice"]),
        ((POOL, box("/slab", (-1, -1, 1), (1, 1, 1.2), glass())), ["/water", "/slab"]),
    ],
    ids=["ice", "floating ice", "bubble", "rod", "a glass of water", "grown", "light vessel", "all", "sea", "slab"],
)  # fmt: skip
@pytest.mark.parametrize("turned", [False, True])
def test_what_is_inside_displaces_what_it_is_in_and_vessels_hold(meshes, order, turned):
    found = holds(*(meshes[::-1] if turned else meshes))
    assert sorted(found) == sorted(order)
    # Solids that are nothing to each other may have any order.
    assert found[0] == order[0]


@pytest.mark.parametrize(
    "meshes",
    [
        (POOL,),
        (POOL, box("/other", (-1, -1, 1.01), (1, 1, 2), glass())),
        (box("/one", (-1, -1, 0), (1, 1, 1), glass()), box("/two", (-1, -1, 1), (1, 1, 2), glass())),
        (floor(1.0, 2.0, WATER, "/sea"), ball("/ball", (0, 0, 0.4), 0.3, 8, glass())),
        (floor(1.0, 1.0, glass(), "/top"), upside_down(floor(0.9, 1.0, glass(), "/bottom"))),
        (POOL, ball("/mirror", (0, 0, 0.5), 0.3, 8, MIRROR)),
        (POOL, ball("/relative", (0, 0, 0.5), 0.3, 8, glass(1 / 1.33))),
        (POOL, upside_down(ball("/cavity", (0, 0, 0.5), 0.3, 8, WATER))),
    ],
    ids=["alone", "apart", "stacked panes", "below a sheet", "a pane of two sheets", "a mirror", "relative", "cavity"],
)  # fmt: skip
def test_others_are_as_they_were(meshes):
    scene = scene_of([floor(-1), *meshes], sun())
    assert nesting_of(scene) is None and not requirements_of(scene).nested


def test_authored_priorities_come_first():
    ice = ball("/ice", (0, 0, 0.5), 0.3, 8, ICE)
    assert holds(POOL, ice) == ["/water", "/ice"]
    assert holds(replace(POOL, priority=1), ice) == ["/ice", "/water"]
    assert holds(replace(POOL, priority=1), replace(ice, priority=2)) == ["/water", "/ice"]


def test_bubbles_apart_from_each_other_share_a_medium():
    bubbles = [ball(f"/bubble{k}", (0.05 * k - 0.9, 0, 0.5), 0.02, 4, AIR) for k in range(36)]
    nesting = nesting_of(scene_of([POOL, *bubbles], sun()))
    assert list(nesting.indices) == [1.33, 1.0] and set(nesting.media[1:]) == {1}
