"""What docs/method.md says of the code: its names exist, and the functions of the method cite their equations."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
METHOD = ROOT / "docs" / "method.md"
REFERENCE = re.compile(r"`([\w/]+\.py)(?::([\w.]+))?`")
CITATION = re.compile(r"Eqs?\. \d|Table 1|Fig\. 2|[Bb]eyond the paper|[Dd]eparts from the paper|Igehy")
# Files in which every function computes part of an equation.
EQUATIONS = (
    "photons/differentials.py",
    "photons/beam.py",
    "footprints/bspline.py",
    "footprints/cells.py",
    "footprints/gather.py",
    "footprints/kernels.py",
    "footprints/parabolas.py",
    "footprints/placing.py",
    "footprints/plain_gather.py",
    "footprints/shaping.py",
    "footprints/weights.py",
)


def references() -> list[tuple[str, str]]:
    """Files that the method names, and what it names in them (empty for the file itself)."""
    return sorted(set(REFERENCE.findall(METHOD.read_text(encoding="utf-8"))))


def found(path: str) -> Path | None:
    """The file of that path in the package, or beside it."""
    return next((place for place in (ROOT / "tpdwarp" / path, ROOT / path) if place.is_file()), None)


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def names_in(node: ast.AST) -> dict[str, ast.AST]:
    """What a module or class defines: functions, classes, and assigned or annotated names."""
    names: dict[str, ast.AST] = {}
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef | ast.ClassDef):
            names[child.name] = child
        elif isinstance(child, ast.AnnAssign) and isinstance(child.target, ast.Name):
            names[child.target.id] = child
        elif isinstance(child, ast.Assign):
            names |= {target.id: child for target in child.targets if isinstance(target, ast.Name)}
    return names


def test_the_method_names_functions_at_all():
    assert len([name for _, name in references() if name]) > 100


@pytest.mark.parametrize(("path", "name"), references(), ids=lambda part: part or "file")
def test_what_the_method_names_exists(path, name):
    place = found(path)
    assert place is not None, f"there is no {path}"
    node: ast.AST = tree_of(place)
    for part in filter(None, name.split(".")):
        assert part in names_in(node), f"{path} has no {name}"
        node = names_in(node)[part]


@pytest.mark.parametrize("path", EQUATIONS)
def test_functions_of_the_method_cite_their_equation(path):
    # Those of kernels are decorated; what packs arrays for them on the host computes nothing.
    nodes = tree_of(found(path)).body
    functions = [node for node in nodes if isinstance(node, ast.FunctionDef) and node.decorator_list]
    assert functions
    silent = [node.name for node in functions if not CITATION.search(ast.get_docstring(node) or "")]
    assert silent == []


def test_every_equation_of_the_paper_that_is_cited_is_in_the_method():
    text = METHOD.read_text(encoding="utf-8")
    cited = set()
    for path in (ROOT / "tpdwarp").rglob("*.py"):
        for numbers in re.findall(r"Eqs?\. (\d(?:(?:, | and )\d)*)", path.read_text(encoding="utf-8")):
            cited |= set(re.findall(r"\d", numbers))
    assert cited
    explained = {number for found in re.findall(r"Eqs?\. (\d(?:, \d)*)", text) for number in re.findall(r"\d", found)}
    assert cited <= explained
