"""Derivatives of a CasADi function of a pose, in the ways in which users and nlpsol ask for them."""

import casadi as ca
import numpy as np


def by_jacobian_of_jacobian(function, poses):
    """Second derivatives of each output of a function, (n, m, 6, 6)."""
    pose = ca.MX.sym("pose", 6)
    tensors = []
    for output in function.call([pose]):
        second = ca.Function("second", [pose], [ca.jacobian(ca.jacobian(output, pose), pose)])
        rows = [second(at).full().reshape(6, output.numel(), 6) for at in poses]  # rows by columns of the Jacobian
        tensors.append(np.stack(rows).swapaxes(1, 2))
    return tensors


def by_hessians(function, poses):
    """The same, as a Lagrangian's Hessian with one weight after the other."""
    pose = ca.MX.sym("pose", 6)
    tensors = []
    for output in function.call([pose]):
        weights = ca.MX.sym("weights", output.numel())
        hessian = ca.Function("hessian", [pose, weights], [ca.hessian(ca.dot(weights, output), pose)[0]])
        tensors.append(np.stack([[hessian(at, unit).full() for unit in np.eye(output.numel())] for at in poses]))
    return tensors


def second_derivatives(function: ca.Function) -> ca.Function:
    """pose, λ -> Hessian of λᵀ·output, the way nlpsol builds it."""
    pose, weights = ca.MX.sym("pose", 6), ca.MX.sym("weights", function.numel_out(0))
    lagrangian = ca.dot(weights, function(pose))
    return ca.Function("lagrangian_hessian", [pose, weights], [ca.hessian(lagrangian, pose)[0]])


def evaluated(function: ca.Function, poses: np.ndarray, weights: np.ndarray) -> list[np.ndarray]:
    """Values (n, m), Jacobians (n, m, 6) and Hessians (n, 1, 6, 6) of weights·value, called as nlpsol calls them."""
    jacobian, hessian = function.jacobian(), second_derivatives(function)
    found = [
        np.stack([function(pose).full().ravel() for pose in poses]),
        np.stack([jacobian(pose, 0).full() for pose in poses]),
        np.stack([[hessian(pose, w).full()] for pose, w in zip(poses, weights, strict=True)]),
    ]
    np.testing.assert_array_equal(found[2], found[2].swapaxes(2, 3))
    return found
