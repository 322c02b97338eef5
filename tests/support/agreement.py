"""Are two evaluations of the same formula equal but for rounding, on any processor?

The measure is the usual size of that output, the largest over the poses of a test: near liftoff a load is a small
difference of large numbers. Two to three digits are left above what was seen (5.8e-12 in values with AVX2).
"""

import casadi as ca
import numpy as np

from casadi_contact.networks.functions import hessian_function

ROUNDING = (1e-10, 1e-9, 1e-8)  # of values, first and second derivatives, relative to the usual size of that output

# Trained two_stage networks add up last-layer terms of thousands of times their sum: so many times more rounding.
CANCELLED = {"patch": 1.0, "two_stage": 100.0}


def usual_size(values):
    """Largest magnitude (m,) of each output of values (n, m, ...) over poses and derivatives."""
    values = np.abs(np.asarray(values, dtype=float))
    return values.reshape(*values.shape[:2], -1).max(axis=(0, 2))


def agree(got, want, order=0, size=None, amplified=1.0):
    """Assert that got and want (n, m, ...) differ by rounding relative to size (m,), `usual_size` if left out."""
    got, want = np.asarray(got, dtype=float), np.asarray(want, dtype=float)
    assert got.shape == want.shape
    size = usual_size(want) if size is None else size
    off = np.abs(got - want)
    allowed = amplified * ROUNDING[order] * np.reshape(size, (1, -1, *[1] * (want.ndim - 2)))
    wrong = ~(off <= allowed)  # NaN is wrong
    worst = np.unravel_index(np.argmax(np.where(wrong, off / np.maximum(allowed, 1e-300), 0.0)), off.shape)
    assert not wrong.any(), (
        f"{got[worst]!r} differs from {want[worst]!r} at {tuple(map(int, worst))} by {off[worst]:.2g}, "
        f"expected at most {np.broadcast_to(allowed, off.shape)[worst]:.2g}"
    )


def close(got, want, digits):
    """Assert that arrays of outputs of one size differ by 10^-digits of the largest entry and of their own."""
    got, want = np.asarray(got, dtype=float), np.asarray(want, dtype=float)
    np.testing.assert_allclose(got, want, rtol=10.0**-digits, atol=10.0**-digits * np.abs(want).max())


def differences(function, rows, steps):
    """Central differences (n, ..., k) of a function of rows (n, k), by a step for each column, or one for all."""
    moves = np.diag(np.broadcast_to(steps, rows.shape[1]))
    return np.stack([(function(rows + move) - function(rows - move)) / (2.0 * move.sum()) for move in moves], -1)


def check_jacobian(model, poses, tolerance):
    """Of loads and root loads, against central differences; an angle counts 25 mm to the radian."""
    scales = np.repeat([1.0, 25.0], 3)
    for evaluate in (model.jacobian, model.root_loads):
        slopes, found = (
            evaluate(poses)[1] / scales,
            differences(lambda at, of=evaluate: of(at)[0], poses, 1e-5 / scales),
        )
        np.testing.assert_allclose(slopes, found / scales, atol=tolerance * np.abs(slopes).max())


def check_hessians(model, poses, of_loads=2e-3, of_roots=2e-2):
    """Of a weighted sum of loads and of root loads, in contact and out of it; angles count 25 mm to the radian."""
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


def evaluated(function: ca.Function, poses: np.ndarray, weights: np.ndarray) -> list[np.ndarray]:
    """Values (n, m), Jacobians (n, m, 6) and Hessians (n, 1, 6, 6) of weights·value, called as nlpsol calls them."""
    jacobian, hessian = function.jacobian(), hessian_function(function)
    found = [
        np.stack([function(pose).full().ravel() for pose in poses]),
        np.stack([jacobian(pose, 0).full() for pose in poses]),
        np.stack([[hessian(pose, w).full()] for pose, w in zip(poses, weights, strict=True)]),
    ]
    np.testing.assert_array_equal(found[2], found[2].swapaxes(2, 3))
    return found
