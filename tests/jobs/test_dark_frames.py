"""Frames that show nothing are said, once."""

import numpy as np
import pytest

from tpdwarp.jobs.dark_frames import DarkWatch


def channels(color=0.0, alpha=0.0):
    return {**{name: np.full((2, 3), color, np.float32) for name in "RGB"}, "A": np.full((2, 3), alpha, np.float32)}


@pytest.mark.parametrize(("alpha", "why"), [(0.0, "nothing is in view"), (1.0, "no light reaches")])
def test_the_first_black_frame_is_said_with_its_cause(caplog, alpha, why):
    watch = DarkWatch("scene.usda")
    for frame in (1.0, 2.0):
        watch(frame, channels(alpha=alpha))
    (message,) = (record.getMessage() for record in caplog.records)
    assert message.startswith("scene.usda: frame 1 is black: ") and why in message


def test_a_frame_with_light_anywhere_is_not_mentioned(caplog):
    lit = channels(alpha=1.0)
    lit["B"][1, 2] = 1e-6
    DarkWatch("scene.usda")(1.0, lit)
    assert not caplog.records
