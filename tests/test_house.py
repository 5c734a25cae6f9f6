"""The rooms of the house: who may import whom, found by parsing every module's imports.

Imports under ``TYPE_CHECKING`` and within functions count like all others. Only the command line may import within
functions what it could not import above, because ``--help`` is not to wait for it; those imports count for the order
of the rooms all the same.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

# Rooms in the order of the data. A room imports those below it and none above; rooms of one line import none of each
# other.
ORDER = (
    ("errors", "version", "clock", "loading"),
    ("presets", "stopping"),
    ("workers",),
    ("settings", "io"),
    ("compiler_lock",),
    ("compiler_flags",),
    ("kernel_cache",),
    ("device",),
    ("scene",),
    ("photons",),
    # The debug layer stores the photons' records.
    ("trajectories", "usd"),
    ("footprints",),
    ("estimators", "view"),
    ("rendering",),
    ("jobs", "html"),
    ("checks", "studies", "farms"),
    ("cli",),
    # The public face and ``python -m tpdwarp``.
    ("__init__", "__main__"),
)
# What stands against the order, and goes: an entry that is not found any more fails the test too.
ALLOWED: set[tuple[str, str]] = set()


@cache
def modules() -> dict[str, Path]:
    """Files of the package by the names of their modules."""
    return {name_of(path): path for path in sorted((ROOT / "tpdwarp").rglob("*.py"))}


def name_of(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def imported(path: Path) -> list[tuple[str, bool]]:
    """Names of all modules that a file imports, and whether it does so within a function."""

    def visit(node: ast.AST, within: bool) -> Iterator[tuple[str, bool]]:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.Import):
                yield from ((alias.name, within) for alias in child.names)
            elif isinstance(child, ast.ImportFrom):
                yield from ((name, within) for name in names_from(child, path))
            elif isinstance(child, ast.Call) and called(child) in ("import_module", "importorskip", "__import__"):
                yield from ((argument.value, within) for argument in child.args if isinstance(argument, ast.Constant))
            yield from visit(child, within or isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda))

    return list(visit(ast.parse(path.read_text(encoding="utf-8")), False))


def names_from(node: ast.ImportFrom, path: Path) -> list[str]:
    base = node.module or ""
    if node.level:
        package = path.relative_to(ROOT).parent.parts
        base = ".".join([*package[: len(package) - node.level + 1], *([base] if base else [])])
    # ``from package import name`` imports a module where the package has one of that name, and else the package.
    within = ROOT.joinpath(*base.split("."))
    return [
        f"{base}.{alias.name}" if (within / f"{alias.name}.py").exists() or (within / alias.name).is_dir() else base
        for alias in node.names
    ]


def called(node: ast.Call) -> str:
    return getattr(node.func, "attr", getattr(node.func, "id", ""))


def room_of(module: str) -> str:
    return module.split(".")[1] if "." in module else "__init__"


def imports_within() -> Iterator[tuple[str, str, bool]]:
    """Modules of the package that import each other, and whether within a function."""
    for module, path in modules().items():
        for name, within in imported(path):
            if name in modules():
                yield module, name, within


def test_every_room_has_its_place_in_the_order():
    assert {room_of(module) for module in modules()} - {"__init__"} <= {room for line in ORDER for room in line}


def test_rooms_import_in_the_order_of_the_data():
    place = {room: number for number, line in enumerate(ORDER) for room in line}
    against = {
        (module, name)
        for module, name, _ in imports_within()
        if room_of(module) != room_of(name) and place[room_of(name)] >= place[room_of(module)]
    }
    assert against - ALLOWED == set()
    assert ALLOWED - against == set(), "these are in order now: strike them from ALLOWED"


def test_no_modules_import_each_other_in_a_circle():
    edges: dict[str, set[str]] = {}
    for module, name, within in imports_within():
        if (module, name) not in ALLOWED and not (within and room_of(module) == "cli"):
            edges.setdefault(module, set()).add(name)
    try:
        TopologicalSorter(edges).prepare()
    except CycleError as error:
        pytest.fail(f"a circle: {' imports '.join(reversed(error.args[1]))}")


@pytest.mark.parametrize(("library", "home"), [("pxr", "tpdwarp/usd"), ("OpenImageIO", "tpdwarp/io/images.py")])
def test_a_library_is_known_to_one_room_alone(library, home):
    users = {
        path.relative_to(ROOT).as_posix()
        for path in modules().values()
        if any(name.split(".")[0] == library for name, _ in imported(path))
    }
    assert users and all(user == home or user.startswith(f"{home}/") for user in users)


@pytest.mark.parametrize(
    ("house", "others"), [("tests", ("scripts",)), ("scripts", ("tests",)), ("usd_scenes", ("tests", "scripts"))]
)
def test_tests_and_scripts_meet_in_the_scenes_only(house, others):
    # Scripts run with their own folder on the path, so that a file or folder of the other house is a name as well.
    barred = {*others}
    for other in others:
        inside = {path.stem for path in (ROOT / other).rglob("*.py")} | {path.name for path in (ROOT / other).iterdir()}
        barred |= inside - sys.stdlib_module_names - {path.stem for path in (ROOT / house).rglob("*.py")}
    found = {
        (path.relative_to(ROOT).as_posix(), name)
        for path in (ROOT / house).rglob("*.py")
        for name, _ in imported(path)
        if name.split(".")[0] in barred
    }
    assert found == set()


def test_what_only_studies_need_is_imported_where_it_is_used():
    above = {
        (module, name)
        for module, path in modules().items()
        for name, within in imported(path)
        if name.split(".")[0] in ("scipy", "matplotlib") and not within
    }
    assert above == set()
