"""What README and docs show works as shown: Python runs, commands parse, links and pictures are there."""

import ast
import doctest
import importlib
import re
import shlex
from pathlib import Path

import pytest
import typer
from typer.main import get_command

from casadi_contact.cli.main import app
from problems.studies.pages import BEGIN, END, headline, pages
from tests.support.stored_results import RESULTS

ROOT = Path(__file__).parents[1]
WRITTEN_WITH_THE_DOCS = "knee.html"  # docs/live_page.py
PAGES = sorted(path.relative_to(ROOT) for path in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md")))
NEEDS = {
    Path("docs/how-to/meshes.md"): ("trimesh", "igl"),
    Path("docs/how-to/fmu.md"): ("fmpy",),
    Path("docs/how-to/pytorch-jax.md"): ("torch", "jax"),
}
EXAMPLES = [
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for path in sorted((ROOT / "casadi_contact").rglob("*.py"))
    if re.search(r"^ +>>> ", path.read_text("utf-8"), re.M)
]
_OPTION = re.compile(r"(?<![\w/-])--[a-z][a-z-]*[a-z]")
# of dask, Octave, pip, a linker and compilers
_OTHERS = "--scheduler-file --nworkers --nthreads --mex --no-build-isolation --export --version"
_BLOCK = re.compile(r"(?:<!-- not run: (?P<reason>[^\n]+) -->\n)?```python\n(?P<code>.*?)```", re.S)


def text_of(page):
    return (ROOT / page).read_text("utf-8")


def commands_of(page):
    """Lines of sh blocks that call this project, with continued lines joined."""
    for block in re.findall(r"```sh\n(.*?)```", text_of(page), re.S):
        for line in block.replace("\\\n", " ").splitlines():
            words = shlex.split(line, comments=True)
            for start in ("casadi-contact", "problems."):
                at = next((i for i, word in enumerate(words) if word.startswith(start)), None)
                if at is not None and (start == "casadi-contact" or words[at - 1] == "-m"):
                    yield words[at:]


def command_of(program):
    """The click command behind ``casadi-contact`` or ``python -m problems.NAME``."""
    if program == "casadi-contact":
        return get_command(app)
    found = importlib.util.find_spec(program)
    module = f"{program}.__main__" if found.submodule_search_locations else program
    loaded, program_app = importlib.import_module(module), typer.Typer()
    program_app.command()(getattr(loaded, "run", None) or loaded.main)
    return get_command(program_app)


@pytest.mark.parametrize("page", [page for page in PAGES if _BLOCK.search(text_of(page))], ids=str)
def test_python_blocks_of_a_page_run_one_after_the_other(page, tmp_path, monkeypatch):
    for package in NEEDS.get(page, ()):
        pytest.importorskip(package, reason=f"{page} needs {package}")
    monkeypatch.chdir(tmp_path)
    names = {"__name__": "example"}
    for block in _BLOCK.finditer(text_of(page)):
        before = text_of(page)[: block.start("code")].count("\n")  # so that an error names its line of the page
        code = compile("\n" * before + block["code"], f"{page}", "exec")
        if not block["reason"]:
            exec(code, names)


@pytest.mark.parametrize("module", EXAMPLES)
def test_examples_in_docstrings_give_what_they_show(module):
    tried = doctest.testmod(importlib.import_module(module))
    assert tried.attempted
    assert not tried.failed


def test_few_python_blocks_are_not_run_and_each_says_why():
    reasons = [block["reason"] for page in PAGES for block in _BLOCK.finditer(text_of(page)) if block["reason"]]
    assert len(reasons) <= 2
    assert sum(text_of(page).count("<!-- not run:") for page in PAGES) == len(reasons)


@pytest.mark.parametrize("page", [page for page in PAGES if any(commands_of(page))], ids=str)
def test_every_command_of_a_page_has_the_arguments_and_options_it_shows(page):
    for program, *arguments in commands_of(page):
        command = command_of(program)
        if hasattr(command, "commands") and arguments[:1] != ["--help"]:
            assert arguments[0] in command.commands, f"{page}: {program} {arguments[0]}"
            command, arguments = command.commands[arguments[0]], arguments[1:]
        command.make_context(program, arguments)  # raises for what it does not know


def options_of(command):
    """Options of a command and of all commands below it."""
    own = {option for each in command.params for option in (*each.opts, *each.secondary_opts)} | {"--help"}
    return own.union(*(options_of(each) for each in getattr(command, "commands", {}).values()))


def messages_with_options():
    """Texts of the code that name options: messages, docstrings and help."""
    for path in sorted([*(ROOT / "casadi_contact").rglob("*.py"), *(ROOT / "problems").rglob("*.py")]):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                yield from ((path.relative_to(ROOT), option) for option in _OPTION.findall(node.value))


def test_options_named_in_pages_and_messages_are_those_of_some_command():
    files = [*(ROOT / "problems").glob("[a-z]*.py"), *(ROOT / "problems" / "studies").glob("[a-z]*.py")]
    names = [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in files if path.stem != "opensim_force"]
    programs = ["casadi-contact", *names, "problems.studies.stability"]
    known = set().union(_OTHERS.split(), *(options_of(command_of(program)) for program in programs))
    named = [(page, option) for page in PAGES for option in _OPTION.findall(text_of(page))]
    unknown = {(str(where), option) for where, option in (*named, *messages_with_options()) if option not in known}
    assert unknown == set()
    assert {"--side", "--measured"} <= {option for _, option in named}


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_commands_named_in_the_text_exist(page):
    for name in re.findall(r"`casadi-contact ([a-z]+)", text_of(page)):
        assert name in get_command(app).commands, f"{page}: casadi-contact {name}"
    for program in re.findall(r"`python -m (problems[.a-z_]*)", text_of(page)):
        assert command_of(program)


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_links_and_pictures_of_a_page_are_there(page):
    for target in re.findall(r"\]\(([^)#]+)", text_of(page)):
        if "://" not in target and target != WRITTEN_WITH_THE_DOCS:
            assert (ROOT / page.parent / target).is_file(), f"{page}: {target}"


def test_python_files_that_comments_of_c_name_are_there():
    named = {
        (path.name, name)
        for path in (ROOT / "casadi_contact").rglob("*.h")
        for name in re.findall(r"\b[a-z_]+/[a-z_/]+\.py\b", path.read_text("utf-8"))
    }
    assert named
    assert {(where, name) for where, name in named if not (ROOT / "casadi_contact" / name).is_file()} == set()


def test_pages_of_results_are_what_the_command_writes_from_the_stored_files():
    written = pages(RESULTS)
    stored = {path.name: path.read_text("utf-8") for path in (ROOT / "docs" / "results").glob("*.md")}
    assert set(stored) - {"index.md"} == set(written)
    for name, text in written.items():
        assert stored[name] == text, f"docs/results/{name}: run python -m problems.studies.pages"


def test_the_headline_numbers_of_the_readme_are_those_of_the_stored_files():
    shown = text_of("README.md").partition(BEGIN)[2].partition(END)[0]
    assert shown.strip() == headline(RESULTS)
