"""Faint branches of cells that are traced in parts of the shutter."""

from __future__ import annotations

import numpy as np
import pytest

from tpdwarp.estimators import temporal
from tpdwarp.photons.energy import BELOW_CUTOFF
from tpdwarp.photons.record import PART_IDS
from tpdwarp.rendering.context import RenderContext
from tpdwarp.rendering.frame import Frame, render_frame
from tpdwarp.settings import Settings
from tpdwarp.trajectories import faint_branches
from tpdwarp.trajectories.retraced import FAINT_BRANCH
from tpdwarp.usd.read.stage import StageScene
from usd_scenes.solids import write
from usd_scenes.stage import CAMERA, FRAME

SETTINGS = Settings(
    photons=4096, segments=1, samples=1, exposure=1.0, camera=CAMERA, image_width=48, aovs=("irradiance",)
)


@pytest.fixture
def entered(monkeypatch):
    """The parts of a cell's flux below which branches are not entered in parts of the shutter, as they are chosen."""
    chosen, choose = [], temporal.cutoff_in_parts

    def noted(*given) -> float:
        chosen.append(choose(*given))
        return chosen[-1]

    monkeypatch.setattr(temporal, "cutoff_in_parts", noted)
    return chosen


def rendered(scene: str, folder) -> Frame:
    stage = StageScene.open(str(write(scene, folder)), SETTINGS)
    return render_frame(RenderContext(stage, SETTINGS), stage.shutter(FRAME, SETTINGS), 48, 48)


def test_faint_branches_are_neither_missing_nor_there_twice(tmp_path, monkeypatch, entered):
    found = rendered("cube-turning", tmp_path)
    assert entered == [FAINT_BRANCH]
    monkeypatch.setattr(temporal, "cutoff_in_parts", lambda *given: SETTINGS.branch_cutoff)
    followed = rendered("cube-turning", tmp_path)
    # They are 2 % of the light, as bright in the middle as in the mean but for what begins and ends.
    light, all_light = (frame.channels["irradiance.R"].mean() for frame in (found, followed))
    assert light == pytest.approx(all_light, rel=1e-3)
    in_parts, all_in_parts = (int((frame.photons.ids >= PART_IDS).sum()) for frame in (found, followed))
    assert 0 < in_parts < 0.6 * all_in_parts
    # No photon is there twice.
    assert len(set(found.photons.ids.tolist())) == len(found.photons)
    # What is not entered counts neither as sent nor as lost.
    for energy in (found.energy, followed.energy):
        gone = energy.deposited + energy.escaped + energy.absorbed + energy.lost_total
        assert gone == pytest.approx(energy.sent, rel=1e-6)
    # Light grazes a side of the cube: what is faint in the middle is not before and after. Counted in both, .0034 more
    # would be sent.
    assert found.energy.sent == pytest.approx(followed.energy.sent, rel=5e-4)
    assert found.energy.deposited == pytest.approx(followed.energy.deposited, rel=4e-3)
    lost, all_lost = (energy.lost[BELOW_CUTOFF] / energy.sent for energy in (found.energy, followed.energy))
    assert lost == pytest.approx(all_lost, rel=0.1)


@pytest.fixture
def shone(monkeypatch):
    """What is given to :func:`shining_on`, and the photons that it gives back."""
    calls, shine = [], temporal.shining_on

    def noted(*given):
        calls.append((given, shine(*given)))
        return calls[-1][1]

    monkeypatch.setattr(temporal, "shining_on", noted)
    return calls


def test_faint_photons_shine_while_their_path_is_entered_in_no_part(tmp_path, shone):
    rendered("cube-turning", tmp_path)
    ((photons, faint, plan, parts, times, *_), found), *_ = shone
    entered: dict[int, float] = {}
    for (part, of_part), shares in zip(parts, times, strict=True):
        assert of_part is plan
        for number, share in zip(part.ids.tolist(), shares.tolist(), strict=True):
            entered[number] = entered.get(number, 0.0) + share
    left = np.array([1.0 - min(entered.get(number, 0.0), 1.0) for number in photons.ids.tolist()])
    before, after = (light.flux.sum(axis=1, dtype=np.float64) for light in (photons, found))
    np.testing.assert_array_equal(after[~faint], before[~faint])
    grown = after[faint & (left == 1.0)] / before[faint & (left == 1.0)]
    partly = faint & (left < 0.9)
    assert partly.sum() > 20 and len(grown) > 100
    np.testing.assert_allclose(grown, grown[0], rtol=1e-5)
    np.testing.assert_allclose(after[partly], grown[0] * left[partly] * before[partly], rtol=1e-5, atol=1e-12)


def test_light_that_no_faint_photon_stands_for_is_lost(tmp_path, monkeypatch):
    whole = rendered("cube-turning", tmp_path).energy
    monkeypatch.setattr(faint_branches, "MOST_GROWTH", 0.5)
    energy = rendered("cube-turning", tmp_path).energy
    assert energy.sent == pytest.approx(whole.sent, rel=1e-6)
    assert energy.escaped == pytest.approx(whole.escaped, rel=1e-6)
    unshown = whole.deposited - energy.deposited
    assert unshown > 1e-3 * whole.sent
    assert energy.lost[BELOW_CUTOFF] - whole.lost[BELOW_CUTOFF] == pytest.approx(unshown, rel=1e-4)
    gone = energy.deposited + energy.escaped + energy.absorbed + energy.lost_total
    assert gone == pytest.approx(energy.sent, rel=1e-6)


def test_mid_shutter_does_not_speak_for_light_that_lasts_for_less_than_the_shutter(tmp_path, entered):
    """Light leaves a prism that turns out of total reflection: nothing of it is there in the middle of the shutter."""
    rendered("prism-turning", tmp_path)
    assert entered and set(entered) == {SETTINGS.branch_cutoff}
