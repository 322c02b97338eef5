"""A table that gives one pose several loads is told: loads are a function of the pose."""

import re
from dataclasses import replace

import numpy as np

from casadi_contact.conventions import POSE_NAMES
from casadi_contact.dataset import Samples
from casadi_contact.dataset.repeated_poses import contradictions_text
from tests.support.own_contact import SCENE, gaps, table_rows, wrenches

POSES = np.column_stack([table_rows(600)[name] for name in POSE_NAMES])
EXACT = Samples(SCENE, POSES, wrenches(POSES), gaps(POSES), np.ones(600, np.uint8), np.zeros(600, np.uint8))


def with_repeated(rows, times):
    """The samples, and these rows once more with loads of so many times their size."""
    both = np.concatenate([np.arange(len(EXACT)), rows])
    factor = np.concatenate([np.ones(len(EXACT)), np.full(len(rows), times)])
    repeated = EXACT.rows(both)
    return replace(repeated, wrenches=repeated.wrenches * factor[:, None, None])


def test_repeated_rows_that_agree_within_the_tolerances_are_not_told():
    assert contradictions_text(EXACT) == ""
    assert contradictions_text(with_repeated(np.arange(50), 1.0)) == ""
    largest = np.abs(EXACT.loads()).max() / min(SCENE.tolerances.values())
    assert contradictions_text(with_repeated(np.arange(50), 1.0 + 0.9 / largest)) == ""


def test_the_two_branches_of_a_hysteresis_are_told_with_the_rows_that_lie_furthest_apart():
    """Unloaded with a tenth less force: 20 poses of the largest loads were measured on both branches."""
    rows = np.argsort(-EXACT.wrenches[:, 0, 1])[:20]
    said = contradictions_text(with_repeated(rows, 0.9))
    count, name, first, loaded, second, unloaded = re.search(
        r"mean: (\d+) \((\w+) of row (\d+) (\S+) and row (\d+) (\S+) ", said
    ).groups()
    assert int(count) == 20
    apart = 0.1 * np.abs(EXACT.loads()[rows]) / [SCENE.tolerances[each] for each in SCENE.load_names]
    worst, load = np.unravel_index(apart.argmax(), apart.shape)
    assert (int(first), int(second)) == (rows[worst] + 1, len(EXACT) + worst + 1)
    assert name == SCENE.load_names[load]
    assert np.isclose(float(unloaded), 0.9 * float(loaded), rtol=0.01)
