"""Debug layers are compared photon by photon, matched by id and not by place."""

from dataclasses import replace

import numpy as np
import pytest
from pxr import Gf, Sdf

import tpdwarp
from tests.checks.images import write_sequence
from tests.small_stage import write_stage
from tpdwarp.checks.limits import PhotonLimits
from tpdwarp.checks.photons import photon_findings
from tpdwarp.checks.run import check
from tpdwarp.cli import main
from tpdwarp.photons.record import PhotonRecord

SIDE = 10


def photons() -> PhotonRecord:
    """A lattice on a plane, each with a footprint of one unit."""
    generator = np.random.default_rng(2)
    count = SIDE * SIDE
    cells = np.stack(np.meshgrid(np.arange(SIDE), np.arange(SIDE)), axis=-1).reshape(-1, 2).astype(float)
    ones = np.ones((count, 1))
    return PhotonRecord(
        ids=np.arange(count, dtype=np.int64) * 7,
        positions=np.column_stack([cells, np.zeros(count)]),
        normals=ones * [0, 0, 1],
        dxdu=ones * [1, 0, 0],
        dxdv=ones * [0, 1, 0],
        dxdt=generator.uniform(0.5, 1, (count, 3)) * [1, 1, 0],
        flux=np.ones((count, 3)),
        emission=cells,
        bounces=np.ones(count, np.int32),
        receivers=np.zeros(count, np.int32),
        receiver_paths=("/Floor", "/Wall"),
    )


def kinds(record: PhotonRecord, baseline: PhotonRecord | None = None) -> set[str]:
    against = photons() if baseline is None else baseline
    return {finding.kind for finding in photon_findings(record, against, PhotonLimits())}


def test_the_order_of_photons_does_not_matter():
    order = np.random.default_rng(1).permutation(SIDE * SIDE)
    assert kinds(photons().rows(order)) == set()


def test_stale_ids_are_found_though_the_same_photons_are_there():
    assert "position" in kinds(replace(photons(), ids=np.roll(photons().ids, 1)))


def test_a_turned_time_derivative_is_found_alone():
    assert kinds(replace(photons(), dxdt=-photons().dxdt)) == {"dxdt"}


@pytest.mark.parametrize("name", ["dxdu", "dxdv", "dxdt"])
def test_derivatives_are_compared_by_their_own_length(name):
    for factor, found in ((1.04, set()), (1.06, {name})):
        long = {name: 100 * getattr(photons(), name)}
        record = replace(photons(), **{name: factor * long[name]})
        assert kinds(record, replace(photons(), **long)) == found


def test_the_worst_photon_is_named_by_its_id():
    positions = photons().positions.copy()
    positions[[3, 42], 2] = (0.1, 0.5)
    findings = list(photon_findings(replace(photons(), positions=positions), photons(), PhotonLimits()))
    assert len(findings) == 1 and "photon 294," in findings[0].message and findings[0].value == pytest.approx(0.5)


def test_one_photon_in_fifty_lost_is_found_by_ids_and_flux():
    kept = np.arange(SIDE * SIDE) % 50 != 0
    assert kinds(photons().rows(kept)) == {"photon ids", "total flux"}


def test_dimmer_photons_are_found():
    assert kinds(replace(photons(), flux=0.98 * photons().flux)) == {"flux", "total flux"}


def test_another_receiver_is_found_by_its_path_not_its_number():
    other = replace(photons(), receivers=np.ones(SIDE * SIDE, np.int32))
    assert kinds(other) == {"receiver"}
    assert kinds(replace(other, receiver_paths=("/Wall", "/Floor"))) == set()


def test_ids_that_repeat_and_values_that_are_no_number_fail():
    ids = photons().ids.copy()
    ids[1] = ids[0]
    assert "repeated ids" in kinds(replace(photons(), ids=ids))
    flux = photons().flux.copy()
    flux[5, 1] = np.nan
    findings = list(photon_findings(replace(photons(), flux=flux), photons(), PhotonLimits()))
    assert [finding.kind for finding in findings] == ["not finite"] and "photon 35" in findings[0].message


def test_no_photons_on_both_sides_are_the_same():
    none = photons().rows(np.zeros(0, int))
    assert kinds(none, none) == set()
    assert "photon ids" in kinds(none)


