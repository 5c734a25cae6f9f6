"""Photons as the world sees them: scene units, the whole shutter, one id each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tpdwarp.device import Launcher
from tpdwarp.photons.branching import reported_paths
from tpdwarp.photons.energy import EnergyAccount
from tpdwarp.photons.lattices import plan_emission
from tpdwarp.photons.record import record_of
from tpdwarp.photons.tracing import trace_photons
from tpdwarp.scene.device.geometry import geometry_of
from tpdwarp.scene.normalization import Normalization
from tpdwarp.scene.requirements import requirements_of

from .moving_scenes import wave
from .shapes import floor, glass
from .traced import EPS, Written, scene_of, sun, traced


def test_accounts_add_up_cause_by_cause():
    total = EnergyAccount(1.0, 0.5, 0.2, 0.1, {"depth": 0.2}, {"emitted": 3})
    total.add(EnergyAccount(2.0, 1.0, 0.5, 0.3, {"depth": 0.1, "not finite": 0.1}, {"emitted": 4, "landed": 2}))
    assert total.as_dict() == {
        "sent": 3.0,
        "deposited": 1.5,
        "escaped": 0.7,
        "absorbed": pytest.approx(0.4),
        "lost": {"depth": pytest.approx(0.3), "not finite": 0.1},
        "counts": {"emitted": 7, "landed": 2},
    }
    assert total.lost_total == pytest.approx(0.4)


def test_every_reported_branch_becomes_one_path():
    cells, masks = np.array([7, 8, 9], np.int32), np.array([0, 0, 1], np.int32)
    branches = np.array([0b101, 0, 0b110], np.int32)
    new_cells, new_masks = reported_paths(cells, masks, branches)
    assert sorted(zip(new_cells.tolist(), new_masks.tolist(), strict=True)) == [(7, 1), (7, 4), (9, 3), (9, 5)]
    assert len(reported_paths(cells, masks, np.zeros(3, np.int32))[0]) == 0


def test_segments_have_ids_of_their_own_and_displacements_of_the_whole_shutter():
    scene, launcher = wave(True), Launcher("cpu", 1)
    norm = Normalization.of(scene)
    plan = plan_emission(Written(scene), 500, norm)
    geometry = geometry_of(scene, norm, launcher, with_motions=True)
    photons, _ = trace_photons(scene, geometry, plan, requirements_of(scene), launcher, weight=0.5)
    whole = record_of([(photons, plan)], geometry.paths)
    parts = [(replace(photons, duration=0.5, time=time), plan) for time in (-0.25, 0.25)]
    halves = record_of(parts, geometry.paths)
    assert len(halves) == 2 * len(whole) == len(np.unique(halves.ids))
    np.testing.assert_array_equal(halves.dxdt[: len(whole)], 2 * whole.dxdt)
    np.testing.assert_array_equal(halves.positions[len(whole) :], whole.positions)


def test_weight_scales_the_flux_and_the_account():
    scene, launcher = wave(True), Launcher("cpu", 1)
    norm = Normalization.of(scene)
    plan = plan_emission(Written(scene), 500, norm)
    geometry = geometry_of(scene, norm, launcher, with_motions=True)
    found = [
        trace_photons(scene, geometry, plan, requirements_of(scene), launcher, weight=weight) for weight in (1.0, 0.25)
    ]
    np.testing.assert_allclose(found[1][0].flux, 0.25 * found[0][0].flux, rtol=4 * EPS)
    assert found[1][1].sent == pytest.approx(0.25 * found[0][1].sent, rel=4 * EPS)


@pytest.mark.parametrize("scale, offset", [(100.0, 0.0), (0.01, 5.0), (1.0, 1e5)])
def test_units_and_place_of_the_scene_do_not_matter(scale, offset):
    def placed(mesh):
        return replace(
            mesh,
            points=mesh.points * scale + offset,
            motions=None if mesh.motions is None else mesh.motions * scale,
        )

    scene = wave(True)
    here = traced(scene, 800)
    there = traced(replace(scene, meshes=tuple(placed(mesh) for mesh in scene.meshes)), 800)
    _, a, b = np.intersect1d(here.photons.ids, there.photons.ids, return_indices=True)
    assert len(a) > 0.98 * len(here.photons)
    # Centre and scale differ, so hits round differently: over a cell of the mesh, and times its slope.
    tolerance = 2e3 * EPS + 4e-16 * offset / scale
    np.testing.assert_allclose((there.photons.positions[b] - offset) / scale, here.photons.positions[a], atol=tolerance)
    for name in ("dxdu", "dxdv", "dxdt"):
        error = np.linalg.norm(getattr(there.photons, name)[b] / scale - getattr(here.photons, name)[a], axis=1)
        # A hit on an edge may fall to either triangle.
        assert np.quantile(error, 0.99) <= tolerance
    np.testing.assert_allclose(there.photons.flux[b] / scale**2, here.photons.flux[a], rtol=2e3 * EPS)


def test_photons_name_where_they_landed_and_the_side_that_was_lit():
    shelf = floor(0.4, 0.5, path="/shelf")
    water = floor(1.0, 1.0, glass(1.33), "/water")
    flipped = replace(floor(), triangles=floor().triangles[:, ::-1])
    photons = traced(scene_of([water, shelf, flipped], sun()), 400).photons
    on_shelf = np.abs(photons.positions[:, :2]).max(axis=1) < 0.5
    paths = np.array(photons.receiver_paths)[photons.receivers]
    assert set(paths[on_shelf]) == {"/shelf"} and set(paths[~on_shelf]) == {"/floor"}
    np.testing.assert_allclose(photons.normals, [[0, 0, 1]] * len(photons), atol=EPS)
    np.testing.assert_allclose(photons.positions[:, 2], np.where(on_shelf, 0.4, 0.0), atol=16 * EPS)
    assert (photons.bounces == 1).all()
