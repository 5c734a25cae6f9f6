import json

import pytest

from tpdwarp.jobs.results import FrameOutcome, SequenceResult
from tpdwarp.jobs.statistics import statistics_of, versions, write_statistics
from tpdwarp.settings import Settings


def test_versions_name_the_program_and_its_libraries():
    found = versions()
    assert set(found) == {"tpdwarp", "python", "warp-lang", "numpy", "usd-core", "OpenImageIO"}
    assert "unknown" not in found.values()


def test_the_default_time_is_null_as_json_has_no_nan():
    result = SequenceResult((FrameOutcome(float("nan"), "written", "a.exr"),), 1.0)
    assert statistics_of("s.usda", Settings(), result)["frames"][0]["frame"] is None


def test_statistics_are_json_or_absent(tmp_path):
    write_statistics(tmp_path / "a.json", {"seconds": 1.5})
    assert json.loads((tmp_path / "a.json").read_text()) == {"seconds": 1.5}
    with pytest.raises(ValueError):
        write_statistics(tmp_path / "b.json", {"seconds": float("nan")})
    assert [path.name for path in tmp_path.iterdir()] == ["a.json"]
