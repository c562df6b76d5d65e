"""Data goes one way, so imports do too: a module imports its own package and the rows above it."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import vlafuzz

# From the inside out. Modules of one row do not import each other.
ROWS = (
    "__init__",
    "errors",
    "common",  # text, files, reading, statistics: nothing of what vlafuzz is about
    "model",  # scene, outcome, conditions, evidence, genes, space
    "search policies",  # strategies, which see numbers only; policies, which see observations only
    "worlds",  # the protocol, and what simulators of all worlds share
    "worlds.manipulation",
    "worlds.tabletop worlds.libero",  # found by the folders' names: no other room needs to know them
    "worlds.tabletop_mujoco",  # the tabletop's scenes, in another simulator
    "store rollouts",
    "failures",
    "campaign report",
    "doctor exports lab stored",
    "api cli",
    "__main__",
)
WORLDS = ("worlds.manipulation", "worlds.tabletop", "worlds.tabletop_mujoco", "worlds.libero")
ROW_OF = {name: number for number, row in enumerate(ROWS) for name in row.split()}
ROOT = Path(vlafuzz.__file__).parent
LOADED = re.compile(r"vlafuzz(\.\w+)+(:\w+)?")  # a string that import_module may get
FILES = sorted(path for path in ROOT.rglob("*.py") if "_shipped" not in path.parts)


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def room(module: str) -> str:
    """The room of a module, by its name without the package's: a folder, and below worlds a world."""
    first, _, rest = module.partition(".")
    inner = f"{first}.{rest.partition('.')[0]}"
    return inner if inner in WORLDS else first


def top(path: Path) -> str:
    return room(".".join(path.relative_to(ROOT).with_suffix("").parts))


def module(path: Path) -> str:
    parts = ("vlafuzz", *path.relative_to(ROOT).with_suffix("").parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module(path): path for path in FILES}


def modules_of(node: ast.AST) -> list[str]:
    """What an import names: our modules, or what anything else is taken from; a relative one begins with a dot."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        source = "." * node.level + (node.module or "")
        return [name for alias in node.names if (name := f"{source}.{alias.name}") in MODULES] or [source]
    return []


def imported(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and room of every import from vlafuzz, those for type checking and in strings included."""
    for node in ast.walk(tree):
        loaded = isinstance(node, ast.Constant) and isinstance(node.value, str) and LOADED.fullmatch(node.value)
        for name in [node.value] if loaded else modules_of(node):
            first, _, rest = name.partition(".")
            if first == "":
                yield node.lineno, "."
            elif first == "vlafuzz":
                yield node.lineno, room(rest.partition(":")[0]) if rest else "__init__"


def complaints(importer: str, tree: ast.AST) -> list[str]:
    if importer not in ROW_OF:
        return [f"{importer!r} has no row: give it one in ROWS"]
    found = []
    for line, name in imported(tree):
        if name not in ROW_OF:
            found.append(f"line {line}: {name!r} has no row (a relative import, or a module missing in ROWS)")
        elif (importer, name) == ("__init__", "api"):
            continue  # the package's front door, which opens when it is first used
        elif name != importer and ROW_OF[name] >= ROW_OF[importer]:
            found.append(f"line {line}: {importer!r} (row {ROW_OF[importer]}) imports {name!r} (row {ROW_OF[name]})")
    return found


def test_every_module_imports_only_its_own_package_and_rows_above():
    assert {path: found for path in FILES if (found := complaints(top(path), tree_of(path)))} == {}


NAMED = re.compile("tabletop|libero|robosuite|mujoco|mani_?skill|sapien", re.IGNORECASE)  # worlds, and their simulators


def named(source: str) -> list[tuple[int, str]]:
    """Every place where a source names a world of ours or a simulator: imports, strings, comments, whatever it is."""
    lines = enumerate(source.splitlines(), start=1)
    return [(line, name) for line, text in lines for name in NAMED.findall(text)]


def test_nothing_outside_worlds_names_a_world_or_a_simulator():
    others = [path for path in FILES if path.relative_to(ROOT).parts[0] != "worlds"]
    assert {path: found for path in others if (found := named(path.read_text(encoding="utf-8")))} == {}
    shared = [path for path in FILES if path.parent == ROOT / "worlds"]
    assert [path for path in shared if {name for _, name in imported(tree_of(path))} & set(WORLDS)] == []


@pytest.mark.parametrize(
    "source",
    ["from vlafuzz.worlds.tabletop import lint", "import_module(f'{here}.libero.world')", "# where SAPIEN is slow"],
)
def test_a_world_that_is_named_is_noticed(source: str):
    assert len(named(source)) == 1


@pytest.mark.parametrize(
    "source",
    [
        "import vlafuzz.cli",
        "from vlafuzz import campaign",
        "from vlafuzz.worlds.evaluator import Evaluator",
        "from . import base",
        "from vlafuzz.unheard_of import thing",
        "if TYPE_CHECKING:\n    from vlafuzz.rollouts import Executor",
    ],
)
def test_an_import_outwards_is_noticed(source: str):
    assert len(complaints("search", ast.parse(source))) == 1


def test_a_new_package_needs_a_row():
    assert complaints("unheard_of", ast.parse("")) == ["'unheard_of' has no row: give it one in ROWS"]


def test_no_modules_import_each_other_in_a_circle():
    """Those for type checking and inside functions included."""
    graph = {
        name: {other for node in ast.walk(tree_of(path)) for other in modules_of(node)} & MODULES.keys() - {name}
        for name, path in MODULES.items()
    }
    TopologicalSorter(graph).prepare()  # raises CycleError
