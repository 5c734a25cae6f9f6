"""A stage that is written over while frames are rendered of it is noticed."""

import os
import shutil
from pathlib import Path

import pytest
from pxr import Sdf

from tests.small_stage import write_stage
from tpdwarp.errors import FrameError
from tpdwarp.jobs.stage_files import StageFiles
from tpdwarp.settings import Settings
from tpdwarp.usd.read.stage import StageScene


@pytest.fixture
def text(tmp_path):
    return Path(write_stage(tmp_path / "stage.usda"))


@pytest.fixture
def crate(text, tmp_path):
    path = tmp_path / "stage.usdc"
    Sdf.Layer.FindOrOpen(str(text)).Export(str(path))
    return path


def files_of(path):
    source = StageScene.open(path, Settings())
    return source, StageFiles(source)


def written_over(path, change):
    data = bytearray(path.read_bytes())
    with open(path, "r+b") as file:
        if change == "truncated":
            file.truncate(len(data) // 2)
        else:
            file.seek(len(data) // 2)
            file.write(bytes([data[len(data) // 2] ^ 1]))


@pytest.mark.parametrize("change", ["truncated", "same size"])
def test_a_crate_written_over_in_place_fails_what_was_made_meanwhile(crate, change):
    source, files = files_of(crate)
    files.check()
    written_over(crate, change)
    for _ in range(2):
        with pytest.raises(FrameError, match=r"stage\.usdc: was written over"):
            files.check()
    # However reading it fails: the line says why.
    with pytest.raises(FrameError, match="was written over"), files.unchanged():
        raise RuntimeError("Failed reading 8 bytes at offset 12 " * 99)
    del source


@pytest.mark.parametrize("kind", ["text", "crate"])
def test_a_file_that_is_replaced_is_warned_about_once_and_goes_on(text, crate, kind, tmp_path, caplog):
    path = {"text": text, "crate": crate}[kind]
    _, files = files_of(path)
    other = tmp_path / "other"
    other.write_bytes(path.read_bytes() + b"\n")
    os.replace(other, path)
    for _ in range(3):
        files.check()
    assert [record.getMessage() for record in caplog.records] == [
        f"{path}: has changed since it was opened; frames go on showing what it held then"
    ]


def test_the_same_content_written_again_is_no_change(crate, tmp_path, caplog):
    _, files = files_of(crate)
    shutil.copy(crate, tmp_path / "copy")
    os.utime(crate, ns=(1, 1))
    files.check()
    os.replace(tmp_path / "copy", crate)
    files.check()
    assert not caplog.records


def test_a_texture_written_over_fails_what_was_made_meanwhile(text, tmp_path):
    (tmp_path / "a.png").write_text("one")
    text.write_text(text.read_text() + 'def Shader "T"\n{\n    asset inputs:file = @./a.png@\n}\n')
    _, files = files_of(text)
    (tmp_path / "a.png").write_text("two")
    with pytest.raises(FrameError, match=r"a\.png: was written over"):
        files.check()
