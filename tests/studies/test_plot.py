import math
import subprocess
import sys
from xml.etree import ElementTree

import numpy as np
import pytest

from tpdwarp.studies.plot import Series, log_plot

SVG = "{http://www.w3.org/2000/svg}"
# The picture has six decimals of a point.
ROUNDED = 2e-6


def marks(svg):
    """Places on the page of the points that say something, by what they say."""
    found = {}
    for group in ElementTree.fromstring(svg).iter(f"{SVG}g"):
        title = group.find(f"{SVG}title")
        if title is not None:
            (use,) = group.iter(f"{SVG}use")
            found[title.text] = (float(use.get("x")), float(use.get("y")))
    return found


def vertices(path):
    """Of a polyline; none of anything else."""
    words = path.get("d").split()
    numbers = [float(word) for word in words if word not in "ML"] if set(words[::3]) == {"M", "L"} else []
    return list(zip(numbers[::2], numbers[1::2], strict=True))


def test_equal_ratios_are_equal_distances():
    points = [(0.1, 1.0, "a"), (1.0, 0.1, "b"), (10.0, 0.01, "c")]
    found = marks(log_plot([Series("s", points)], [], "x", "y"))
    (x0, y0), (x1, y1), (x2, y2) = (found[name] for name in "abc")
    assert x1 - x0 == pytest.approx(x2 - x1, abs=ROUNDED) and y1 - y0 == pytest.approx(y2 - y1, abs=ROUNDED)
    # Down the page is towards smaller errors.
    assert x0 < x1 and y0 < y1


def test_points_are_joined_in_their_order_and_say_what_they_are():
    points = [(1.7**i, (2 + (-1) ** i) / 1.3**i, str(i)) for i in range(8)]
    svg = log_plot([Series("s", points)], [], "x", "y", floor=1e-2)
    found = marks(svg)
    assert set(found) == {note for _, _, note in points}
    lines = [vertices(path) for path in ElementTree.fromstring(svg).iter(f"{SVG}path")]
    (line,) = [line for line in lines if len(line) == len(points)]
    np.testing.assert_allclose(line, [found[note] for _, _, note in points], atol=ROUNDED)


def test_the_front_goes_through_its_points_in_order():
    points = [(1.0, 0.5, "a"), (2.0, 0.2, "b"), (5.0, 0.1, "c")]
    svg = log_plot([Series("s", points)], [(x, y) for x, y, _ in points], "x", "y")
    (front,) = [group for group in ElementTree.fromstring(svg).iter(f"{SVG}g") if group.get("class") == "front"]
    np.testing.assert_allclose(vertices(front.find(f"{SVG}path")), [marks(svg)[name] for name in "abc"], atol=ROUNDED)


def test_names_and_notes_are_shown_as_they_are_and_not_as_formulas():
    svg = log_plot([Series("a<b $x_1$", [(1.0, 1.0, "x & y")])], [(1.0, 1.0)], "time <s> $1", "error $2$", 0.5)
    text = {element.text for element in ElementTree.fromstring(svg).iter() if element.text}
    assert {"a<b $x_1$", "x & y", "time <s> $1", "error $2$", "Pareto front", "noise of truth"} <= text


def test_one_point_or_none_still_makes_a_picture():
    for points in ([], [(1.0, 1.0, "one")], [(math.pi, 1e-9, "one")]):
        svg = log_plot([Series("s", points)], [], "x", "y")
        assert list(marks(svg)) == ["one"] * len(points)


def test_the_same_plot_is_the_same_text_in_every_process():
    code = (
        "from tpdwarp.studies.plot import Series, log_plot\n"
        "print(log_plot([Series('s', [(1, 2, 'a'), (3, 1, 'b')]), Series('t', [(2, 2, 'c')])], [(1, 2)], 'x', 'y', 1))"
    )
    texts = [subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout for _ in range(2)]
    assert texts[0] == texts[1] and b"<svg" in texts[0]


def test_twenty_series_are_told_apart_by_colour_and_marker():
    series = [Series(f"s{n}", [(1.0 + n, 1.0, f"s{n}")]) for n in range(20)]
    looks = set()
    for group in ElementTree.fromstring(log_plot(series, [], "x", "y")).iter(f"{SVG}g"):
        if group.find(f"{SVG}title") is not None:
            (use,) = group.iter(f"{SVG}use")
            looks.add((use.get("{http://www.w3.org/1999/xlink}href"), use.get("style")))
    assert len(looks) == 20
