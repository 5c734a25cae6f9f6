"""Pages are readable by everyone: contrast, escapes, words for curves."""

import json
import re
from importlib import resources

import pytest

from tpdwarp.html.curves import curve_figure
from tpdwarp.html.page import data_block, write_page

STYLES = resources.files("tpdwarp.html").joinpath("page.css").read_text()
THEMES = re.findall(r":root \{(.*?)\}", STYLES, re.DOTALL)


def luminance(color: str) -> float:
    """WCAG 2's relative luminance."""
    parts = [int(color[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("theme", [0, 1], ids=["light", "dark"])
@pytest.mark.parametrize("ink", ["ink", "soft", "good", "warn", "bad", "accent", "first", "second", "third", "fourth"])
def test_text_and_curves_have_the_contrast_of_wcag_aa(theme, ink):
    colors = dict(re.findall(r"--([a-z-]+): (#[0-9a-f]{6});", THEMES[theme]))
    for ground in ("page", "card"):
        pair = sorted((luminance(colors[ink]), luminance(colors[ground])))
        assert (pair[1] + 0.05) / (pair[0] + 0.05) >= 4.5, (ink, ground)


def test_data_survive_a_page_whatever_they_hold(tmp_path):
    value = {"text": "</script><!-- & \u2028 é", "list": [1, None]}
    write_page(tmp_path / "p.html", "a <title>", [data_block("d", value)])
    page = (tmp_path / "p.html").read_text(encoding="utf-8")
    found = re.search(r'id="d">(.*?)</script>', page, re.DOTALL)
    assert json.loads(found[1]) == value and "<title>a &lt;title&gt;</title>" in page


def test_curves_keep_gaps_and_lone_values_and_speak():
    figure = curve_figure("E & F", [1, 2, 3, 4, 5], {"A": [1.0, 2.0, None, 3.0, float("nan")]}, limit=2.5)
    assert figure.count('<polyline class="curve first"') == 1 and figure.count("<circle") == 1
    assert 'aria-label="E &amp; F, frame 1 to 5, values from 1 to 3"' in figure and "limit 2.5" in figure


def test_no_values_make_no_figure():
    assert curve_figure("x", [1, 2], {"A": [None, None]}) == ""


def test_a_limit_is_marked_below_zero_too_where_values_go_there():
    for values, count in (([1.0, 2.0], 1), ([-3.0, 2.0], 2), ([-1.0, 2.0], 1)):
        figure = curve_figure("x", [1, 2], {"A": values}, limit=1.5)
        assert figure.split("<svg viewBox")[1].count('class="limit"') == count
