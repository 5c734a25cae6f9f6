import numpy as np
import pytest

from tests.studies.made import solution
from tpdwarp.errors import InputError
from tpdwarp.studies.store import Store, default_folder


def test_a_solution_comes_back_as_it_was(tmp_path):
    store, kept = Store(tmp_path, "scene"), solution(1.0, 0.2, frames=2)
    path = store.path({"photons": 5})
    store.save(path, kept)
    found = store.load(path)
    np.testing.assert_array_equal(found.caustic, kept.caustic)
    np.testing.assert_array_equal(found.beauty, kept.beauty)
    for name in ("cpu_seconds", "seconds", "landed", "memory"):
        assert getattr(found, name) == getattr(kept, name)


def test_solutions_of_other_scenes_settings_or_programs_have_other_names(tmp_path, monkeypatch):
    paths = {Store(tmp_path, scene).path({"photons": n}) for scene in ("a", "b") for n in (1, 2)}
    monkeypatch.setattr("tpdwarp.studies.store.program_hash", lambda: "another")
    paths |= {Store(tmp_path, "a").path({"photons": 1})}
    assert len(paths) == 5
    assert Store(tmp_path, "a").path({"photons": 1}) in paths


@pytest.mark.parametrize("content", [None, b"", b"not an archive"])
def test_what_is_missing_or_damaged_is_rendered_again(tmp_path, content):
    store = Store(tmp_path, "scene")
    path = store.path({})
    if content is not None:
        path.write_bytes(content)
    assert store.load(path) is None


def test_a_solution_cut_short_is_rendered_again(tmp_path):
    store = Store(tmp_path, "scene")
    path = store.path({})
    store.save(path, solution(1.0, 0.2))
    path.write_bytes(path.read_bytes()[:-200])
    assert store.load(path) is None


def test_whatever_is_damaged_is_rendered_again_with_a_word_or_comes_back_as_it_was(tmp_path, caplog):
    store, kept = Store(tmp_path, "scene"), solution(1.0, 0.2)
    path = store.path({})
    store.save(path, kept)
    whole = path.read_bytes()
    assert store.load(path) is not None and caplog.text == ""
    damaged = 0
    # Every seventh byte meets headers, checksums and data.
    for place in range(0, len(whole), 7):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0xFF]) + whole[place + 1 :])
        caplog.clear()
        found = store.load(path)
        if found is None:
            assert f"{path}: is damaged and made anew" in caplog.text
            damaged += 1
        else:
            # Names and dates of an archive's members may be anything.
            np.testing.assert_array_equal(found.caustic, kept.caustic)
            np.testing.assert_array_equal(found.beauty, kept.beauty)
    assert damaged > 0.5 * len(whole) / 7


def test_a_folder_that_cannot_be_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError):
        Store(tmp_path / "file" / "folder", "scene")


def test_solutions_are_kept_where_the_user_keeps_caches(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert default_folder() == tmp_path / "tpdwarp" / "study"
