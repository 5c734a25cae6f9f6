"""What USD says becomes one line of bounded length, whatever it quotes."""

import time

import pytest

from tpdwarp.errors import InputError
from tpdwarp.settings import Settings
from tpdwarp.usd.read.stage import StageScene


@pytest.mark.parametrize("size", [10, 3_000_000])
def test_a_layer_whose_only_line_is_wrong_is_quoted_in_a_few_words(tmp_path, size):
    path = tmp_path / "a.usda"
    path.write_text("#usda 1.0\ndef " + "x" * size)
    started = time.monotonic()
    with pytest.raises(InputError) as refusal:
        StageScene.open(path, Settings())
    assert len(refusal.value.message) <= 240 and "\n" not in refusal.value.message
    assert "a.usda:2" in refusal.value.message and "Error in" not in refusal.value.message
    # A pattern that is looked for in all of it, and not in its beginning, takes minutes.
    assert time.monotonic() - started < 30
