"""How several lights share the photons."""

from __future__ import annotations

import pytest

from tpdwarp.device import Launcher
from tpdwarp.photons.lattices import LEAST_WEIGHT
from tpdwarp.photons.tracer import PhotonTracer
from tpdwarp.scene.description import SceneAtShutter
from tpdwarp.scene.device.loading import SceneLoader
from tpdwarp.settings import Settings

from .shapes import DIFFUSE, floor, glass, quad
from .traced import Written, lamp, scene_of, sun

PHOTONS = 4000


def shares(scene: SceneAtShutter) -> dict[str, float]:
    """The part of all photons that each light has."""
    tracer = PhotonTracer(SceneLoader(Written(scene), Launcher("cpu", 1)), Settings(photons=PHOTONS))
    counts: dict[str, int] = {}
    for lattice, patch in tracer.plan(PHOTONS).patches(scene):
        counts[lattice.light] = counts.get(lattice.light, 0) + patch.count_u * patch.count_v
    assert sum(counts.values()) == pytest.approx(PHOTONS, rel=0.1)
    return {light: count / sum(counts.values()) for light, count in counts.items()}


@pytest.mark.parametrize("ratio", [1.0, 1e3])
def test_lights_whose_caustics_lie_apart_have_as_many_photons_however_faint_one_is(ratio):
    """Each shines on a pane of its own, which a wall keeps the other's light from."""
    panes = [quad(f"/pane{x}", (x, 0, 1), (0.5, 0, 0), (0, 0.5, 0), glass()) for x in (-1, 1)]
    wall = quad("/wall", (0, 0, 2), (0, 4, 0), (0, 0, 2), DIFFUSE)
    lights = [lamp((-1, 0, 2), intensity=1 / ratio, path="/faint"), lamp((1, 0, 2), intensity=1.0, path="/strong")]
    found = shares(scene_of([floor(), wall, *panes], *lights))
    assert found["/faint"] == pytest.approx(0.5, abs=0.03)


def test_a_light_that_falls_where_a_brighter_one_does_has_the_fewest():
    meshes = [floor(1.0, 1.0, glass(), "/water"), floor()]
    found = shares(scene_of(meshes, sun(irradiance=0.01, path="/faint"), sun(irradiance=1.0, path="/strong")))
    assert found["/faint"] == pytest.approx(LEAST_WEIGHT / (1 + LEAST_WEIGHT), rel=0.1)


def test_a_light_that_reaches_no_glass_has_the_fewest():
    """Its lattice looks at the water, from below a floor."""
    meshes = [floor(1.0, 1.0, glass(), "/water"), floor()]
    found = shares(scene_of(meshes, sun(irradiance=1.0), lamp((0, 0, -2), intensity=1e3, path="/hidden")))
    assert found["/hidden"] == pytest.approx(LEAST_WEIGHT / (1 + LEAST_WEIGHT), rel=0.2)
