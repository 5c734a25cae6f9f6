"""Deliberate faults are caught at calibrated limits, and honest renders pass; a script has the whole table."""

import importlib
import sys
from pathlib import Path

import pytest

import tpdwarp

SCRIPTS = Path(tpdwarp.__file__).parent.parent / "scripts"
# These are rendered anew, or traced; all others cost milliseconds.
RENDERED = (
    "shutter off by half a frame",
    "one photon in fifty lost",
    "index of refraction wrong by 1 %",
    "light 1 % dimmer",
    "D_t x forgotten",
)
TRACED = ("D_t x of the wrong sign", "stale ids")


@pytest.fixture(scope="module")
def mutations():
    sys.path.insert(0, str(SCRIPTS))
    try:
        yield importlib.import_module("check_mutations")
    finally:
        sys.path.remove(str(SCRIPTS))


@pytest.fixture(scope="module")
def shot(mutations, tmp_path_factory):
    return mutations.Shot(tmp_path_factory.mktemp("shot"), width=64)


def noticed(mutations, shot, faults, baseline):
    return {name: not mutations.found(shot, name, fault, baseline).ok for name, fault in faults.items()}


def test_every_fault_of_files_and_pixels_is_caught(mutations, shot):
    faults = {
        name: fault
        for name, fault in mutations.FRAME_FAULTS.items()
        if name in RENDERED or not fault.__qualname__.startswith("rendered")
    }
    assert len(faults) >= 25 and set(RENDERED) <= set(faults)
    caught = noticed(mutations, shot, faults, shot.frames)
    assert [name for name, found in caught.items() if not found] == []


def test_every_fault_of_photons_is_caught(mutations, shot):
    faults = {name: mutations.LAYER_FAULTS[name] for name in TRACED}
    assert noticed(mutations, shot, faults, shot.layer) == dict.fromkeys(TRACED, True)


def test_no_fault_is_no_finding(mutations, shot):
    assert not any(noticed(mutations, shot, mutations.NO_FAULTS, shot.frames).values())
    assert not any(noticed(mutations, shot, mutations.NO_LAYER_FAULTS, shot.layer).values())


@pytest.mark.parametrize("change", [{"seed": 1001}, {"seed": 1002}, {"threads": 1}, {"threads": 3}])
def test_honest_renders_raise_no_alarm(mutations, shot, change):
    result = mutations.honest(shot, **change)
    assert result.ok, [str(finding) for frame in result.failed for finding in frame.failures]
