import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import tpdwarp

ROOT = Path(tpdwarp.__file__).parent.parent
HEAVY = ("numpy", "warp", "pxr", "OpenImageIO")


def loaded_after(code):
    """Which heavy packages a fresh interpreter has loaded after ``code``."""
    script = f"import sys\n{code}\nprint(*[name for name in {HEAVY!r} if name in sys.modules])"
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True)
    return done.stdout.splitlines()[-1].split()


def test_importing_the_package_loads_nothing_heavy():
    assert loaded_after("import tpdwarp; tpdwarp.Settings(photons=3); tpdwarp.InputError('x'); dir(tpdwarp)") == []


def test_what_is_heavy_is_loaded_when_it_is_used():
    assert loaded_after("import tpdwarp; tpdwarp.render") == list(HEAVY)


@pytest.mark.parametrize("arguments", [["--help"], ["render", "--help"], ["info", "--help"], ["render", "x"]])
def test_help_and_wrong_usage_wait_for_nothing_heavy(arguments):
    assert loaded_after(f"from tpdwarp.cli import main; main({arguments!r})") == []


def test_every_public_name_is_there():
    for name in tpdwarp.__all__:
        assert getattr(tpdwarp, name).__doc__
    assert set(tpdwarp.__all__) <= set(dir(tpdwarp))
    with pytest.raises(AttributeError, match="nonsense"):
        _ = tpdwarp.nonsense


def test_the_version_is_the_projects():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert tpdwarp.__version__ == project["version"]


@pytest.mark.parametrize("switch", ["enable", "disable"])
def test_loading_is_not_searched_for_cycles_and_leaves_the_callers_choice(switch):
    code = (
        f"import gc, tpdwarp; gc.collect(); gc.{switch}(); before = gc.get_stats()[0]['collections']\n"
        "tpdwarp.render\n"
        "assert gc.get_stats()[0]['collections'] - before <= 1\n"
        f"assert gc.isenabled() == {switch == 'enable'}"
    )
    assert loaded_after(code) == list(HEAVY)
