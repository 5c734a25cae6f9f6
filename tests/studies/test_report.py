import base64
import re

import pytest

from tests.studies.made import measured, study_result, three_cases
from tpdwarp.io.images import read_image
from tpdwarp.studies.report import MOST_PICTURES, page, write_report


def pictures(text, tmp_path):
    """The page's pictures, red, green and blue of each, shape [3, h, w]."""
    found = []
    for number, data in enumerate(re.findall(r"data:image/png;base64,([\w+/=]+)", text)):
        path = tmp_path / f"{number}.png"
        path.write_bytes(base64.b64decode(data))
        planes = read_image(path)[0]
        found.append([planes[name] for name in "RGB"])
    return found


def test_the_page_needs_nothing_from_outside(tmp_path):
    write_report(tmp_path / "a.html", three_cases())
    text = (tmp_path / "a.html").read_text(encoding="utf-8")
    # A name within the page begins with #.
    assert not re.findall(r'(?:src|href)="(?!data:|#)|url\((?!#)', text) and "<script" not in text
    names = re.findall(r'\bid="([^"]*)"', text)
    assert {*re.findall(r'href="#([^"]*)"', text), *re.findall(r"url\(#([^)]*)\)", text)} == {*names}


def test_each_case_is_shown_beside_the_map_of_its_errors(tmp_path):
    found = pictures(page(three_cases()), tmp_path)
    # The truth, then pairs.
    assert len(found) == 1 + 2 * 3
    for _, difference in zip(found[1::2], found[2::2], strict=True):
        # All are brighter than the truth.
        assert (difference[0] >= difference[2]).all() and (difference[0] > difference[2]).any()


def test_too_dark_is_blue(tmp_path):
    red, _, blue = pictures(page(study_result(measured("a", 1, 0.8, 1.0))), tmp_path)[2]
    assert (blue > red).all()


def test_a_long_study_shows_a_choice_with_the_front():
    many = [measured(f"series {n}", 1, 1.01 + 0.01 * n, 1.0 + n) for n in range(2 * MOST_PICTURES)]
    text = page(study_result(*many))
    assert text.count("<figure>") == 1 + MOST_PICTURES and "series 0, 1 photons" in text


@pytest.mark.parametrize("word", ["noise of 0.01", "Pareto front", "tpd K=1", "+0.2000", "CPU s"])
def test_the_page_says_what_was_measured(word):
    assert word in page(three_cases())


def test_what_failed_and_what_was_left_is_said():
    text = page(study_result(measured("a", 1, 1.1, 1.0), failed={"b": "<broke>"}, left=("c",)))
    assert "b: &lt;broke&gt;" in text and "Time was up before 1 more: c" in text
