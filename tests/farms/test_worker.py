"""What a worker makes of a chunk, without a cluster around it."""

from __future__ import annotations

import json
import os
import time
from dataclasses import replace

import numpy as np
import pytest
from pxr import Gf, Usd, UsdRender

import tpdwarp
from tests.small_stage import write_stage
from tpdwarp.farms import worker
from tpdwarp.farms.order import Order, heard, key_of, name_of
from tpdwarp.io.images import read_image
from tpdwarp.jobs.frame_loop import Persistence
from tpdwarp.jobs.opening import chosen_settings, open_scene
from tpdwarp.jobs.stage_files import StageFiles
from tpdwarp.jobs.statistics import versions

FEW = {"samples": 1, "photons": 256, "threads": 1}
SIZES = {"wide": (8, 4), "square": (4, 4)}


class OneWorker:
    """What Dask gives to a task for its worker."""

    address = "tcp://127.0.0.1:1"

    def __init__(self) -> None:
        self.told: list[tuple[str, dict[str, str]]] = []

    def log_event(self, topic: str, event: dict[str, str]) -> None:
        self.told.append((topic, event))


@pytest.fixture
def here(monkeypatch):
    one = OneWorker()
    monkeypatch.setattr(worker, "get_worker", lambda: one)
    worker._works_for.cache_clear()
    yield one
    worker._works_for.cache_clear()


@pytest.fixture
def orders(tmp_path):
    """Two products of one stage, as a client orders two frames of them."""
    scene = str(write_stage(tmp_path / "stage.usda"))
    stage = Usd.Stage.Open(scene)
    found = UsdRender.Settings.Define(stage, "/Render/Settings")
    stage.SetMetadata("renderSettingsPrimPath", "/Render/Settings")
    for name, size in SIZES.items():
        product = UsdRender.Product.Define(stage, f"/Render/{name}")
        product.CreateResolutionAttr(Gf.Vec2i(*size))
        product.CreateProductNameAttr(f"{name}.exr")
        found.GetProductsRel().AddTarget(product.GetPath())
    stage.GetRootLayer().Save()
    digest = StageFiles(open_scene(scene, chosen_settings(FEW), False)).digest
    return tuple(
        Order(
            scene=scene,
            default_time=False,
            settings=json.dumps(chosen_settings({**FEW, "product": f"/Render/{name}"}).as_dict(), sort_keys=True),
            target=None,
            stage=digest,
            versions=json.dumps(versions(), sort_keys=True),
            out=str(tmp_path / "farm" / f"{name}.##.exr"),
            frames=(1.0, 2.0),
            layer="",
            curves=None,
            skip_existing=False,
            begun=time.time(),
            strict=False,
            persistence=Persistence(),
            max_memory=None,
        )
        for name in SIZES
    )


def test_products_of_a_chunk_share_one_trace_and_are_what_a_render_makes_of_them(here, orders, tmp_path):
    os.mkdir(tmp_path / "farm")
    wide, square = worker.render_chunk(orders, (1.0, 2.0))
    assert [heard(text).status for text in (*wide.outcomes, *square.outcomes)] == ["written"] * 4
    assert ["trace" in heard(text).seconds for text in (*wide.outcomes, *square.outcomes)] == [True] * 2 + [False] * 2
    tpdwarp.render(orders[0].scene, tmp_path / "one" / "<product>.##.exr", frames="1:2", **FEW)
    for path in sorted((tmp_path / "one").glob("*.exr")):
        ours, theirs = read_image(tmp_path / "farm" / path.name)[0], read_image(path)[0]
        assert theirs["R"].any()
        for name in theirs:
            np.testing.assert_array_equal(ours[name], theirs[name], err_msg=f"{path.name} {name}")


def test_each_frame_is_told_with_the_name_of_its_sequence(here, orders, tmp_path):
    os.mkdir(tmp_path / "farm")
    worker.render_chunk(orders, (1.0,))
    frames = [(topic, event) for topic, event in here.told if event["kind"] == "frame"]
    assert {topic for topic, _ in frames} == {name_of(orders)}
    assert [event["sequence"] for _, event in frames] == [order.name for order in orders]
    assert len({name_of(orders), *(name_of([order]) for order in orders)}) == 3
    assert key_of(orders, (1.0, 2.0), 1) == f"tpdwarp-{name_of(orders)}-1:2x2-1"


def test_a_product_that_cannot_be_written_costs_the_others_nothing(here, orders, tmp_path):
    os.mkdir(tmp_path / "farm")
    os.mkdir(tmp_path / "farm" / "wide.01.exr")
    wide, square = worker.render_chunk(orders, (1.0, 2.0))
    assert [heard(text).status for text in wide.outcomes] == ["failed", "written"]
    assert [heard(text).status for text in square.outcomes] == ["written"] * 2
    assert wide.refusal and not square.refusal


def test_another_stage_is_refused(here, orders):
    with pytest.raises(worker.UnfitWorker, match="sees another version"):
        worker.render_chunk((orders[0], replace(orders[1], stage="other")), (1.0,))
