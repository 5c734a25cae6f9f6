"""Laws of flux that grows along a curve: its photons in pieces of the shutter."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from tests.estimators.frames import OPEN
from tests.footprints.photons import photon_map
from tests.photons.shapes import glass
from tests.trajectories.test_fit import fitted_photons
from tests.view.scenes import SUN, Source, floor, looking_down
from tpdwarp.photons.photon_map import PhotonMap
from tpdwarp.scene.description import MeshAtShutter, SceneAtShutter, Shutter
from tpdwarp.trajectories.flux_pieces import PIECES, follow_flux, needs_pieces
from usd_scenes import shapes


def growing(slope: float, bend: float) -> PhotonMap:
    """Two photons, of which the flux of the second bends."""
    columns = [(0.3, 0.0, 0.0), (0.1, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)]
    photons = photon_map([(0, 0, 0), (1, 0, 0)], (0.1, 0, 0), (0, 0.1, 0), (0.5, 0, 0), trajectory=columns, gain=slope)
    return replace(photons, trajectory=replace(photons.trajectory, flux_bend=np.float32([0.0, bend])))


@pytest.mark.parametrize(("slope", "bend"), [(1.2, 0.7), (-0.5, 1.5), (0.0, -0.6), (2.0, 1.0), (1.0, 6.0)])
def test_pieces_have_the_flux_of_the_parabola_at_their_time_and_all_of_it_together(slope, bend):
    (still, *pieces) = follow_flux(growing(slope, bend))
    assert len(still) == 1 and still.trajectory.gain == pytest.approx(slope)
    assert len(pieces) == PIECES and all(piece.duration == 1.0 / PIECES for piece in pieces)
    assert sum(float(piece.flux[0, 0]) for piece in pieces) == pytest.approx(1.0, rel=1e-6)
    for piece in pieces:
        begin, end = piece.time - 0.5 / PIECES, piece.time + 0.5 / PIECES
        times = begin + (np.arange(1000) + 0.5) / 1000 * (end - begin)
        flux = 1.0 + slope * times + 0.5 * bend * (times**2 - 1 / 12)
        if flux.min() > 0.0:
            assert piece.flux[0, 0] * PIECES == pytest.approx(flux.mean(), rel=1e-5)
            assert piece.flux[0, 0] * PIECES * piece.trajectory.gain[0] == pytest.approx(
                (slope + bend * piece.time) / PIECES, rel=1e-4, abs=1e-6
            )


def test_pieces_go_along_the_way_of_the_whole():
    pieces = follow_flux(growing(1.2, 0.7))[1:]

    def end(piece: PhotonMap, side: float) -> np.ndarray:
        columns = piece.trajectory
        return piece.position + side * piece.dxdt + 0.5 * side**2 * columns.dxdtt + side**3 / 6.0 * columns.dxdttt

    for before, after in ((end(a, 0.5), end(b, -0.5)) for a, b in itertools.pairwise(pieces)):
        np.testing.assert_allclose(before, after, atol=1e-6)


def test_flux_that_goes_along_a_line_stays_in_one_piece():
    assert not needs_pieces(np.array([0.9, -0.9]), np.array([0.1, 0.1])).any()
    assert len(follow_flux(growing(0.5, 0.0))) == 1


def size(time: float) -> float:
    """Of a lens that is scaled up from .6 to 1.1."""
    return 0.6 + 0.5 * time


def scaled_lens(shutter: Shutter, power: float = 1.0) -> SceneAtShutter:
    points, triangles, normals = shapes.lens(0.5, 1.2)
    lens = MeshAtShutter(
        "/lens",
        points * size(shutter.middle) + [0.0, 0.0, 0.8],
        triangles,
        motions=0.5 * shutter.exposure * points if shutter.exposure else None,
        normals=normals,
        normal_indices=triangles,
        materials=(glass(),),
    )
    return SceneAtShutter(shutter, (floor(), lens), (replace(SUN, power=(power,) * 3),), looking_down(height=0.2))


def test_a_lens_that_is_scaled_up_catches_light_by_the_square_of_its_size():
    """It catches half of what it does in the middle as the shutter opens, 1.7 times that as it closes."""
    photons, _ = fitted_photons(Source(scaled_lens), OPEN, photons=4096)
    bent = photons.trajectory.flux_bend != 0.0
    assert photons.flux[bent].sum() > 0.9 * photons.flux.sum()
    times = np.linspace(0.0, 1.0, 4001)
    for piece in follow_flux(photons.rows(bent)):
        within = np.abs(times - 0.5 - piece.time) < 0.5 * piece.duration
        expected = (size(times[within]) ** 2).mean() / (size(times) ** 2).mean()
        found = piece.flux.sum() / photons.flux[bent].sum() / piece.duration
        assert found == pytest.approx(expected, rel=0.01)


def test_light_that_brightens_by_itself_is_not_in_pieces_for_its_cells():
    """Products of two lines are what its own pieces have (:mod:`tpdwarp.trajectories.brightening`)."""
    source = Source(lambda shutter: scaled_lens(shutter, 0.5 + shutter.middle))
    photons, _ = fitted_photons(source, OPEN, photons=1024)
    assert any(photons.power_curves) and not photons.trajectory.flux_bend.any()
    assert np.abs(photons.trajectory.gain).max() <= 1.0
