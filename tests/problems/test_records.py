"""Summaries are JSON whatever the numbers: null stands where there is none."""

import json

import numpy as np
import pytest

from problems.common.records import rms_and_largest, rms_and_largest_words, write_summary


def no_constant(name):
    raise AssertionError(f"{name} is not JSON")


def test_root_mean_squares_are_those_of_the_frames_that_have_a_value():
    assert rms_and_largest(np.array([3.0, -4.0])) == {"rms": pytest.approx(np.sqrt(12.5)), "max": 4.0}
    assert rms_and_largest(np.array([3.0, np.nan, -4.0])) == {
        "rms": pytest.approx(np.sqrt(12.5)),
        "max": 4.0,
        "values": 2,
    }
    none = rms_and_largest(np.full(3, np.nan))
    assert none == {"rms": None, "max": None, "values": 0}
    assert rms_and_largest_words(none) == "-"
    assert rms_and_largest_words({"rms": 0.123, "max": 4.56}) == "0.12 / 4.6"


def test_a_summary_has_null_for_what_is_no_number(tmp_path):
    content = {
        "a": np.float64("nan"),
        "b": [1.5, float("inf")],
        "c": {"d": (float("nan"), "NaN", 2)},
        "e": np.float32(1),
    }
    write_summary(tmp_path / "summary.json", content)
    found = json.loads((tmp_path / "summary.json").read_text("utf-8"), parse_constant=no_constant)
    assert found.pop("machine")
    assert found == {"a": None, "b": [1.5, None], "c": {"d": [None, "NaN", 2]}, "e": "1.0"}
