"""Renders as scripts start them: from several threads, and from processes that were forked after a render."""

import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

import tpdwarp
from tests.small_stage import write_stage
from tpdwarp.io.images import read_image

SMALL = {"frames": 1, "image_width": 24, "photons": 512, "samples": 1}
FORKING = """
import multiprocessing, sys
import tpdwarp

def render(stage, image):
    assert tpdwarp.render(stage, image, frames=1, image_width=24, photons=512, samples=1).ok

if __name__ == "__main__":
    stage, first, second = sys.argv[1:]
    render(stage, first)
    child = multiprocessing.get_context("fork").Process(target=render, args=(stage, second))
    child.start()
    child.join(120)
    child.kill()
    sys.exit(child.exitcode)
"""


@pytest.mark.parametrize("extension", ["exr", "png"])
def test_a_process_that_was_forked_after_a_render_renders_too(tmp_path, extension):
    script, images = tmp_path / "script.py", [tmp_path / f"{name}.{extension}" for name in ("first", "second")]
    script.write_text(FORKING)
    command = [sys.executable, str(script), write_stage(tmp_path / "stage.usda"), *map(str, images)]
    root = Path(tpdwarp.__file__).parent.parent
    environment = {**os.environ, "PYTHONPATH": str(root)}
    ended = subprocess.run(command, env=environment, check=False, timeout=300, stderr=subprocess.PIPE, text=True)
    assert ended.returncode == 0, ended.stderr
    first, second = (read_image(image)[0] for image in images)
    assert all(np.array_equal(first[name], second[name], equal_nan=True) for name in first)


def test_threads_render_side_by_side(tmp_path):
    stage, images = write_stage(tmp_path / "stage.usda"), [tmp_path / f"{number}.exr" for number in range(3)]
    found = {}

    def render(image):
        found[image] = tpdwarp.render(stage, str(image), **SMALL).ok

    threads = [threading.Thread(target=render, args=(image,)) for image in images]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(300)
    assert found == dict.fromkeys(images, True)
    first, *others = (read_image(image)[0] for image in images)
    assert all(np.array_equal(first["R"], other["R"]) for other in others)
