"""The element grid in C: the loads of numba's loops, to rounding, and these loops where there is no C."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.core.compiler import CACHE_VARIABLE
from casadi_contact.pictures.contact_pose import contact_pose
from tests.support.compiler import needs_compiler


def compiled(model):
    return [bed.compiled is not None for bed in model._patches]


@needs_compiler
@pytest.mark.usefixtures("as_shipped")
@pytest.mark.parametrize(
    ("name", "grid", "law"),
    [
        ("knee", (80, 40), "linear"),
        ("knee", (37, 21), "log"),  # blocks that are not full
        ("patellofemoral", (30, 20), "linear"),
        ("hip", (60, 60), "linear"),
        ("sphere_on_plane", (40, 40), "log"),
    ],
)
def test_loads_and_jacobian_are_those_of_the_loops_to_rounding(name, grid, law):
    """In light contact, deep contact, contact across the rim and none, for a few hundred poses at once."""
    scene = cc.load_scene(name, law=law)
    in_c, loops = (cc.ElasticFoundation(scene, grid, compiled=c) for c in (True, False))
    assert all(compiled(in_c))
    assert not any(compiled(loops))
    moves = np.random.default_rng(1).normal(size=(300, 6)) * [0.5, 0.2, 0.5, 0.02, 0.05, 0.2]
    poses = contact_pose(loops) + moves
    wrenches = loops.wrenches(poses)
    touching = (wrenches != 0.0).any(axis=2)
    assert 0.1 < touching.mean() < 0.95
    np.testing.assert_array_equal((in_c.wrenches(poses) != 0.0).any(axis=2), touching)
    np.testing.assert_allclose(in_c.wrenches(poses), wrenches, atol=1e-12 * np.abs(wrenches).max())
    for a, b in zip(in_c.jacobian(poses), loops.jacobian(poses), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-12 * np.abs(b).max())


def test_without_a_compiler_and_for_other_surfaces_the_loops_run(monkeypatch, tmp_path):
    assert compiled(cc.ElasticFoundation(cc.load_scene("cylinder_on_plane"))) == [False]
    monkeypatch.setenv("CC", "no-such-compiler")
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    model = cc.ElasticFoundation(cc.load_scene("knee"), (40, 30))
    assert compiled(model) == [False, False]
    assert model(np.array([0.5, 27.23, 0.1, 0.0, -0.05, -0.3]))[0] < -100.0
