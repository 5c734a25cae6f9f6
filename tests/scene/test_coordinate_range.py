"""What lies too far away to be computed with is refused, on whichever side of the scene and however it gets there."""

from dataclasses import replace

import numpy as np
import pytest

from tests.photons.shapes import floor
from tests.photons.traced import scene_of, sun
from tpdwarp.errors import InputError
from tpdwarp.scene.coordinate_range import LARGEST_COORDINATE, require_within_range
from tpdwarp.scene.normalization import Normalization

# In it the scene is of unit size.
NORM = Normalization((2.0, -1.0, 0.5), 1.0, 1.0)
LIMIT = LARGEST_COORDINATE


def require(points=None, motions=None):
    mesh = floor(0.0, 1.0)
    changed = np.array(mesh.points, float)
    for place, value in (points or {}).items():
        changed[place] = value
    require_within_range(scene_of([replace(mesh, points=changed, motions=motions)], sun()), NORM, "scene.usda")


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_the_largest_coordinate_counts_from_the_origin_of_the_scene(axis, sign):
    require({(1, axis): NORM.origin[axis] + sign * 0.999 * LIMIT})
    with pytest.raises(InputError, match="reaches 1e"):
        require({(1, axis): NORM.origin[axis] + sign * 1.001 * LIMIT})


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_half_of_the_motion_over_the_shutter_is_added(sign):
    motions = np.zeros((len(floor(0.0, 1.0).points), 3))
    motions[2, 1] = sign * 1.9 * LIMIT
    require(motions=motions)
    with pytest.raises(InputError):
        require(motions=1.1 * motions)


@pytest.mark.parametrize("axis", range(3))
def test_what_is_no_number_is_refused(axis):
    with pytest.raises(InputError):
        require({(3, axis): np.nan})
