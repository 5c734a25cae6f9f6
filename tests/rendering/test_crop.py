"""A part of an image is what the whole image shows there, and its file says where it lies."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
import pytest

import tpdwarp
from tests.small_stage import write_stage
from tpdwarp.io.image_region import ImageRegion

FRAME = 2
SMALL = {"photons": 1024, "samples": 4, "image_width": 48, "threads": 1, "aovs": ["caustic", "Z", "id"]}
CROP = (10, 5, 31, 22)


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> str:
    return write_stage(tmp_path_factory.mktemp("small") / "small.usda")


def test_a_crop_is_that_part_of_the_whole(small):
    whole = tpdwarp.render_frame(small, FRAME, **SMALL).channels
    part = tpdwarp.render_frame(small, FRAME, **SMALL, crop=CROP).channels
    first, above, end, below = CROP
    assert whole.keys() == part.keys()
    for name, channel in part.items():
        expected = whole[name][above:below, first:end]
        assert channel.shape == (below - above, end - first)
        # The same samples; runs of queries are others, whose parabolas err by 1/500 of a footprint's peak.
        np.testing.assert_allclose(channel, expected, rtol=2e-3, atol=2e-3 * np.abs(expected).max(), err_msg=name)
    np.testing.assert_array_equal(part["Z"], whole["Z"][above:below, first:end])


def test_the_file_says_where_its_pixels_lie(small, tmp_path):
    tpdwarp.render(small, tmp_path / "f.exr", frames=FRAME, **SMALL, crop=CROP)
    spec = oiio.ImageInput.open(str(tmp_path / "f.exr")).spec()
    first, above, end, below = CROP
    assert (spec.x, spec.y, spec.width, spec.height) == (first, above, end - first, below - above)
    assert (spec.full_x, spec.full_y, spec.full_width, spec.full_height) == (0, 0, 48, 32)
    tpdwarp.render(small, tmp_path / "w.exr", frames=FRAME, **SMALL)
    spec = oiio.ImageInput.open(str(tmp_path / "w.exr")).spec()
    assert (spec.x, spec.y, spec.full_x, spec.full_y, spec.full_width, spec.full_height) == (0, 0, 0, 0, 48, 32)


def test_regions_keep_within_their_image():
    whole = ImageRegion.whole(40, 20)
    assert whole.is_whole and whole.size == (40, 20)
    assert whole.of_pixels(-5, 18, 100, 100) == ImageRegion(40, 20, 0, 40, 18, 20)
    assert whole.of_pixels(60, 60, 61, 61).size == (1, 1)
    assert whole.of_ndc((0.0, 0.0, 1.0, 1.0)) == whole
