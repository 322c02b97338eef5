"""Second derivatives of every output of a CasADi function of a pose, the two ways in which users ask for them."""

import casadi as ca
import numpy as np


def by_jacobian_of_jacobian(function, poses):
    """Of each output of a function, (n, m, 6, 6)."""
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
