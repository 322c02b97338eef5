"""Problems on a disc that is all but full and in a read-only folder: one line each, and no traceback."""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from casadi_contact.scenes.load_cycle import write_cycle
from casadi_contact.scenes.walking import reference_cycle
from tests.support.readable import others_may_read

pytestmark = pytest.mark.skipif(os.name != "posix", reason="limits and rights as POSIX has them")
ROOT = Path(__file__).parents[2]
SOLVED = {  # by name: with options that make them short
    "static_equilibrium": ["--flexions", "15", "--starts", "0"],
    "pose_estimation": [],
}
BEGUN = {**SOLVED, "muscle_contact": [], "studies.stability": []}

RUN = """
import importlib, json, os, resource, sys
import encodings.utf_8_sig, zoneinfo  # imported late by others, where another user may not be able to read them
fault, folder, commands = sys.argv[1], sys.argv[2], json.loads(sys.argv[3])
mains = {name: importlib.import_module(f"problems.{name}.__main__").main for name in commands}
if fault == "full":
    resource.setrlimit(resource.RLIMIT_FSIZE, (900, 900))
elif os.geteuid() == 0:
    os.setuid(65534)
said = {}
for name, options in commands.items():
    sys.argv = [name, *options, "--out", f"{folder}/{name}"]
    try:
        mains[name]()
    except SystemExit as ended:
        said[name] = str(ended.code)
sys.stderr.write(json.dumps(said))
"""


def failing(fault, folder, commands):
    """What each command ended with, and all else that was written to standard error."""
    done = subprocess.run(
        [sys.executable, "-c", RUN, fault, str(folder), json.dumps(commands)],
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
    )
    before, _, said = done.stderr.rpartition("{")
    return json.loads("{" + said), before


def assert_one_line_each(said, before, commands, folder):
    assert set(said) == set(commands)
    for name, text in said.items():
        assert text.startswith(f"{name.rpartition('.')[2]}: cannot write"), text
        assert f"{folder}/{name}" in text
        assert len(text.splitlines()) == 1
    assert "Traceback" not in before


def test_a_full_disc_is_one_line(tmp_path):
    said, before = failing("full", tmp_path, SOLVED)
    assert_one_line_each(said, before, SOLVED, tmp_path)
    assert not [path for path in tmp_path.rglob(".*") if path.is_file()], "what is half written is removed"


def test_a_read_only_folder_is_one_line_before_any_work():
    if os.geteuid() == 0 and not others_may_read(Path(__file__)):
        pytest.skip("only root can read this checkout, and root may write in a read-only folder")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_cycle(reference_cycle(), folder / "cycle.csv")
        folder.chmod(0o555)
        begun = {**BEGUN, "implant": ["knee", f"{folder}/cycle.csv"]}
        said, before = failing("read-only", folder, begun)
        folder.chmod(0o755)
        assert_one_line_each(said, before, begun, folder)
