"""The same scene far from the origin is the same frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from photons.traced import EPS, lamp

import tpdwarp
from tests.small_stage import write_stage
from tpdwarp.images import read_image

from .cases import MOTIONS, SAME, assert_same_frame, in_other_units, render

OFFSETS = [10.0, 1e3, 1e5, 1e7]


def placed(offset: float) -> np.ndarray:
    return offset * np.array([1.0, -1.0, 0.5])


@pytest.mark.parametrize("offset", OFFSETS)
@pytest.mark.parametrize("motion", MOTIONS)
def test_the_distance_from_the_origin_does_not_change_the_frame(motion, offset):
    here = MOTIONS[motion]()
    frame, far = render(here), render(in_other_units(here, offset=placed(offset)))
    assert_same_frame(far, frame)
    # Positions go out in single precision: they are as fine as that is out there.
    seen = frame.channels["A"] > 0
    for k, axis in enumerate("XYZ"):
        moved = far.channels[f"P.{axis}"].astype(float) - placed(offset)[k]
        error = np.abs(moved - frame.channels[f"P.{axis}"])[seen]
        assert error.max() <= 2 * EPS * (abs(placed(offset)[k]) + 16)


@pytest.mark.parametrize("offset", OFFSETS)
def test_photons_far_away_keep_their_places_and_differentials(offset):
    here = MOTIONS["rigid"](lamp((0.4, 0.1, 3)))
    near, far = (render(in_other_units(here, offset=o)).photons for o in (placed(0.0), placed(offset)))
    _, here, there = np.intersect1d(near.ids, far.ids, return_indices=True)
    # Those on the rim of the ball, where little is refracted, may miss it.
    assert near.flux[here].sum() > 0.99 * near.flux.sum()
    for name, size in (("positions", 3.0), ("dxdu", 0.1), ("dxdv", 0.1), ("dxdt", 0.3)):
        moved = placed(offset) if name == "positions" else 0.0
        error = np.abs(getattr(far, name)[there] - moved - getattr(near, name)[here])
        # Ten roundings and those of float64 out there, which glass amplifies up to some hundred times.
        assert np.quantile(error, 0.95) < 100 * (10 * EPS + 2.0**-53 * offset) * size, name


def rendered(path: Path, offset: float) -> dict[str, np.ndarray]:
    """Channels of the small stage with everything in it moved by ``offset`` in double precision."""
    write_stage(path)
    ops = 'uniform token[] xformOpOrder = ["xformOp:translate"]'
    moved = f"double3 xformOp:translate = ({offset}, {-offset}, {0.5 * offset})\n    {ops}"
    path.write_text(path.read_text().replace('def Xform "World"\n{\n', f'def Xform "World"\n{{\n    {moved}\n'))
    options = {"photons": 256, "samples": 1, "image_width": 24, "threads": 1, "aovs": ("caustic", "Z", "motion")}
    result = tpdwarp.render(path, path.with_suffix(".exr"), frames=[2], **options)
    assert result.ok
    return read_image(path.with_suffix(".exr"))[0]


@pytest.mark.parametrize("offset", OFFSETS)
def test_transforms_of_a_stage_are_taken_in_double_precision(tmp_path, offset):
    near, far = rendered(tmp_path / "near.usda", 0.0), rendered(tmp_path / "far.usda", offset)
    assert near["caustic.R"].max() > 0.05
    for name, values in near.items():
        # Colours are stored as half: a unit in the last place there is 2⁻¹¹ of the value.
        tolerance = (SAME if name[0] in "ZmP" else 2.0**-11) * np.abs(values).max()
        np.testing.assert_allclose(far[name], values, rtol=0, atol=tolerance, err_msg=name)
