"""A pose that holds NaN or infinity gives NaN in every output: no load, root load or derivative is made up."""

import casadi as ca
import numpy as np
import pytest

from casadi_contact.surrogate.load import load_surrogate
from tests.support.compiler import needs_compiler
from tests.support.random_surrogates import IN_PARTS, POSE_CENTRE, random_poses, random_surrogate, scene_called

BAD = [(value, column) for value in (np.nan, np.inf, -np.inf) for column in range(6)]
FORMS = [pytest.param(False, id="graph"), pytest.param(True, id="kernel", marks=needs_compiler)]


def outputs_and_derivatives(function: ca.Function) -> ca.Function:
    """pose, λ -> outputs, their Jacobians, and gradient and Hessian of λᵀ·outputs, as nlpsol builds them."""
    pose = ca.MX.sym("pose", 6)
    outputs = function.call([pose])
    weights = ca.MX.sym("weights", sum(output.numel() for output in outputs))
    hessian, gradient = ca.hessian(ca.dot(weights, ca.vertcat(*outputs)), pose)
    return ca.Function("all", [pose, weights], [*outputs, *(ca.jacobian(f, pose) for f in outputs), gradient, hessian])


@pytest.mark.parametrize("compiled", FORMS)
@pytest.mark.parametrize(("scene", "structure"), [("knee", "patch"), ("knee", "two_stage"), (IN_PARTS, "patch")])
def test_a_pose_that_is_not_finite_gives_nan_in_all_outputs_and_derivatives(scene, structure, compiled):
    """18 poses for each structure and form, from one in contact."""
    surrogate, rows = random_surrogate(scene_called(scene), structure), random_poses(200)
    everything = outputs_and_derivatives(surrogate.load_and_root_function(compiled=compiled))
    pose = rows[np.argmax(surrogate.root_loads(rows)[0].min(axis=1))]
    weights = np.ones(everything.numel_in(1))
    for output in everything.call([pose, weights]):
        assert np.isfinite(output.full()).all()
    for value, column in BAD:
        bad = np.where(np.arange(6) == column, value, pose)
        for output in everything.call([bad, weights]):
            assert np.isnan(output.full()).all(), (value, column)


@needs_compiler
@pytest.mark.parametrize("structure", ["patch", "two_stage"])
def test_in_a_batch_only_the_bad_poses_give_nan(structure):
    surrogate = random_surrogate(scene_called("knee"), structure, "tanh")
    poses = random_poses(18 + 17)
    want = surrogate(poses)
    for row, (value, column) in enumerate(BAD):
        poses[2 * row - row // 9, column] = value
    bad = ~np.isfinite(poses).all(axis=1)
    assert 0 < bad.sum() < len(poses)
    got = surrogate.function(compiled=True, batch=len(poses))(poses.T).full().T
    assert np.isnan(got[bad]).all()
    np.testing.assert_allclose(got[~bad], want[~bad], rtol=1e-9, atol=1e-9 * np.abs(want).max())


@pytest.mark.parametrize("function", ["validity_function", "expected_error_function"])
def test_validity_and_expected_error_are_nan_too(function):
    surrogate = load_surrogate("knee")
    call = getattr(surrogate, function)()
    for value, column in BAD:
        assert np.isnan(call(np.where(np.arange(6) == column, value, POSE_CENTRE)).full()).all(), (value, column)
