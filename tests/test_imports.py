"""Imports flow one way, from the ground floor up; torch and jax are for their bridges alone."""

import ast
import importlib
import re
import subprocess
import sys
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import casadi_contact

PACKAGE = Path(__file__).parents[1] / "casadi_contact"
PROBLEMS = PACKAGE.parent / "problems"
ROOMS = [
    *("core", "geometry", "networks", "scenes", "contact", "samples", "surrogate", "optimisation"),
    *("export", "pictures", "workflow", "cli", "__main__"),
]


@cache
def running_nodes(path: Path) -> list[ast.AST]:
    """Everything in a file but what is there for type checking alone."""
    tree = ast.parse(path.read_text("utf-8"))
    only_types = {
        id(child)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)
        for child in ast.walk(node)
    }
    return [node for node in ast.walk(tree) if id(node) not in only_types]


def module_imports(folder: Path) -> dict[str, set[str]]:
    """Modules of a package, each with those of it that it imports, type checking and the package's `__init__` aside."""
    paths = {".".join(p.relative_to(folder.parent).with_suffix("").parts): p for p in folder.rglob("*.py")}
    names = {name.removesuffix(".__init__") for name in paths}
    found: dict[str, set[str]] = {}
    for name, path in paths.items():
        module = name.removesuffix(".__init__")
        used = set()
        for node in running_nodes(path):
            if isinstance(node, ast.Import):
                used |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                full = [f"{node.module}.{alias.name}" for alias in node.names]
                used |= {name if name in names else node.module for name in full}
        found[module] = (used & names) - {module}
    return found


def room_of(module: str) -> str:
    return module.split(".")[1]


def test_every_file_belongs_to_a_room_and_imports_only_rooms_below_it():
    for module, used in module_imports(PACKAGE).items():
        if module != "casadi_contact":
            own = ROOMS.index(room_of(module))
            later = {other for other in used - {"casadi_contact"} if ROOMS.index(room_of(other)) > own}
            assert not later, f"{module} imports {later}, which come after it"


def test_the_table_of_rooms_in_the_docs_is_in_the_order_of_imports():
    page = (PACKAGE.parent / "docs/architecture.md").read_text("utf-8")
    first_cells = (line.split("|")[1] for line in page.splitlines() if line.startswith("| `"))
    told = [name.strip(" `") for cell in first_cells for name in cell.split(",")]
    assert told == [name for name in ROOMS if name != "__main__"]


@pytest.mark.parametrize("folder", [PACKAGE, PROBLEMS], ids=["library", "problems"])
def test_no_module_imports_itself_through_others(folder):
    try:
        TopologicalSorter(module_imports(folder)).prepare()
    except CycleError as error:
        pytest.fail(f"import circle: {' -> '.join(error.args[1])}")


def test_no_file_imports_a_test():
    """What several tests need lies apart from them: reading one file must not prepare another one's models."""
    for path in Path(__file__).parent.rglob("*.py"):
        imported = re.findall(r"^ *from (tests\S*) import", path.read_text("utf-8"), re.M)
        assert not any(".test_" in module for module in imported), f"{path} imports {imported}"


def test_only_a_problem_s_command_imports_its_report():
    for module, used in module_imports(PROBLEMS).items():
        reports = {name for name in used if name.endswith(".report")}
        assert not reports or module.endswith("__main__"), f"{module} imports {reports}"


def test_only_their_bridges_import_torch_and_jax_and_none_the_problems():
    for path in PACKAGE.rglob("*.py"):
        text = path.read_text("utf-8")
        assert path.is_relative_to(PACKAGE / "export") or not re.search(r"import (torch|jax)", text), path
        assert not re.search(r"^ *(from|import) problems", text, re.M), path


def test_importing_the_package_imports_nothing_but_itself_and_reading_a_scene_neither_numba_nor_a_solver():
    code = """import sys, casadi_contact; print([m for m in sys.modules if m.startswith(('casadi', 'num'))])
casadi_contact.load_scene('knee'); print({'numba', 'scipy', 'casadi'} & {*sys.modules})"""
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=PACKAGE.parent)
    imported, reading = out.stdout.splitlines()
    assert set(ast.literal_eval(imported)) <= {"casadi_contact", "numbers"}
    assert reading == "set()"


def test_every_public_name_comes_from_its_module_and_type_checkers_see_it():
    tree = ast.parse((PACKAGE / "__init__.py").read_text("utf-8"))
    (checked,) = (node for node in tree.body if isinstance(node, ast.If))
    seen = {a.name: n.module for n in checked.body if isinstance(n, ast.ImportFrom) for a in n.names}
    assert sorted(seen) == sorted(casadi_contact.__all__)
    for name, module in seen.items():
        assert getattr(casadi_contact, name) is getattr(importlib.import_module(module), name)
        assert name in dir(casadi_contact)
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        casadi_contact.nothing  # noqa: B018


def test_using_the_library_does_not_load_torch_matplotlib_or_sklearn():
    code = (
        "import sys, casadi_contact, problems.studies.peers, problems.pose_estimation\n"
        "print([m for m in ('torch', 'jax', 'matplotlib', 'sklearn') if m in sys.modules])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=PACKAGE.parent)
    assert out.stdout.strip() == "[]"
