"""Middle and motion over a shutter, within the animation and past its ends."""

import numpy as np
import pytest

from tpdwarp.scene.description import Shutter
from tpdwarp.usd.read.motion import DERIVATIVE_STEP, blur_scaled, over_shutter, touched

SPAN = (1.0, 5.0)


def square(time):
    return (np.array([time * time]),)


def over(shutter, state=square, cubic=False, span=SPAN):
    (middle,), motions = over_shutter(state, shutter, span, cubic)
    return float(middle[0]), None if motions is None else float(motions[0][0])


def test_middle_is_evaluated_and_motion_is_the_difference_of_the_ends():
    assert over(Shutter(2, 2, 3)) == (6.25, 5.0)


def test_cubic_motion_is_the_derivative_at_the_middle_times_the_exposure():
    middle, motion = over(Shutter(2, 2, 3), lambda t: (np.array([t**3]),), cubic=True)
    assert middle == 2.5**3
    # A central difference of t³ exceeds the derivative by the step squared.
    assert motion == pytest.approx(3 * 2.5**2 + DERIVATIVE_STEP**2, abs=1e-9)


def test_a_still_and_an_unmoving_state_have_no_motion():
    assert over(Shutter.still(2.5)) == (6.25, None)
    assert over(Shutter(2, 2, 3), lambda t: (np.array([7.0]),)) == (7.0, None)


@pytest.mark.parametrize("cubic", [False, True])
def test_past_the_last_frame_motion_is_the_backward_difference(cubic):
    middle, motion = over(Shutter(5, 5, 6), cubic=cubic)
    assert motion == pytest.approx(25 - 16, rel=1e-12)
    assert middle == pytest.approx(25 + 4.5, rel=1e-12)


def test_before_the_first_frame_motion_is_the_forward_difference():
    assert over(Shutter(1, 0, 1)) == (1 - 1.5, 3.0)


def test_a_shutter_across_the_end_joins_both_rules():
    middle, motion = over(Shutter(5, 4.5, 5.5))
    assert middle == 25
    assert motion == pytest.approx((25 - 4.5**2) + 0.5 * (25 - 16), rel=1e-12)


def test_segments_past_the_end_continue_one_line():
    parts = [over(part) for part in Shutter(5, 5, 6).segments(4)]
    slope = (25 - 4.75**2) / 0.25
    for k, (middle, motion) in enumerate(parts):
        assert middle == pytest.approx(25 + slope * (k + 0.5) / 4, rel=1e-12)
        assert motion == pytest.approx(slope / 4, rel=1e-12)


def test_a_still_inside_the_shutter_of_the_last_frame_moves_on_too():
    assert over(Shutter(5, 5.5, 5.5)) == (25 + 4.5, None)


def test_a_frame_outside_the_animation_holds_its_end():
    assert over(Shutter(7, 7, 8)) == (25.0, None)
    assert over(Shutter(-1, -1, 0)) == (1.0, None)


def test_the_difference_never_reaches_past_the_other_end():
    assert over(Shutter(2, 2, 6), span=(1.0, 2.0)) == (4 + 3 * 2.0, 12.0)


@pytest.mark.parametrize("shutter", [Shutter(5, 5, 6), Shutter(1, 0, 1), Shutter(3, 2.5, 3.5), Shutter(9, 9, 10)])
def test_touched_holds_every_time_evaluated(shutter):
    seen = []

    def state(time):
        seen.append(time)
        return square(time)

    over(shutter, state)
    first, last = touched(shutter, SPAN)
    assert (first, last) == (min(seen), max(seen))


def test_blur_scale_shrinks_the_shutter_about_its_frame():
    scaled = blur_scaled(Shutter(2, 1.5, 3), 0.5)
    assert (scaled.frame, scaled.open, scaled.close) == (2, 1.75, 2.5)


def test_an_animation_of_one_moment_goes_on_as_its_state_says_and_other_frames_hold_it():
    moment = (2.0, 2.0)
    assert over(Shutter(2, 2, 3), span=moment) == (6.25, 5.0)
    assert touched(Shutter(2, 1.5, 2.5), moment) == (1.5, 2.5)
    assert over(Shutter(3, 3, 4), span=moment) == (4.0, None)
