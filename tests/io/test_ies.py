"""Profiles of luminaires, written here as the format has them."""

import math

import numpy as np
import pytest

from tpdwarp.io.ies import parsed_profile, read_profile


def profile(theta, phi, candela, kind=1, multiplier=1.0, ballast=1.0, tilt="NONE"):
    """The text of a file; ``candela`` is shape [phi, theta]."""
    header = f"1 -1 {multiplier} {len(theta)} {len(phi)} {kind} 2 0 0 0\n{ballast} 1.0 50"
    rows = "\n".join(" ".join(f"{value:.9g}" for value in row) for row in (theta, phi, *candela))
    return f"IESNA:LM-63-2002\n[TEST] none\n[MORE] 1 2 3\nTILT={tilt}\n{header}\n{rows}\n"


QUARTER = np.linspace(0, 90, 91)


def test_intensity_is_candela_times_multiplier_and_ballast():
    found = parsed_profile(profile([0, 45, 90], [0], [[100, 50, 0]], multiplier=2.0, ballast=0.5))
    np.testing.assert_allclose(found.at(np.radians([0, 22.5, 45, 90, 91])), [100, 75, 50, 0, 0])
    assert found.is_round


def test_a_lamp_that_leans_and_commas_are_passed_over():
    plain = profile([0, 45, 90], [0], [[100, 50, 25]])
    tilted = plain.replace("TILT=NONE\n", "TILT=INCLUDE\n1\n3\n0 45 90\n1.0 0.95 0.9\n").replace(" ", ", ")
    np.testing.assert_array_equal(parsed_profile(tilted).candela, parsed_profile(plain).candela)


def test_the_mean_over_what_is_covered_is_that_of_the_sphere():
    # ∫ cosθ sinθ dθ over the hemisphere is a half, by its ∫ sinθ dθ, which is one. Lines between values a degree apart
    # are lower than a cosine by 1/12 of the square of that, 2.5e-5 of it.
    cosine = np.cos(np.radians(QUARTER))
    assert parsed_profile(profile(QUARTER, [0], [cosine])).mean() == pytest.approx(0.5, rel=5e-5)
    both = np.linspace(0, 180, 181)
    assert parsed_profile(profile(both, [0], [np.abs(np.cos(np.radians(both)))])).mean() == pytest.approx(0.5, rel=5e-5)


def test_what_differs_around_the_axis_has_its_mean():
    # 1 + cos 2φ has the mean of one over a quarter, which stands for all.
    phi = np.linspace(0, 90, 91)
    candela = (1.0 + np.cos(2.0 * np.radians(phi)))[:, None] * np.ones(3)
    found = parsed_profile(profile([0, 45, 90], phi, candela))
    np.testing.assert_allclose(found.around(), 1.0, rtol=1e-9)
    assert not found.is_round


@pytest.mark.parametrize(
    "text",
    ["", "TILT=NONE\n1 2 3", "TILT=NONE\nnumbers are words", profile([0, 90], [0], [[1, 1]], kind=2),
     profile([90, 0], [0], [[1, 1]]), profile([0, 90], [0], [[0, 0]]), profile([0, 90], [0, 90], [[1, 1]])],
)  # fmt: skip
def test_what_is_no_profile_is_none(tmp_path, text):
    file = tmp_path / "a.ies"
    file.write_text(text)
    assert read_profile(file) is None and read_profile(tmp_path / "other.ies") is None


def test_files_are_read_whatever_their_bytes(tmp_path):
    file = tmp_path / "a.ies"
    file.write_bytes(b"[LUMINAIRE] \xb0\xff\r\n" + profile([0, 90], [0], [[4, 0]]).replace("\n", "\r\n").encode())
    assert read_profile(file).at(np.array([0.25 * math.pi])) == pytest.approx(2.0)
