"""What files declare is read from their tables alone, and refused in one line where it is too much."""

import os
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pxr import Sdf, Usd, UsdGeom, Vt

from tpdwarp.errors import InputError
from tpdwarp.settings import Settings
from tpdwarp.usd.read.composed_prims import composed_prims
from tpdwarp.usd.read.crate_sizes import CrateTables
from tpdwarp.usd.read.layer_limits import MOST_DEPTH, checked_layers
from tpdwarp.usd.read.stage import StageScene
from usd_scenes.hostile.gigantic import many_faces, nested_instancers, nested_prims, nested_references


def tables(path):
    return CrateTables(path.read_bytes())


def test_arrays_are_found_with_their_sizes_whatever_their_type_and_time(tmp_path):
    path = tmp_path / "a.usdc"
    stage = Usd.Stage.CreateNew(str(path))
    mesh = UsdGeom.Mesh.Define(stage, "/M")
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(70_001, 3, np.int32)))
    for time, count in ((1, 40), (2, 123_457)):
        mesh.CreatePointsAttr().Set(Vt.Vec3fArray.FromNumpy(np.random.default_rng(time).random((count, 3), "f4")), time)
    mesh.GetPrim().CreateAttribute("d", Sdf.ValueTypeNames.Matrix4dArray).Set(Vt.Matrix4dArray(77))
    stage.Save()
    found = set(tables(path).arrays())
    assert {(70_001, 4 * 70_001, True), (77, 128 * 77, False)} <= found
    assert {(40, 12 * 40, False), (123_457, 12 * 123_457, False)} <= found


@settings(deadline=None, max_examples=30)
@given(st.lists(st.lists(st.sampled_from("abc"), min_size=1, max_size=12), min_size=1, max_size=40))
def test_depth_is_that_of_the_deepest_prim(tmp_path_factory, paths):
    path = tmp_path_factory.mktemp("depth") / "a.usdc"
    layer = Sdf.Layer.CreateNew(str(path))
    for names in paths:
        Sdf.CreatePrimInLayer(layer, "/" + "/".join(names))
    layer.Save()
    assert tables(path).depth(0) == max(map(len, paths))


def test_tables_of_damaged_layers_are_no_reason_to_crash(tmp_path):
    path = tmp_path / "a.usdc"
    many_faces(path, 5000)
    whole = path.read_bytes()
    draw = np.random.default_rng(3)
    for _ in range(300):
        data = bytearray(whole[: draw.integers(16, len(whole) + 1)])
        for place in draw.integers(8, len(data), 4):
            data[place] = draw.integers(256)
        path.write_bytes(data)
        try:
            checked_layers(str(path), 1e9)
        except InputError as error:
            assert str(path) in str(error)


@pytest.mark.parametrize("count", [2, 2**62])
def test_compressed_tables_may_not_grow_beyond_what_they_are_for(tmp_path, count):
    path = tmp_path / "a.usdc"
    many_faces(path, 10)
    data = bytearray(path.read_bytes())
    # Fewer fields than there are, and more than any file holds.
    struct.pack_into("<Q", data, CrateTables(bytes(data))._sections[b"FIELDS"], count)
    path.write_bytes(data)
    checked_layers(str(path), 1e9)


def test_an_array_is_refused_by_its_declared_size(tmp_path):
    path = many_faces(tmp_path / "a.usdc", 3_000_000)
    with pytest.raises(InputError, match=r"a\.usdc: declares an array of 3000000 values.*max_memory"):
        StageScene.open(path, Settings(), max_memory=1e9)
    root = tmp_path / "root.usda"
    root.write_text("#usda 1.0\n(\n    subLayers = [@./a.usdc@]\n)\n")
    with pytest.raises(InputError, match=r"a\.usdc: declares"):
        StageScene.open(root, Settings(), max_memory=1e9)
    assert checked_layers(str(path), 2e9)


@pytest.mark.parametrize("name", ["a.usda", "a.usdc"])
def test_prims_nested_deeper_than_usd_bears_are_refused(tmp_path, name):
    depth = 100_000 if name == "a.usda" else 3000
    path = nested_prims(tmp_path / name, depth)
    with pytest.raises(InputError, match=f"nests prims {depth} deep"):
        StageScene.open(path, Settings())
    assert checked_layers(str(nested_prims(tmp_path / f"b{path.suffix}", MOST_DEPTH // 2)), 1e9)


def test_pipes_are_refused_wherever_they_are_named(tmp_path):
    pipe = tmp_path / "pipe.usda"
    os.mkfifo(pipe)
    with pytest.raises(InputError, match="is no ordinary file"):
        StageScene.open(pipe, Settings())
    for arc in ("subLayers = [@./pipe.usda@]", None):
        root = tmp_path / "root.usda"
        body = f"(\n    {arc}\n)\n" if arc else '\ndef "A" (\n    references = @./pipe.usda@</B>\n)\n{\n}\n'
        root.write_text(f"#usda 1.0\n{body}")
        with pytest.raises(InputError, match=r"pipe\.usda: is no ordinary file, and .*root\.usda names it"):
            StageScene.open(root, Settings())


def test_instances_are_counted_before_they_are_visited(tmp_path):
    path = nested_references(tmp_path / "a.usda", 10, 10, instanceable=True)
    with pytest.raises(InputError, match=r"instances stand for 3\.\d+e\+10 prims"):
        StageScene.open(path, Settings())
    scene = StageScene.open(nested_references(tmp_path / "b.usda", 2, 3, instanceable=True), Settings())
    assert sum(entry["instances"] for entry in scene.describe()["meshes"]) == 9


def test_references_are_counted_before_they_are_composed(tmp_path):
    path = nested_references(tmp_path / "a.usda", 10, 10, instanceable=False)
    with pytest.raises(InputError, match=r"stand for \d\.\d+e\+10 prims"):
        StageScene.open(path, Settings())
    path = nested_references(tmp_path / "b.usda", 2, 3, instanceable=False)
    # World of three of three with a mesh each, and the library itself, whose P0 and P1 are composed too.
    stage = Usd.Stage.Open(str(path))
    assert composed_prims(checked_layers(str(path), 1e9)) == sum(1 for _ in stage.TraverseAll())
    assert sum(entry["instances"] for entry in StageScene.open(path, Settings()).describe()["meshes"]) == 9


def test_references_in_a_circle_are_counted_to_an_end(tmp_path):
    path = tmp_path / "a.usda"
    path.write_text('#usda 1.0\ndef "A" (\n    references = </B>\n)\n{\n}\ndef "B" (\n    references = </A>\n)\n{\n}\n')
    assert composed_prims(checked_layers(str(path), 1e9)) < 10


def test_nested_instancers_are_counted_before_they_are_visited(tmp_path):
    scene = StageScene.open(nested_instancers(tmp_path / "a.usda", 9, 10), Settings())
    with pytest.raises(InputError, match=r"/I0: places 1e\+09 meshes"):
        scene.frames()
    scene = StageScene.open(nested_instancers(tmp_path / "b.usda", 2, 3), Settings())
    # The inner instancer and the drop stand on the stage as well.
    assert sum(entry["instances"] for entry in scene.describe()["meshes"]) == 9 + 3 + 1
