import math
import re
from xml.etree import ElementTree

import pytest

from tpdwarp.studies.plot import Series, log_plot

SVG = "{http://www.w3.org/2000/svg}"


def circles(svg):
    """Centres of the points that say something."""
    return [
        (float(c.get("cx")), float(c.get("cy"))) for c in ElementTree.fromstring(svg).iter(f"{SVG}circle") if len(c)
    ]


def test_equal_ratios_are_equal_distances():
    points = [(0.1, 1.0, "a"), (1.0, 0.1, "b"), (10.0, 0.01, "c")]
    (x0, y0), (x1, y1), (x2, y2) = circles(log_plot([Series("s", points)], [], "x", "y"))
    assert x1 - x0 == pytest.approx(x2 - x1, abs=0.11) and y1 - y0 == pytest.approx(y2 - y1, abs=0.11)
    assert x0 < x1 and y0 < y1


def test_all_points_lie_inside_the_frame():
    points = [(0.003 * 1.7**i, 0.5 / 1.3**i, str(i)) for i in range(20)]
    found = circles(log_plot([Series("s", points)], [], "x", "y", floor=1e-4))
    assert len(found) == 20
    assert all(70 <= x <= 560 and 20 <= y <= 430 for x, y in found)


def test_the_front_goes_through_its_points_in_order():
    points = [(1.0, 0.5, "a"), (2.0, 0.2, "b"), (5.0, 0.1, "c")]
    svg = log_plot([Series("s", points)], [(x, y) for x, y, _ in points], "x", "y")
    path = re.search(r'class="front" d="M([^"]*)"', svg)[1]
    assert [tuple(map(float, pair.split())) for pair in path.split("L")] == circles(svg)


def test_names_and_notes_are_escaped_and_shown():
    svg = log_plot([Series("a<b", [(1.0, 1.0, "x & y")])], [], "time <s>", "error")
    text = [element.text for element in ElementTree.fromstring(svg).iter() if element.text]
    assert {"a<b", "x & y", "time <s>", "error"} <= set(text)


def test_one_point_or_none_still_makes_a_picture():
    for points in ([], [(1.0, 1.0, "")], [(math.pi, 1e-9, "")]):
        ElementTree.fromstring(log_plot([Series("s", points)], [], "x", "y"))
