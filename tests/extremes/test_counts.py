"""One photon and ten million, images of one pixel and one row, frames where and when nobody expects them."""

from __future__ import annotations

import math
import resource
from dataclasses import replace

import numpy as np
import pytest

import tpdwarp
from tests.small_stage import write_stage
from tests.view.scenes import looking_down
from tpdwarp.io.images import read_image
from usd_scenes.oracle.closed_forms import fresnel_reflectance

from .cases import MOTIONS, assert_balanced, assert_photons_finite, render, slab


@pytest.mark.parametrize("segments", [1, 64])
@pytest.mark.parametrize("motion", MOTIONS)
def test_one_photon_stands_for_all(motion, segments):
    frame = render(MOTIONS[motion](), photons=1, segments=segments)
    many = render(MOTIONS[motion]())
    # One cell as large as all that is aimed at: from the square about the ball a fifth more than hits it.
    assert frame.energy.sent == pytest.approx(many.energy.sent, rel=0.3)
    assert frame.channels["caustic.R"].max() <= 4 * many.channels["caustic.R"].max()


@pytest.mark.slow
def test_ten_million_photons_are_traced_and_gathered_in_little_memory():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    # Pixels as small as footprints: those that footprints are spread over cost as many evaluations.
    here = replace(slab((0, 0, -1), 1.33), camera=looking_down((-2e-3, 2e-3, -2e-3, 2e-3), height=0.6))
    frame = render(here, width=4, height=4, photons=10**7, path="straight", aovs=("irradiance",))
    counts = frame.energy.counts
    # Cells that the border of the glass runs through are emitted, too: up to ten rows in 3162.
    assert counts["emitted"] == pytest.approx(10**7, rel=10 / 3162) and len(frame.photons) == counts["landed"] > 9.9e6
    passing = 1 - fresnel_reflectance(0.0, 1.0, 1.33)
    assert frame.energy.sent == pytest.approx(12, rel=1e-5)
    assert frame.energy.deposited == pytest.approx(12 * passing, rel=1e-5)
    assert frame.channels["irradiance.R"] == pytest.approx(passing, rel=0.02)
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert used < 6 * 2**20


@pytest.mark.parametrize("size", [(1, 1), (8192, 1), (1, 8192)])
@pytest.mark.parametrize("motion", MOTIONS)
def test_images_of_one_pixel_or_one_row_are_rendered(motion, size):
    frame = render(MOTIONS[motion](), width=size[0], height=size[1])
    assert frame.channels["R"].shape == size[::-1]
    assert frame.channels["R"].max() > 0.01


OPTIONS = {"photons": 256, "samples": 1, "image_width": 12, "threads": 1}


def sent(path, frame: float, out: str = "f.exr", **options) -> tuple[float, dict[str, np.ndarray]]:
    result = tpdwarp.render(path, path.parent / out, frames=[frame], **OPTIONS, **options)
    assert result.ok
    (energy,) = result.energy.values()
    assert_balanced(energy)
    return energy.sent, read_image(result.outcomes[0].path)[0]


@pytest.mark.parametrize("frame", [-1e6, -1.0, 4.0, 1e6])
def test_a_frame_outside_the_stage_is_its_nearest_end(tmp_path, frame):
    path = tmp_path / "s.usda"
    write_stage(path)
    end = 1.0 if frame < 1 else 3.0
    (here, picture), (there, wanted) = sent(path, frame, exposure=0.0), sent(path, end, exposure=0.0)
    assert here == pytest.approx(there, rel=1e-6)
    np.testing.assert_array_equal(picture["R"], wanted["R"])
    # With a shutter it stands still there, too.
    assert np.abs(sent(path, frame, exposure=0.5, aovs=("motion",))[1]["motion.Z"]).max() == 0


def test_time_codes_far_from_zero_are_as_good_as_any(tmp_path):
    near, far = tmp_path / "near.usda", tmp_path / "far.usda"
    write_stage(near)
    write_stage(far)
    text = far.read_text().replace("startTimeCode = 1", "startTimeCode = -999999")
    text = text.replace("endTimeCode = 3", "endTimeCode = -999997")
    for frame in (1, 2, 3):
        text = text.replace(f"            {frame}: [", f"            {frame - 1000000}: [")
    far.write_text(text)
    options = {"exposure": 0.5, "aovs": ("caustic", "motion", "Z")}
    _, wanted = sent(near, 2.0, "n.exr", **options)
    _, found = sent(far, -999998.0, "f.exr", **options)
    for name, values in wanted.items():
        # A time code of 1e6 has 2⁻³³ of a frame left, which is less than float32 leaves of the way.
        np.testing.assert_allclose(found[name], values, atol=2.0**-10 * np.abs(values).max(), err_msg=name)


@pytest.mark.parametrize("third", [4 / 3, 5 / 3, 7 / 3])
def test_thirds_of_frames_lie_where_they_should(tmp_path, third):
    path = tmp_path / "s.usda"
    write_stage(path)
    photons = tpdwarp.trace_photons(path, third, photons=64, exposure=0.0)
    assert_photons_finite(photons)
    result = tpdwarp.render(path, tmp_path / "f.####.#########.exr", frames=[third], exposure=0.5, **OPTIONS)
    assert result.ok and f"{third:.9f}" in result.outcomes[0].path
    assert math.isclose(result.outcomes[0].frame, third)


@pytest.mark.parametrize("exposure", [0.5, 5.0])
@pytest.mark.parametrize("frames", [1, 2])
def test_blur_asked_of_a_stage_of_one_frame_is_a_still(tmp_path, frames, exposure):
    path = tmp_path / "s.usda"
    write_stage(path, frames=1)
    flux, picture = sent(path, float(frames), exposure=exposure, aovs=("motion",))
    still, wanted = sent(path, float(frames), exposure=0.0, aovs=("motion",))
    assert flux == pytest.approx(still, rel=1e-6)
    np.testing.assert_array_equal(picture["R"], wanted["R"])
    assert not any(np.any(picture[f"motion.{axis}"]) for axis in "XYZ")
