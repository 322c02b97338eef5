"""What README shows works as shown."""

import ast
import re
from pathlib import Path

import numpy as np

README = (Path(__file__).parents[1] / "README.md").read_text("utf-8")


def test_the_python_example_runs_and_its_results_have_the_shapes_it_names(capsys):
    example, *others = re.findall(r"```python\n(.*?)```", README, re.S)
    for other in others:
        ast.parse(other)
    names: dict = {}
    exec(example, names)
    assert names["loads"].shape == (1, 7)
    assert names["jacobian"].shape == (1, 7, 6)
    assert names["report"].converged.all()
    np.testing.assert_allclose(np.asarray(names["f"](names["poses"][0])).ravel(), names["loads"][0], rtol=1e-9)
    assert "surrogate of scene knee" in capsys.readouterr().out


def test_the_pictures_it_shows_are_there():
    pictures = re.findall(r"!\[[^\]]*\]\(([^)]+)\)", README)
    assert pictures
    for picture in pictures:
        assert (Path(__file__).parents[1] / picture).is_file(), picture


def test_its_first_two_shell_blocks_set_up_the_main_job_and_the_tests():
    blocks = re.findall(r"```sh\n(.*?)```", README, re.S)
    assert "problems.pose_estimation" in blocks[0]
    assert "pytest" in blocks[1]
