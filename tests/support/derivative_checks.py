"""Derivatives of a contact model against differences, against each other, and in C against NumPy."""

import casadi as ca
import numpy as np

from tests.support.second_derivatives import by_hessians, by_jacobian_of_jacobian


def check_jacobian(model, poses, tolerance):
    """Of loads and root loads, against central differences; an angle counts 25 mm to the radian."""
    scales = np.repeat([1.0, 25.0], 3)
    steps = 1e-5 / scales
    for evaluate in (model.jacobian, model.root_loads):
        slopes = evaluate(poses)[1] / scales
        moves = np.diag(steps)
        ends = [(evaluate(poses + move)[0], evaluate(poses - move)[0]) for move in moves]
        differences = np.stack([(a - b) / 2e-5 for a, b in ends], -1)
        np.testing.assert_allclose(slopes, differences, atol=tolerance * np.abs(slopes).max())


def check_hessians(model, poses, of_loads=2e-3, of_roots=2e-2):
    """Of a weighted sum of loads and of root loads, in contact and out of it; angles count 25 mm to the radian.

    Of a root load in contact what is left of two large terms: hence the wider tolerance.
    """
    both = model.load_and_root_function()
    x = ca.MX.sym("pose", 6)
    scales = np.repeat([1.0, 25.0], 3)
    for output, tolerance in zip(both(x), (of_loads, of_roots), strict=True):
        total = ca.dot(ca.linspace(ca.DM(0.5), ca.DM(1.5), output.numel()) if output.numel() > 1 else 1.0, output)
        hessian = ca.Function("hessian", [x], [ca.hessian(total, x)[0]])
        gradient = ca.Function("gradient", [x], [ca.gradient(total, x)])
        for pose in poses:
            steps = 1e-5 / scales
            moves = np.diag(steps)
            columns = [np.array(gradient(pose + m) - gradient(pose - m))[:, 0] for m in moves]
            differences = np.column_stack(columns) / (2.0 * steps) / np.outer(scales, scales)
            scaled = np.array(hessian(pose)) / np.outer(scales, scales)
            np.testing.assert_allclose(scaled, differences, atol=tolerance * np.abs(differences).max() + 1e-6)
            np.testing.assert_allclose(scaled, scaled.T, rtol=1e-9, atol=1e-9 * np.abs(scaled).max())


def check_second_derivatives(model, poses):
    """The Jacobian of the Jacobian holds every Hessian, of loads and root loads together and of loads alone."""
    loads, roots = by_hessians(model.load_and_root_function(), poses)
    weighted = [[model.hessian(pose, unit) for unit in np.eye(len(model.load_names))] for pose in poses]
    np.testing.assert_allclose(weighted, loads, rtol=1e-9, atol=1e-9 * np.abs(loads).max())
    got = by_jacobian_of_jacobian(model.load_and_root_function(), poses)
    for tensor, want in (
        *zip(got, (loads, roots), strict=True),
        (by_jacobian_of_jacobian(model.function(), poses)[0], loads),
    ):
        np.testing.assert_allclose(tensor, want, rtol=1e-9, atol=1e-12 * np.abs(want).max())


def check_same_formulas(compiled, plain, poses):
    """Of C and NumPy, to rounding."""
    scale = np.abs(plain.jacobian(poses)[1]).max()
    np.testing.assert_allclose(compiled.wrenches(poses), plain.wrenches(poses), atol=1e-12 * scale)
    for a, b in zip(compiled.jacobian(poses), plain.jacobian(poses), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-11 * scale)
    np.testing.assert_allclose(compiled.gaps(poses), plain.gaps(poses), atol=1e-10)
    np.testing.assert_array_equal(compiled.at_edge(poses), plain.at_edge(poses))
    for a, b in zip(compiled.root_loads(poses), plain.root_loads(poses), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-8, atol=1e-8)
