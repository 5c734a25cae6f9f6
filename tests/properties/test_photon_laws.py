"""Laws of traced photons: nothing depends on where, how large, in which order or in which direction of time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from tests.photons.traced import traced

from .agreement import assert_same_photons
from .placed import backwards, brighter, placed
from .scenes import brightened, lamps, lattice_steps, law, numbers, rotations, scenes, suns, vectors

PHOTONS = 400


def photons_of(scene, **more):
    result = traced(scene, PHOTONS, **more)
    assume(len(result.photons) >= 100)
    return result


@law
@given(scenes(suns()), rotations(), vectors(-3, 3), st.sampled_from(("surface", "light")))
def test_photons_turn_and_shift_with_the_scene(scene, turn, shift, anchor):
    # Where a turning sun emits from is nowhere in particular, so what is fixed there has no motion of its own.
    assume(anchor == "surface" or not any(light.axes_motion.any() for light in scene.lights))
    one = photons_of(scene, anchor=anchor)
    other = traced(placed(scene, turn, shift), PHOTONS, anchor=anchor)
    assert_same_photons(one, other, turn, shift)


@law
@given(scenes(), vectors(-1, 1), st.sampled_from((1.0, 1e2, 1e4)))
def test_photons_shift_with_a_scene_far_from_the_origin(scene, direction, distance):
    shift = distance * direction
    assert_same_photons(photons_of(scene), traced(placed(scene, shift=shift), PHOTONS), shift=shift)


@law
@given(scenes(), st.integers(-30, 30), numbers(1.0, 2.0))
def test_photons_scale_with_the_scene_and_flux_with_its_square(scene, exponent, mantissa):
    scale = mantissa * 2.0**exponent
    assert_same_photons(photons_of(scene), traced(placed(scene, scale=scale), PHOTONS), scale=scale, flux=scale**2)


@law
@given(scenes(), st.integers(-20, 20))
def test_scaling_by_a_power_of_two_rounds_nothing(scene, exponent):
    one, other = photons_of(scene), traced(placed(scene, scale=2.0**exponent), PHOTONS)
    np.testing.assert_array_equal(one.photons.ids, other.photons.ids)
    for name in ("positions", "dxdu", "dxdv", "dxdt"):
        # The centre is added in double precision.
        np.testing.assert_allclose(
            getattr(other.photons, name) / 2.0**exponent, getattr(one.photons, name), rtol=0, atol=2.0**-46
        )


@law
@given(scenes(), st.integers(-40, 40), numbers(0.5, 2.0))
def test_flux_is_linear_in_the_power_of_the_lights(scene, exponent, mantissa):
    factor = mantissa * 2.0**exponent
    one, other = photons_of(scene), traced(brighter(scene, factor), PHOTONS)
    for name, values in vars(one.photons).items():
        if name == "flux":
            # Each of the factors along the path rounds twice.
            np.testing.assert_allclose(other.photons.flux, factor * values, rtol=40 * 2.0**-24)
        else:
            np.testing.assert_array_equal(getattr(other.photons, name), values, err_msg=name)
    for name in ("sent", "deposited", "escaped", "absorbed", "lost_total"):
        found = getattr(other.energy, name) / factor
        np.testing.assert_allclose(found, getattr(one.energy, name), rtol=1e-5, atol=1e-5 * one.energy.sent)


@law
@given(scenes(), st.sampled_from(("surface", "light")))
def test_reversal_of_time_mirrors_dxdt_and_nothing_else(scene, anchor):
    one, other = photons_of(scene, anchor=anchor), traced(backwards(scene), PHOTONS, anchor=anchor)
    assume(np.abs(one.photons.dxdt).max() > 1e-3)
    for name, values in vars(one.photons).items():
        expected = -values if name == "dxdt" else values
        np.testing.assert_array_equal(getattr(other.photons, name), expected, err_msg=name)
    assert other.energy == one.energy


@law
@given(scenes(), st.randoms(use_true_random=False))
def test_the_order_of_meshes_does_not_matter(scene, random):
    meshes = list(scene.meshes)
    random.shuffle(meshes)
    one, other = photons_of(scene), traced(replace(scene, meshes=tuple(meshes)), PHOTONS)
    assert_same_photons(one, other)
    paths = [np.array(result.photons.receiver_paths)[result.photons.receivers] for result in (one, other)]
    _, here, there = np.intersect1d(one.photons.ids, other.photons.ids, return_indices=True)
    assert np.mean(paths[0][here] == paths[1][there]) > 0.99


@law
@given(scenes(suns()), lamps())
def test_the_order_of_lights_does_not_matter(scene, second):
    first = scene.lights[0]
    one, other = (photons_of(replace(scene, lights=lights)) for lights in ((first, second), (second, first)))
    assert one.energy.as_dict()["counts"] == other.energy.as_dict()["counts"]
    for name in ("positions", "flux", "dxdt", "dxdu"):
        a, b = (getattr(result.photons, name).astype(float) for result in (one, other))
        # The same photons in another order: sums over them are the same.
        np.testing.assert_allclose(a.sum(axis=0), b.sum(axis=0), rtol=1e-9, atol=1e-9 * np.abs(a).sum())


@law
@given(scenes(suns()), lamps(), st.integers(100, 400), st.integers(100, 400))
def test_photons_of_two_lights_are_those_of_each_where_their_lattices_are_the_same(scene, second, n, m):
    first = scene.lights[0]
    alone = [traced(replace(scene, lights=(light,)), count) for light, count in ((first, n), (second, m))]
    assume(min(len(result.photons) for result in alone) >= 50)
    both = traced(replace(scene, lights=(first, brightened(second, alone, (n, m)))), n + m)
    assume(lattice_steps(both) == lattice_steps(*alone))
    factor = both.scene.lights[1].power[0] / second.power[0]
    flux = np.concatenate([alone[0].photons.flux, factor * alone[1].photons.flux])
    places = np.concatenate([result.photons.positions for result in alone])
    assert len(both.photons) == len(places)
    order, expected = (np.lexsort(np.round(rows, 6).T) for rows in (both.photons.positions, places))
    np.testing.assert_allclose(both.photons.positions[order], places[expected], atol=1e-6)
    np.testing.assert_allclose(both.photons.flux.sum(axis=0), flux.sum(axis=0), rtol=1e-6)
    sent = alone[0].energy.sent + factor * alone[1].energy.sent
    np.testing.assert_allclose(both.energy.sent, sent, rtol=1e-6)