def test_layers_are_found_beside_the_frames_and_compared_frame_by_frame(tmp_path):
    stage = write_stage(tmp_path / "s.usda")
    for place, settings in (("a", {}), ("b", {}), ("c", {"exposure": 0.25, "smoothing": 2.0})):
        tpdwarp.write_photons(stage, tmp_path / place / "s.debug.usdc", **{"photons": 64, "frames": "1:2", **settings})
    same = check(tmp_path / "a", tmp_path / "b")
    assert [(frame.name, frame.status) for frame in same.frames] == [("photons 1", "same"), ("photons 2", "same")]
    changed = check(tmp_path / "c", tmp_path / "a")
    # A flat pane bends no light that falls on it squarely: only what the layer says of itself differs.
    assert [frame.name for frame in changed.failed] == ["photons s.debug.usdc"]
    messages = " ".join(finding.message for finding in changed.failed[0].findings)
    assert "setting smoothing is 2" in messages and "tpdwarp:shutterExposure is 0.25" in messages
    (tmp_path / "c" / "s.debug.usdc").write_bytes(b"broken")
    broken = check(tmp_path / "c", tmp_path / "a")
    assert [frame.findings[0].kind for frame in broken.frames] == ["unreadable"]
    direct = check(tmp_path / "a" / "s.debug.usdc", tmp_path / "b" / "s.debug.usdc")
    assert direct.ok and len(direct.frames) == 2


def test_a_layer_that_only_the_baseline_has_is_missing(tmp_path):
    stage = write_stage(tmp_path / "s.usda")
    frames, baseline = write_sequence(tmp_path / "a", 1), write_sequence(tmp_path / "b", 1)
    tpdwarp.write_photons(stage, baseline / "s.debug.usdc", photons=64, frames="1")
    result = check(frames, baseline)
    assert [(frame.name, frame.findings[0].kind) for frame in result.failed] == [
        ("photons s.debug.usdc", "missing frame")
    ]
    assert check(baseline, frames).failed[0].findings[0].kind == "extra frame"


@pytest.fixture(scope="module")
def layers(tmp_path_factory):
    """A stage's debug layer, of two frames."""
    folder = tmp_path_factory.mktemp("layers")
    stage = write_stage(folder / "s.usda", frames=2)
    tpdwarp.write_photons(stage, folder / "good" / "w.debug.usda", photons=40)
    return folder / "good"


ODD = {
    "a receiver beyond those that are named": ("tpd:receiver", "int[]", lambda count: [7] * count, "tpd:receiver"),
    "words in place of flux": ("tpd:flux", "string[]", lambda count: ["bright"] * count, "tpd:flux"),
    "flux of two channels": ("tpd:flux", "float2[]", lambda count: [Gf.Vec2f(1)] * count, "tpd:flux"),
    "one word in place of bounces": ("tpd:bounces", "string", lambda count: "two", "tpd:bounces"),
    "half of the bounces": ("tpd:bounces", "int[]", lambda count: [1] * (count // 2), "tpd:bounces"),
}


@pytest.mark.parametrize("name", ODD)
def test_one_odd_layer_is_its_own_failure_and_reports_are_written(layers, tmp_path, name):
    primvar, of_type, values, where = ODD[name]
    odd = tmp_path / "a" / "w.debug.usda"
    odd.parent.mkdir()
    layer = Sdf.Layer.CreateNew(str(odd))
    layer.TransferContent(Sdf.Layer.FindOrOpen(str(layers / "w.debug.usda")))
    path = Sdf.Path(f"/TPD/Photons.primvars:{primvar}")
    count = len(layer.QueryTimeSample(Sdf.Path("/TPD/Photons.points"), 1))
    prim = layer.GetPrimAtPath(path.GetPrimPath())
    del prim.properties[path.name]
    Sdf.AttributeSpec(prim, path.name, Sdf.ValueTypeNames.Find(of_type)).default = values(count)
    layer.Save()
    outputs = {kind: tmp_path / f"r.{kind}" for kind in ("report", "junit", "json")}
    result = check(odd.parent, layers, **outputs)
    assert {finding.kind for frame in result.failed for finding in frame.failures} == {"unreadable"}
    assert all(where in str(frame.failures[0]) for frame in result.failed) and len(result.failed) == 2
    assert all(path.stat().st_size for path in outputs.values())
    assert main(["check", str(odd.parent), str(layers)]) == 1


def test_what_nobody_thought_of_in_a_layer_is_that_frames_failure(layers, monkeypatch):
    def broken(*arguments):
        raise IndexError("out of range")

    monkeypatch.setattr("tpdwarp.checks.photons.photon_findings", broken)
    result = check(layers, layers)
    assert {frame.failures[0].kind for frame in result.frames} == {"not compared"} and len(result.frames) == 2
