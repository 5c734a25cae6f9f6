"""How much memory may be taken."""

import pytest

from tpdwarp.errors import InputError
from tpdwarp.io import images, memory
from tpdwarp.io.images import mean_color, read_image
from tpdwarp.io.memory import machine_memory, memory_allowed
from usd_scenes.hostile.gigantic import many_pixels


def test_three_quarters_of_the_machine_may_be_taken_unless_told_otherwise():
    with open("/proc/meminfo") as file:
        total = int(file.readline().split()[1]) * 1024
    assert 0 < machine_memory() <= total * 1.01
    assert memory_allowed(None) == 0.75 * machine_memory() and memory_allowed(5e9) == 5e9


def test_a_container_has_what_its_limit_says(tmp_path, monkeypatch):
    limits = [tmp_path / "max", tmp_path / "number", tmp_path / "none"]
    limits[0].write_text("max\n")
    limits[1].write_text("123456\n")
    monkeypatch.setattr(memory, "_GROUP_LIMITS", tuple(map(str, limits)))
    assert machine_memory() == 123456


def test_images_are_refused_by_the_size_that_they_declare(tmp_path, monkeypatch):
    path = many_pixels(tmp_path / "a.exr", 4000, 4000)
    assert path.stat().st_size < 1e6
    monkeypatch.setattr(images, "memory_allowed", lambda most: 1e9)
    with pytest.raises(InputError, match=r"declares 4000 × 4000 pixels of 4 channels.* GB of memory"):
        read_image(path)
    assert mean_color(path) is None
    monkeypatch.setattr(images, "memory_allowed", lambda most: 1.1e9)
    assert read_image(path)[0]["R"].shape == (4000, 4000)
