"""The kernels that a frame has compiled ahead are those that it launches."""

from pathlib import Path

import pytest

import tpdwarp
from tpdwarp.device import Launcher

SHIPPED = Path(__file__).resolve().parents[2] / "usd_scenes"


@pytest.mark.parametrize(
    ("stage", "options"),
    [
        ("wave.usdc", {}),
        ("wave.usdc", {"aovs": ("motion",), "samples": 1}),
        ("wave.usdc", {"path": "straight"}),
        ("cylinder.usdc", {"samples": 1}),
        ("mirror.usdc", {}),
        ("table.usdc", {"samples": 1}),
    ],
)
def test_no_other_is_compiled_than_the_frame_wants(tmp_path, monkeypatch, stage, options):
    prepared, launched, launch = set(), set(), Launcher.__call__

    def counted(self, kernel, *arguments, **more):
        launched.add(kernel.key + kernel.module.name)
        launch(self, kernel, *arguments, **more)

    monkeypatch.setattr(Launcher, "__call__", counted)
    monkeypatch.setattr(Launcher, "prepare", lambda self, kernel: prepared.add(kernel.key + kernel.module.name))
    given = {"frames": 2, "image_width": 24, "photons": 1024, **options}
    assert tpdwarp.render(str(SHIPPED / stage), str(tmp_path / "frame.exr"), **given).ok
    assert len(prepared) == 2 and prepared <= launched
