"""Pixels are compared as OpenImageIO's compare, and with it idiff, compares them."""

import numpy as np
import OpenImageIO as oiio
import pytest

from tpdwarp.checks.pixels import bands, compare_pixels, root_mean_square


@pytest.mark.parametrize("shape", [(1, 1, 1), (3, 5, 2), (300, 700, 3), (90_000, 1, 4)])
@pytest.mark.parametrize("limits", [((0.02, 0.05), (0.01, 0.02)), ((0.0, 0.0), (0.05, 0.0)), ((0.01, 9.0), (9.0, 0.0))])
def test_counts_and_means_are_those_of_openimageio(shape, limits):
    generator = np.random.default_rng(sum(shape))
    baseline = generator.normal(0, 0.5, shape).astype(np.float32)
    image = baseline + generator.normal(0, 0.03, shape).astype(np.float32) * (generator.random(shape) < 0.4)
    found = compare_pixels(image, baseline, *limits)
    (fail, fail_relative), (warn, warn_relative) = limits
    buffers = [oiio.ImageBuf(np.ascontiguousarray(pixels)) for pixels in (image, baseline)]
    wanted = oiio.ImageBufAlgo.compare(*buffers, fail, warn, failrelative=fail_relative, warnrelative=warn_relative)
    assert (found.failed, found.warned) == (wanted.nfail, wanted.nwarn)
    assert found.rms == pytest.approx(wanted.rms_error, rel=1e-6)
    assert found.largest == pytest.approx(wanted.maxerror, rel=1e-6)
    row, column = np.unravel_index(np.argmax(found.difference), found.difference.shape)
    assert (column, row) == (wanted.maxx, wanted.maxy)


def test_limits_beyond_any_number_fail_no_pixel_and_warn_of_nothing():
    image, baseline = np.zeros((4, 4, 3), np.float32), np.full((4, 4, 3), 60000, np.float32)
    with np.errstate(all="raise"):
        found = compare_pixels(image, baseline, (float("inf"), float("inf")), (1e300, 1e300))
    assert (found.failed, found.warned) == (0, 0) and found.rms == 60000


def test_bands_cover_every_row_once():
    for shape in ((1, 1, 1), (1080, 1920, 3), (7, 200_000, 3)):
        rows = [row for band in bands(np.empty(shape, np.uint8)) for row in range(shape[0])[band]]
        assert rows == list(range(shape[0]))


def test_the_mean_square_of_large_values_does_not_overflow():
    assert root_mean_square(np.full((50, 50, 3), 1e30, np.float32)) == pytest.approx(1e30)
