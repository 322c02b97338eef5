"""Derivatives as data: the study measures what it says."""

import json

import numpy as np
import pytest

from tests.support.command import ended

pytest.importorskip("torch", reason="the study's network is differentiated by torch")

from problems.studies import sobolev


def rows(count, seed=0):
    """A smooth function of two of six inputs, with its slopes."""
    x = np.random.default_rng(seed).normal(size=(count, 6))
    slopes = np.zeros((count, 6))
    slopes[:, 0], slopes[:, 1] = np.cos(x[:, 0]), 0.6 * x[:, 1]
    return sobolev.Rows(x, np.sin(x[:, 0]) + 0.3 * x[:, 1] ** 2, slopes, np.full(count, 10.0))


def test_where_poses_are_few_slopes_help():
    tests = rows(300, seed=1)
    by_values = sobolev.fitted(rows(30), tests, 0.0, (8,), 80, seed=0)
    by_slopes = sobolev.fitted(rows(30), tests, 0.3, (8,), 80, seed=0)
    assert by_slopes < 0.5 * by_values


def test_wrong_slopes_spoil_a_fit():
    right, tests = rows(100), rows(300, seed=1)
    wrong = sobolev.Rows(right.inputs, right.roots, -right.slopes, right.weights)
    fine, spoilt = (sobolev.fitted(learned, tests, 0.3, (8,), 80, seed=0) for learned in (right, wrong))
    assert spoilt > 5.0 * fine


def test_the_command_writes_every_fit(monkeypatch, tmp_path, capsys):
    arguments = ["50", "--hidden", "4", "--steps", "3", "--seeds", "2", "--out", str(tmp_path)]
    monkeypatch.setattr(sobolev, "_TEST_POSES", 100)
    monkeypatch.setattr(sobolev, "SHARES", (0.1,))
    assert not ended(monkeypatch, sobolev.main, *arguments)
    fits = json.loads((tmp_path / "sobolev.json").read_text())["fits"]
    assert [(fit["poses"], fit["rows"]) for fit in fits] == [(50, 50), (50, 350), (350, 350)]
    assert all(len(fit["errors_N"]) == 2 and fit["error_N"] > 0.0 for fit in fits)
    assert "slopes" in capsys.readouterr().out
