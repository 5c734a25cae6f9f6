"""Laws of presets."""

from __future__ import annotations

import pytest

from tpdwarp.cli.options import settings_given
from tpdwarp.cli.parser import build_parser
from tpdwarp.errors import InputError
from tpdwarp.presets import PRESETS
from tpdwarp.settings import Settings


def test_explicit_settings_beat_the_preset():
    mine = Settings.of(preset="paper", kernel="cone", photons=7)
    assert (mine.kernel, mine.photons, mine.footprint) == ("cone", 7, "swept")


def test_a_preset_beats_the_settings_it_is_applied_to():
    mixed = Settings.of(Settings(photons=3, seed=5), preset="draft")
    assert mixed.photons == Settings.of(preset="draft").photons != 3
    assert mixed.seed == 5


def test_from_draft_to_final_nothing_gets_coarser():
    fine = [Settings.of(preset=name) for name in ("draft", "standard", "final")]
    for name in ("photons", "samples"):
        values = [getattr(settings, name) for settings in fine]
        assert values == sorted(values)


def test_the_paper_is_taken_to_the_letter():
    paper = Settings.of(preset="paper")
    assert (paper.emission, paper.anchor, paper.trace_at) == ("jittered", "light", "open")
    assert (paper.kernel, paper.footprint, paper.segments) == ("epanechnikov", "swept", 1)


def test_an_unknown_preset_is_refused():
    with pytest.raises(InputError, match=r"^preset must be one of draft, standard, final, paper, not 'best'"):
        Settings.of(preset="best")


@pytest.mark.parametrize("arguments", ["--preset final --photons 9", "--photons 9 --preset final"])
def test_on_the_command_line_flags_beat_the_preset_in_any_order(arguments):
    given = settings_given(build_parser(("render",)).parse_args(["render", "a", "b", *arguments.split()]))
    settings = Settings.of(**given)
    assert (settings.photons, settings.segments) == (9, PRESETS["final"]["segments"])
