"""Strips of the light: what is traced strip after strip is what is traced at once."""

import numpy as np
import pytest

from tpdwarp.estimators import temporal
from tpdwarp.photons.emission import Patch
from tpdwarp.photons.strips import BESIDE, strips_of
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import render_frame
from tpdwarp.scene.description import Shutter
from tpdwarp.settings import Settings
from tpdwarp.usd.read.stage import StageScene
from tpdwarp.view.queries import CameraView
from usd_scenes.in_memory import wave_source
from usd_scenes.oracle import Wave
from usd_scenes.solids import write
from usd_scenes.stage import CAMERA, FRAME

PHOTONS = 1 << 14


def patch(first: tuple[int, int], count: tuple[int, int]) -> Patch:
    out = Patch()
    (out.first_u, out.first_v), (out.count_u, out.count_v) = first, count
    return out


def cells_of(patch: Patch) -> np.ndarray:
    u, v = np.meshgrid(np.arange(patch.count_u), np.arange(patch.count_v), indexing="ij")
    return np.stack([u.ravel() + patch.first_u, v.ravel() + patch.first_v], axis=1)


def test_each_cell_counts_in_one_strip_that_also_traces_what_lies_beside_it():
    sizes = [((-7, 3), (90, 40)), ((0, 0), (20, 9)), ((5, -20), (12, 300))]
    strips = strips_of(4, [(number, patch(*size)) for number, size in enumerate(sizes)], 5)
    counts = np.zeros(5)
    for number, size in enumerate(sizes):
        everything = cells_of(patch(*size))
        counted = np.zeros(len(everything), int)
        pieces = 0
        for strip in strips:
            mine = strip.holds(np.full(len(everything), number), everything)
            counted += mine
            counts[strip.number] += mine.sum()
            cut = patch(*size)
            assert strip.cut(number, cut) == mine.any()
            pieces += mine.any()
            beside = strip.cells_beside(number, cut).cell
            assert len(beside) + mine.sum() == (cut.count_u * cut.count_v if mine.any() else 0)
            if len(beside):
                assert len(np.unique(beside[:, 0 if number == 0 else 1])) in (BESIDE, 2 * BESIDE)
        assert np.all(counted == 1)
        # The small one is not cut.
        assert pieces == (3, 1, 3)[number]
    # Equal but for what rows hold.
    assert np.ptp(counts) <= 2 * 40
    # A lattice that emits nothing, and one that was made for the frame.
    assert sum(strip.cut(3, patch((0, 0), (9, 9))) for strip in strips) == 1
    assert [strip.cut(-1, patch((0, 0), (9, 9))) for strip in strips] == [True, False, False, False, False]


def frames_of(source, settings, shutter, size, monkeypatch, strips):
    """Frames of all photons at once, and in strips."""
    for count in (1, strips):
        monkeypatch.setattr(temporal, "PHOTONS_OF_STRIP", -(-settings.photons // count))
        yield render_frame(RenderContext(source, settings), shutter, *size)


def test_strips_of_water_add_up_to_all_of_it(monkeypatch):
    source = wave_source(Wave(speed=0.1))
    settings = Settings(aovs=("irradiance", "direct", "photons", "N"), samples=1, photons=PHOTONS)
    whole, strips = frames_of(source, settings, Shutter(0, 0.0, 1.0), (64, 8), monkeypatch, 3)
    for name in whole.channels:
        np.testing.assert_allclose(strips.channels[name], whole.channels[name], rtol=1e-4, atol=1e-4, err_msg=name)
    assert strips.energy.sent == pytest.approx(whole.energy.sent, rel=1e-4)
    assert strips.energy.deposited == pytest.approx(whole.energy.deposited, rel=1e-4)
    assert strips.energy.counts["emitted"] == whole.energy.counts["emitted"]
    assert strips.energy.counts["segments traced"] == whole.energy.counts["segments traced"]
    np.testing.assert_array_equal(np.sort(strips.photons.ids), np.sort(whole.photons.ids))


@pytest.mark.parametrize("name", ["cube-turning", "board-over-water"])
def test_strips_of_solids_and_boards_add_up_to_all_of_them(name, tmp_path, monkeypatch):
    settings = Settings(aovs=("irradiance",), samples=1, photons=PHOTONS, camera=CAMERA, image_width=64, exposure=1.0)
    source = StageScene.open(str(write(name, tmp_path)), settings)
    shutter = source.shutter(FRAME, settings)
    whole, strips = frames_of(source, settings, shutter, source.resolution(), monkeypatch, 2)
    a, b = (frame.channels["irradiance.R"].astype(float) for frame in (whole, strips))
    # Errors of the frame itself are six times as large.
    assert np.sqrt(np.mean((a - b) ** 2)) < 0.007 * a.mean()
    energy = strips.energy
    gone = energy.deposited + energy.escaped + energy.absorbed + energy.lost_total
    assert gone == pytest.approx(energy.sent, rel=1e-5)
    assert energy.sent == pytest.approx(whole.energy.sent, rel=1e-3)
    assert len(np.unique(strips.photons.ids)) == len(strips.photons)


def test_what_the_camera_sees_is_looked_at_once(monkeypatch):
    looked = []

    class Counted(CameraView):
        def look(self):
            looked.append(self)
            yield from super().look()

    monkeypatch.setattr("tpdwarp.rendering.frame.CameraView", Counted)
    monkeypatch.setattr(temporal, "PHOTONS_OF_STRIP", PHOTONS // 4)
    settings = Settings(aovs=("irradiance", "direct"), samples=1, photons=PHOTONS)
    kept = render_frame(RenderContext(wave_source(Wave()), settings), Shutter(0, 0.0, 1.0), 32, 4)
    assert len(looked) == 1
    monkeypatch.setattr("tpdwarp.rendering.kept_view.MOST_BYTES", 0.0)
    seen_again = render_frame(RenderContext(wave_source(Wave()), settings), Shutter(0, 0.0, 1.0), 32, 4)
    assert len(looked) == 5
    for name in kept.channels:
        np.testing.assert_array_equal(kept.channels[name], seen_again.channels[name])


def test_photons_that_nobody_asks_for_are_counted_only():
    settings = Settings(aovs=("irradiance",), samples=1, photons=1024)
    frame = render_frame(RenderContext(wave_source(Wave()), settings), Shutter(0, 0.0, 1.0), 8, 2, keeping=False)
    assert len(frame.landed) == frame.energy.counts["landed"] > 0
    assert not frame.landed._maps
