"""What README and docs show works as shown: Python runs, commands parse, names, links and pictures are there."""

import doctest
import importlib
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.main import get_command

from casadi_contact.cli.main import app
from problems.studies.numbers import BEGIN, END, headline
from problems.studies.pages import pages
from tests.support.shared_data import RESULTS

ROOT = Path(__file__).parents[1]
WRITTEN_WITH_THE_DOCS = "knee.html"  # docs/hooks.py
PAGES = sorted(path.relative_to(ROOT) for path in (*ROOT.glob("[CR]*.md"), *(ROOT / "docs").rglob("*.md")))
NEEDS = {Path("docs/tutorial.md"): ("trimesh", "igl"), Path("docs/how-to/libraries.md"): ("torch", "jax")}
EXAMPLES = [
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for path in sorted((ROOT / "casadi_contact").rglob("*.py"))
    if re.search(r"^ +>>> ", path.read_text("utf-8"), re.M)
]
_BLOCK = re.compile(r"(?P<skip><!-- not run: [^\n]+ -->\n)?```python\n(?P<code>.*?)```", re.S)


def text_of(page):
    return (ROOT / page).read_text("utf-8")


def commands_of(page):
    """Words of each line of sh blocks that calls this project."""
    for block in re.findall(r"```sh\n(.*?)```", text_of(page), re.S):
        for line in block.replace("\\\n", " ").splitlines():
            words = shlex.split(line.rstrip("&"), comments=True)
            for k, word in enumerate(words):
                if word.endswith("casadi-contact") or (word.startswith("problems.") and words[k - 1] == "-m"):
                    yield [word.removeprefix(".venv/bin/"), *words[k + 1 :]]


def command_of(program):
    """The click command behind ``casadi-contact`` or ``python -m problems.NAME``."""
    if program == "casadi-contact":
        return get_command(app)
    is_folder = importlib.util.find_spec(program).submodule_search_locations
    loaded, program_app = importlib.import_module(f"{program}.__main__" if is_folder else program), typer.Typer()
    program_app.command()(getattr(loaded, "run", None) or loaded.main)
    return get_command(program_app)


@pytest.mark.parametrize("page", [page for page in PAGES if _BLOCK.search(text_of(page))], ids=str)
def test_python_blocks_of_a_page_run_one_after_the_other(page, tmp_path, monkeypatch):
    for package in NEEDS.get(page, ()):
        pytest.importorskip(package)
    monkeypatch.chdir(tmp_path)
    names = {"__name__": "example"}
    for block in _BLOCK.finditer(text_of(page)):
        before = text_of(page)[: block.start("code")].count("\n")  # so that an error names its line of the page
        code = compile("\n" * before + block["code"], f"{page}", "exec")
        if not block["skip"]:
            exec(code, names)
    if page == Path("README.md"):  # its example carries the loads that it asks for
        np.testing.assert_allclose(np.ravel(names["f"](names["poses"][0])), names["loads"][0], rtol=1e-9, atol=1e-6)
        np.testing.assert_allclose(names["model"](names["poses"])[0, :2], [-600.0, -400.0], atol=1e-3)
        np.testing.assert_allclose(names["elements"](names["settled"])[0, :2], [-600.0, -400.0], atol=1e-6)


@pytest.mark.parametrize("module", EXAMPLES)
def test_examples_in_docstrings_give_what_they_show(module):
    tried = doctest.testmod(importlib.import_module(module))
    assert tried.attempted
    assert not tried.failed


@pytest.mark.parametrize("page", [page for page in PAGES if any(commands_of(page))], ids=str)
def test_every_command_of_a_page_has_the_arguments_and_options_it_shows(page):
    for program, *arguments in commands_of(page):
        command = command_of(program)
        if hasattr(command, "commands"):
            command, arguments = command.commands[arguments[0]], arguments[1:]
        if "--help" not in arguments:
            command.make_context(program, arguments)  # raises for what it does not know


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_what_a_page_names_is_there(page):
    text = text_of(page)
    for target in re.findall(r"\]\(([^)#]+)", text):
        assert "://" in target or target == WRITTEN_WITH_THE_DOCS or (ROOT / page.parent / target).is_file(), target
    for name in re.findall(r"`casadi-contact ([a-z]+)", text):
        assert name in get_command(app).commands
    for program in re.findall(r"`python -m (problems\.[a-z][a-z_.]*)", text):
        assert command_of(program)
    if page != Path("CHANGELOG.md"):  # which names what is gone
        for name in re.findall(r"\b((?:cc|casadi_contact)(?:\.[A-Za-z_]\w*)+)", text):
            assert found(name), f"{page}: {name}"


def found(name):
    """The object of a dotted name, cc being casadi_contact."""
    at = importlib.import_module("casadi_contact")
    for part in name.split(".")[1:]:
        if not hasattr(at, part):
            importlib.import_module(f"{at.__name__}.{part}")
        at = getattr(at, part)
    return at


def test_pages_of_results_are_what_the_command_writes_from_the_stored_files():
    written = pages(RESULTS)
    stored = {path.name: path.read_text("utf-8") for path in (ROOT / "docs" / "results").glob("*.md")}
    assert stored == written, "run python -m problems.studies.pages"


def test_the_readme_is_short_sets_up_the_main_job_and_the_tests_and_has_the_stored_headline_numbers():
    text = text_of("README.md")
    assert len(text.encode()) <= 8_000
    assert text.partition(BEGIN)[2].partition(END)[0].strip() == headline(RESULTS)
    blocks = re.findall(r"```sh\n(.*?)```", text, re.S)
    for block, ends in zip(blocks, ("-m problems.pose_estimation", "-m pytest -n 2"), strict=False):
        assert block.startswith("python3 -m venv .venv\n")
        assert block.splitlines()[-1].endswith(ends)
