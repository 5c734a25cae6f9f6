"""What the writer of debug layers wrote is what the reader gives."""

import numpy as np
import pytest
from pxr import Usd, UsdGeom

import tpdwarp
from tests.small_stage import write_stage
from tpdwarp.errors import InputError
from tpdwarp.usd.read.debug_layer import DebugLayerReader


@pytest.fixture(scope="module")
def traced(tmp_path_factory):
    folder = tmp_path_factory.mktemp("layers")
    stage = write_stage(folder / "s.usda")
    tpdwarp.write_photons(stage, folder / "s.debug.usdc", photons=64, frames="1:2")
    return stage, folder / "s.debug.usdc"


def test_photons_come_back_as_traced_to_single_precision(traced):
    stage, layer = traced
    reader = DebugLayerReader(layer)
    assert reader.frames == (1.0, 2.0) and reader.up_axis_and_unit == ("Z", 1.0)
    record, expected = reader.at(2), tpdwarp.trace_photons(stage, 2, photons=64)
    np.testing.assert_array_equal(record.ids, expected.ids)
    np.testing.assert_array_equal(record.bounces, expected.bounces)
    for name in ("positions", "dxdu", "dxdv", "dxdt", "flux", "emission"):
        written = np.asarray(getattr(expected, name), np.float32).astype(np.float64)
        np.testing.assert_array_equal(getattr(record, name), written, err_msg=name)
    paths = [[photons.receiver_paths[index] for index in photons.receivers] for photons in (record, expected)]
    assert paths[0] == paths[1]
    assert np.allclose(np.abs(np.einsum("ni,ni->n", record.normals, expected.normals)), 1, atol=1e-5)


def test_a_column_of_another_length_is_refused_by_name(traced, tmp_path):
    stage = Usd.Stage.Open(str(traced[1]))
    UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/TPD/Photons")).GetPrimvar("tpd:DtX").Set([(0, 0, 0)], 1)
    stage.GetRootLayer().Export(str(tmp_path / "short.usdc"))
    with pytest.raises(InputError, match=r"short\.usdc: /TPD/Photons\.tpd:DtX: .*1 values for"):
        DebugLayerReader(tmp_path / "short.usdc").at(1)


def test_what_is_no_debug_layer_is_refused(traced, tmp_path):
    with pytest.raises(InputError, match="/TPD/Photons: holds no photons"):
        DebugLayerReader(traced[0])
    (tmp_path / "x.usdc").write_bytes(b"PXR")
    with pytest.raises(InputError, match=r"x\.usdc: cannot be read"):
        DebugLayerReader(tmp_path / "x.usdc")
