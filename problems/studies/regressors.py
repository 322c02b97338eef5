"""Regressors that people use in place of networks: each learns y (n, m) of x (n, k), and those that have a formula are
CasADi expressions too, so that C can be generated of them.

Inputs and outputs are standardised. Random forest, neighbours and polynomial features are scikit-learn's (``pip install
casadi_contact[peers]``), radial basis functions SciPy's, B-splines CasADi's.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import comb

import casadi as ca
import numpy as np
from scipy.interpolate import RBFInterpolator, make_interp_spline
from scipy.linalg import cho_factor, cho_solve

from casadi_contact.core.conventions import Array


@dataclass(frozen=True)
class Fit:
    """A fitted function: of rows (n, k) -> (n, m), and of a CasADi vector (k) -> (m) where it has a formula."""

    predict: Callable[[Array], Array]
    expression: Callable[[ca.MX], ca.MX] | None = None


def learned(method: Callable[[Array, Array, Array], Fit], x: Array, y: Array, w: Array) -> Fit:
    """A method of `METHODS`, which gets rows of mean 0 and deviation 1; w (n,): their weights. A constant stays 0."""
    y = np.reshape(y, (len(x), -1))
    x_mean, x_size = x.mean(axis=0), np.where(np.ptp(x, axis=0), x.std(axis=0), 1.0)
    y_mean, y_size = y.mean(axis=0), np.where(np.ptp(y, axis=0), y.std(axis=0), 1.0)
    inner = method((x - x_mean) / x_size, (y - y_mean) / y_size, w / w.mean())

    def predict(rows: Array) -> Array:
        return np.asarray(y_mean + y_size * inner.predict((rows - x_mean) / x_size).reshape(len(rows), -1))

    if (formula := inner.expression) is None:
        return Fit(predict)
    return Fit(predict, lambda row: ca.DM(y_mean) + ca.DM(y_size) * formula((row - ca.DM(x_mean)) / ca.DM(x_size)))


def polynomial(degree: int, x: Array, y: Array, w: Array) -> Fit:
    """Response surface of all monomials up to a degree, by weighted least squares."""
    from sklearn.preprocessing import PolynomialFeatures

    if comb(degree + x.shape[1], degree) > len(x):
        raise ValueError(f"degree {degree} has more terms than the {len(x)} samples")
    features = PolynomialFeatures(degree).fit(x)
    terms, powers = features.transform(x), [tuple(row) for row in features.powers_]
    weights = np.linalg.lstsq(w[:, None] * terms, w[:, None] * y, rcond=1e-12)[0]

    def expression(row: ca.MX) -> ca.MX:
        factors, known = ca.SX.sym("x", x.shape[1]), {(0,) * x.shape[1]: ca.SX(1)}
        for power in powers[1:]:
            k = next(k for k, exponent in enumerate(power) if exponent)
            known[power] = factors[k] * known[(*power[:k], power[k] - 1, *power[k + 1 :])]
        monomials = ca.Function("monomials", [factors], [ca.vertcat(*(known[power] for power in powers))])
        return ca.mtimes(ca.DM(weights.T), monomials(row))

    return Fit(lambda rows: features.transform(rows) @ weights, expression)


def gaussian_process(points: int, inducing: int | None, x: Array, y: Array, w: Array) -> Fit:
    """A process for all outputs with a squared exponential kernel, one length for each input, and noise.

    Lengths and noise maximise the likelihood of 300 points. Exact on the first points; or sparse (Nyström): all rows,
    projected on the kernels of the first `inducing` ones."""
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, WhiteKernel

    kernel = RBF(np.full(x.shape[1], 3.0), (0.1, 1e3)) + WhiteKernel(1e-4, (1e-8, 1.0))
    best = GaussianProcessRegressor(kernel).fit(x[:300], y[:300]).kernel_
    lengths, noise = best.k1.length_scale, max(best.k2.noise_level, 1e-8)
    centres = x[: points if inducing is None else inducing] / lengths

    def kernels(rows: Array) -> Array:
        squares = (rows**2).sum(axis=1)[:, None] + (centres**2).sum(axis=1) - 2.0 * rows @ centres.T
        return np.asarray(np.exp(-0.5 * np.maximum(squares, 0.0)))

    own, given = kernels(centres), y[: len(centres)]
    normal = own + noise * np.eye(len(centres))
    if inducing is not None:
        of_all = kernels(x / lengths)
        normal, given = of_all.T @ of_all + noise * own + 1e-8 * np.eye(len(centres)) * len(x), of_all.T @ y
    weights = cho_solve(cho_factor(normal), given)

    return Fit(lambda rows: kernels(rows / lengths) @ weights)


def neighbours(count: int, x: Array, y: Array, w: Array) -> Fit:
    """Means of the nearest samples, weighted by the inverse distance: lazy learning [EF15 §1] in its plainest form."""
    from sklearn.neighbors import KNeighborsRegressor

    return Fit(KNeighborsRegressor(min(count, len(x)), weights="distance").fit(x, y).predict)


def random_forest(trees: int, x: Array, y: Array, w: Array) -> Fit:
    """Means of trees of decisions, each of another draw of the samples."""
    from sklearn.ensemble import RandomForestRegressor

    return Fit(RandomForestRegressor(trees, random_state=0).fit(x, np.squeeze(y), sample_weight=w**2).predict)


def radial_basis(points: int, local: int | None, x: Array, y: Array, w: Array) -> Fit:
    """Thin plate splines through the first points, or local ones through the nearest of all."""
    varying = np.flatnonzero(np.ptp(x, axis=0) > 0.0)
    points = len(x) if local is not None else points
    spline = RBFInterpolator(x[:points, varying], y[:points], neighbors=local and min(local, len(x)))
    return Fit(lambda rows: spline(rows[:, varying]))


def b_spline(values: Callable[[Array], Array], low: Array, high: Array, nodes: int) -> Fit:
    """Cubic B-spline through values (n, m) on a grid of as many points along every axis that varies; nodes: of the
    whole grid at most, which leaves 5 along 6 axes for 16,000.

    ``ca.interpolant`` solves for all coefficients at once, which takes minutes at 4 points along 6 axes: they are
    found axis by axis here, and CasADi evaluates the spline."""
    varying = np.flatnonzero(high > low)
    count = max(4, int(nodes ** (1.0 / len(varying)) + 1e-9))
    axes = [np.linspace(low[k], high[k], count) for k in varying]
    rows = np.tile(low, (count ** len(axes), 1))
    rows[:, varying] = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
    coefficients = values(rows).reshape(*[count] * len(axes), -1)
    knots: list[list[float]] = []
    for k, axis in enumerate(axes):
        spline = make_interp_spline(axis, coefficients, axis=k)
        coefficients, knots = np.moveaxis(spline.c, 0, k), [*knots, spline.t.tolist()]
    outputs = coefficients.shape[-1]
    in_order = np.moveaxis(coefficients, -1, 0).ravel(order="F").tolist()
    function = ca.Function.bspline("spline", knots, in_order, [3] * len(axes), outputs)
    return Fit(
        lambda some: np.asarray(function.map(len(some))(some[:, varying].T)).T,
        lambda row: function(ca.vertcat(*(row[int(k)] for k in varying))),
    )


METHODS: dict[str, dict[str, Callable[[Array, Array, Array], Fit]]] = {
    "polynomial": {f"{degree}": partial(polynomial, degree) for degree in (2, 3, 4, 5, 6)},
    "Gaussian process": {"2000 points": partial(gaussian_process, 2000, None)},
    "sparse Gaussian process": {"400 points": partial(gaussian_process, 0, 400)},
    "neighbours": {"28": partial(neighbours, 28)},
    "random forest": {"50 trees": partial(random_forest, 50)},
    "radial basis": {"local 100": partial(radial_basis, 0, 100), "4000 points": partial(radial_basis, 4000, None)},
}
"""By family: settings in words, and how to learn them from standardised x (n, k), y (n, m) and weights (n,)."""
