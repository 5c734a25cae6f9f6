"""One baseline serves other processors: what rounds differently differs, and raises no alarm; a script has them all."""

import importlib
import sys
from pathlib import Path

import pytest

import tpdwarp
from tpdwarp.checks.limits import Limits

SCRIPTS = Path(tpdwarp.__file__).parent.parent / "scripts"
BUILDS = ("any x86-64: SSE2, no FMA", "products and sums fused")


@pytest.fixture(scope="module")
def processors():
    sys.path.insert(0, str(SCRIPTS))
    try:
        yield importlib.import_module("check_other_cpus")
    finally:
        sys.path.remove(str(SCRIPTS))


@pytest.mark.slow
def test_another_processors_rounding_passes_at_default_limits(processors, tmp_path):
    scene = processors.SCENES / "wave.usdc"
    processors.render(scene, tmp_path / "baseline", width=64, photons=1024)
    results = {}
    for title, build in processors.builds().items():
        if title in BUILDS:
            processors.render(scene, tmp_path / title, 64, 1024, build)
            results[title] = tpdwarp.check(tmp_path / title, tmp_path / "baseline", limits=Limits())
            assert processors.complaints(results[title], "fail") == []
            assert {frame.name for frame in results[title].frames} == {"3", "4", "photons 3", "photons 4"}
    # Were nothing different, nothing would have been shown.
    fused = results["products and sums fused"]
    assert not processors.same_photons(fused) and processors.largest(fused, "rmse") > 0
