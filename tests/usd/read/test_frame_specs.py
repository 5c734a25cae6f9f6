import pytest

from tpdwarp.errors import InputError
from tpdwarp.usd.read.frame_specs import frames_between, frames_of


@pytest.mark.parametrize(
    ("spec", "frames"),
    [
        ("7", (7,)),
        ("1:4", (1, 2, 3, 4)),
        ("1-4", (1, 2, 3, 4)),
        ("30:36x2", (30, 32, 34, 36)),
        ("30-36x2", (30, 32, 34, 36)),
        ("1:10x4", (1, 5, 9)),
        ("3:1", (3, 2, 1)),
        ("-2:1", (-2, -1, 0, 1)),
        ("-3--1", (-3, -2, -1)),
        ("1.5", (1.5,)),
        ("1:2x0.5", (1, 1.5, 2)),
        ("1:2,8, 4:5", (1, 2, 8, 4, 5)),
        ("1:3,2:4", (1, 2, 3, 4)),
    ],
)
def test_specs_name_frames_in_their_order_each_once(spec, frames):
    assert frames_of(spec) == frames


def test_fractional_strides_do_not_pile_up_rounding_errors():
    assert frames_of("0:1x0.1") == (0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1)


def test_zero_has_no_sign():
    assert [str(frame) for frame in frames_of("-1:0")] == ["-1.0", "0.0"]


@pytest.mark.parametrize(
    "spec",
    ["", ",", "1:2,", "a", "1:b", "1 2", "1:2x", "1:2x0", "5:1x2", "1:2:3", "0x10", "nan", "1:inf", "--1", "1e3"],
)
def test_bad_specs_are_refused_by_name(spec):
    with pytest.raises(InputError, match=r"^frames .*write for instance"):
        frames_of(spec)


@pytest.mark.parametrize("spec", ["1:9999999", "0:1x0.00000001", "1:600000,600001:1200000"])
def test_millions_of_frames_are_refused_before_they_are_listed(spec):
    with pytest.raises(InputError, match="more than 1000000 frames"):
        frames_of(spec)


def test_a_range_counts_up_from_its_start_by_ones():
    assert frames_between(1, 4) == (1, 2, 3, 4)
    assert frames_between(0.5, 3) == (0.5, 1.5, 2.5)
    assert frames_between(7, 7) == (7,)
    assert frames_between(7, 3) == (7,)
