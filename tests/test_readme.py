"""The README is short, its example is in contact, and its first shell blocks run the main job and the tests."""

import re
from pathlib import Path

import numpy as np

README = (Path(__file__).parents[1] / "README.md").read_text("utf-8")


def test_it_has_at_most_eight_kilobytes():
    assert len(README.encode()) <= 8_000


def test_its_example_carries_the_loads_it_asks_for():
    (example,) = re.findall(r"```python\n(.*?)```", README, re.S)
    names: dict = {}
    exec(example, names)
    assert names["jacobian"].shape == (1, 7, 6)
    np.testing.assert_allclose(
        np.asarray(names["f"](names["poses"][0])).ravel(), names["loads"][0], rtol=1e-9, atol=1e-6
    )
    np.testing.assert_allclose(names["model"](names["poses"])[0, :2], [-600.0, -400.0], atol=1e-3)
    np.testing.assert_allclose(names["elements"](names["settled"])[0, :2], [-600.0, -400.0], atol=1e-6)


def test_its_first_two_shell_blocks_set_up_the_main_job_and_the_tests():
    blocks = re.findall(r"```sh\n(.*?)```", README, re.S)
    assert blocks[0].splitlines()[-1].endswith("-m problems.pose_estimation")
    assert blocks[1].splitlines()[-1].endswith("-m pytest -n 2")
    assert all(block.startswith("python3 -m venv .venv\n") for block in blocks[:2])
