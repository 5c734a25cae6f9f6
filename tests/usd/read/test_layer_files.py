from tpdwarp.usd.read.layer_files import content_hash


def write(path, text):
    path.write_text(f"#usda 1.0\n{text}\n")
    return str(path)


def test_the_hash_is_that_of_the_content_wherever_it_lies(tmp_path):
    (tmp_path / "there").mkdir()
    here, there = (write(folder / "a.usda", 'def "A" {}') for folder in (tmp_path, tmp_path / "there"))
    assert content_hash(here) == content_hash(there)
    assert content_hash(write(tmp_path / "b.usda", 'def "B" {}')) != content_hash(here)


def test_a_change_in_a_referenced_file_changes_the_hash(tmp_path):
    write(tmp_path / "part.usda", '(defaultPrim = "P")\ndef "P" {}')
    whole = write(tmp_path / "whole.usda", 'def "A" (references = @part.usda@) {}')
    before = content_hash(whole)
    write(tmp_path / "part.usda", '(defaultPrim = "P")\ndef "P" { double x = 1 }')
    # Stages hold on to layers that are open already; nothing here holds one.
    assert content_hash(whole) != before
