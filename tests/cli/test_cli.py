"""The command line: versions, help, mistakes, scenes and surrogates by name or file, and its tables."""

import io
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from rich.console import Console
from typer.main import get_group
from typer.testing import CliRunner

import casadi_contact
import casadi_contact as cc
from casadi_contact.cli.main import EXAMPLES, app
from casadi_contact.core.terminal import new_app, progress_bars, run_app, run_program
from casadi_contact.surrogate import load
from casadi_contact.workflow.project import Project, available_surrogates

ROOT = Path(__file__).parents[2]


def output(*arguments):
    result = CliRunner().invoke(app, arguments, terminal_width=120)
    assert result.exit_code == 0, result.output
    return result.output


def test_the_package_runs_as_a_module_and_says_its_version():
    done = subprocess.run(
        [sys.executable, "-m", "casadi_contact", "--version"], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert done.stdout.strip() == f"casadi_contact {casadi_contact.__version__}" == output("--version").strip()


def test_every_command_shows_examples_that_it_accepts(monkeypatch):
    """Each example is parsed by its command as the shell would hand it over; nothing is run."""
    group = get_group(app)
    assert {line.split()[0] for line in EXAMPLES} == set(group.commands)
    for name, *arguments in map(str.split, EXAMPLES):
        group.commands[name].make_context(name, arguments)
    for name in group.commands:
        assert f"casadi-contact {name}" in " ".join(output(name, "--help").split())


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ("scene none.stl cup.stl", "none.stl"),
        ("scene a.stl b.stl --side up", "--side"),
        ("scene a.stl b.stl --out a.png", "--out"),
        ("scene a.stl b.stl --out $(id).toml", "letter"),
        ("scene a.stl b.stl --out /proc/nowhere/a.toml", "cannot write"),
        ("report knee --out r.pdf", "r.html"),
        ("page knee --out x.txt", "x.html"),
        ("show folder.toml", "is a folder"),
        ("choose knee --force-tol abc", "--force-tol"),
        ("choose knee", "force tolerance"),
        ("show knee --pose a,b", "expected six numbers"),
        ("info none.h5", "none.h5"),
        ("build knee --table none.csv", "none.csv"),
        ("build knee --table none.csv --model foundation", "table"),
        ("sample knee --table none.csv --cycles walk.csv", "cycles"),
        ("build none.toml", "none.toml"),
        ("export hip", "build hip"),
        ("evaluate knee", "samples.h5"),
        ("nothing", "nothing"),
        ("build", "scene"),
        ("build knee --colour", "--colour"),
    ],
)
def test_every_mistake_is_told_without_a_traceback_and_exits_non_zero(arguments, word, tmp_path, monkeypatch, capsys):
    from casadi_contact.cli.main import main

    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder.toml").mkdir()
    monkeypatch.setattr("sys.argv", ["casadi-contact", *arguments.split()])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code not in (0, None)
    message = f"{ended.value.code} {capsys.readouterr().err}"
    assert word.lower() in message.lower()
    assert len(message.strip().splitlines()) == 1


def test_a_mistake_in_the_options_of_a_problem_ends_as_one_of_casadi_contact_does(monkeypatch, capsys):
    from problems import squat

    monkeypatch.setattr("sys.argv", ["squat", "--intervals", "many"])
    with pytest.raises(SystemExit, match="2"):
        run_program(squat.main)
    assert capsys.readouterr().err.startswith("squat: Invalid value for '--intervals'")


@pytest.mark.parametrize("arrives_as", [KeyboardInterrupt, SystemError])
def test_ctrl_c_ends_without_a_traceback_wherever_it_arrives(arrives_as):
    """In a loop that numba compiled it arrives as a SystemError that a KeyboardInterrupt caused."""
    app = new_app(add_completion=False)

    @app.command()
    def work() -> None:
        with progress_bars(Console(file=io.StringIO())):
            try:
                raise KeyboardInterrupt
            except KeyboardInterrupt as interrupt:
                raise arrives_as from interrupt

    with pytest.raises(SystemExit) as ended:
        run_app(app, "work", [])
    assert ended.value.code == 130


def test_a_given_surrogate_stands_for_its_scene_and_for_what_was_trained(tmp_path):
    mine = Path(shutil.copy(Path(load.__file__).parent / "ready" / "knee_two_stage.h5", tmp_path / "my.h5"))
    project = Project.open(mine, "quick", tmp_path / "out")
    assert project.scene.digest == cc.load_scene("knee").digest
    assert list(available_surrogates(project)) == ["two_stage"]
    done = CliRunner().invoke(app, ["export", str(mine), "--out", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    assert list((tmp_path / "out" / "export" / "two_stage").glob("*.c"))
