"""The README is short, its example is in contact, and its shell blocks are those that continuous integration runs."""

import re
from pathlib import Path

import numpy as np

README = (Path(__file__).parents[1] / "README.md").read_text("utf-8")


def test_it_has_at_most_ten_kilobytes():
    assert len(README.encode()) <= 10_000


def test_its_example_is_in_contact_and_gives_the_shapes_it_names(capsys):
    (example,) = re.findall(r"```python\n(.*?)```", README, re.S)
    names: dict = {}
    exec(example, names)
    surrogate, loads = names["surrogate"], names["loads"]
    assert loads.shape == (1, 7)
    assert names["jacobian"].shape == (1, 7, 6)
    assert (loads[0, :2] < -50.0).all()  # both sides carry
    assert surrogate.validity([[0.5, 27.23, 0.1, 0.0, -0.05, -0.3]])[0] > 0.5
    np.testing.assert_allclose(np.asarray(names["f"]([0.5, 27.23, 0.1, 0.0, -0.05, -0.3])).ravel(), loads[0], rtol=1e-9)
    assert names["report"].converged.all()
    np.testing.assert_allclose(names["fine"](names["poses"])[0, :2], [-700.0, -500.0], atol=1e-6)
    assert "converged" in capsys.readouterr().out


def test_its_first_two_shell_blocks_set_up_the_main_job_and_the_tests():
    blocks = re.findall(r"```sh\n(.*?)```", README, re.S)
    assert blocks[0].splitlines()[-1].endswith("-m problems.pose_estimation")
    assert blocks[1].splitlines()[-1].endswith("-m pytest -n 2")
    for block in blocks[:2]:
        assert block.splitlines()[0] == "python3 -m venv .venv"
