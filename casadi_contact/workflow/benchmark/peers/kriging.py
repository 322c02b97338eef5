"""Kriging: scikit-learn's Gaussian process with a Matérn kernel, on as many points as time and memory allow.

    F(x) = mean + deviation·Σ_i α_i k(x, x_i),   k = c·(1 + r + r²/3)·exp(-r),   r² = 5·Σ_j (x_j - x_ij)²/l_j²

One kernel serves all loads: one factorisation and one row of k for seven loads, so that more points fit into the
same budget. Length scales and nugget maximise the likelihood of a subset, from several starts; of an interpolating and
a regressing kernel the better is kept, and the points are doubled.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from scipy.linalg.lapack import dpocon
from scipy.optimize import minimize

from casadi_contact.core.conventions import Array, as_poses
from casadi_contact.workflow.benchmark.candidate import Candidate
from casadi_contact.workflow.benchmark.peers.growth import grow
from casadi_contact.workflow.benchmark.peers.stopwatch import one_call, single_calls
from casadi_contact.workflow.benchmark.peers.training_set import TrainingSet

FAMILY = "Kriging"
BYTES_PER_PAIR = 48.0  # the kernel matrix, its factor and scikit-learn's temporaries
SMALLEST_SUBSET, STARTS = 250, 2
FEWEST_EVALUATIONS = 10
LARGEST_NUGGETS = (1e-7, 1.0)  # to interpolate and to regress, in variances of the loads
TRIAL_POINTS = 2000
CHUNK_VALUES = 2**21


def _sklearn() -> Any:
    try:
        from sklearn import gaussian_process
    except ImportError:
        raise ImportError("Kriging needs scikit-learn: pip install casadi_contact[peers]") from None
    return gaussian_process


class Kriging:
    """A fitted Gaussian process (with kernel c·Matérn(5/2) + nugget), its sums written out for single poses.

    ``condition`` is the estimated 1-norm condition number of the kernel matrix.
    """

    def __init__(self, data: TrainingSet, count: int, kernel: Any) -> None:
        process = _sklearn().GaussianProcessRegressor(kernel, optimizer=None)
        mean, deviation = data.load_scale
        centre, spread = data.centre, data.spread
        process.fit((data.poses[:count] - centre) / spread, (data.loads[:count] - mean) / deviation)
        self.load_names, self._limits, self._mean = data.load_names, data.limits, mean
        self.condition = _condition(process.L_)
        scale, matern = process.kernel_.k1.k1, process.kernel_.k1.k2
        self._shift, self._inverse = centre, np.sqrt(5.0) / (spread * matern.length_scale)
        points = process.X_train_ * (np.sqrt(5.0) / matern.length_scale)
        # r² = |z|² + |z_i|² - 2 z·z_i: one matrix product with (z, 1, |z|²).
        squares = np.einsum("ij,ij->i", points, points)
        self._points = np.asfortranarray(np.column_stack([-2.0 * points, squares, np.ones(count)]))
        self._ones_and_points = np.column_stack([np.ones(count), points])
        alpha = process.alpha_.reshape(count, -1)
        self._alpha = np.ascontiguousarray((scale.constant_value * alpha * deviation).T)
        self.parameter_count = points.size + alpha.size
        self._z = np.ones(8)
        self._k, self._r, self._e = np.empty((3, count))
        self._loads = np.empty(len(mean))

    def __call__(self, poses: Array) -> Array:
        """Named loads (n, L)."""
        z = (as_poses(poses) - self._shift) * self._inverse
        z = np.column_stack([z, np.ones(len(z)), np.einsum("ij,ij->i", z, z)])
        loads = np.empty((len(z), len(self.load_names)))
        step = max(1, CHUNK_VALUES // len(self._points))
        for begin in range(0, len(z), step):
            rows = slice(begin, begin + step)
            k = z[rows] @ self._points.T
            _matern(k, np.empty_like(k))
            loads[rows] = k @ self._alpha.T
        return self._limits.hold(loads + self._mean)

    def one(self, pose: Array) -> Array:
        """Loads (L) of one pose, in an array that the next call overwrites."""
        self._squared_distances(pose)
        _matern(self._k, self._r)
        np.dot(self._alpha, self._k, out=self._loads)
        np.add(self._loads, self._mean, out=self._loads)
        return self._limits.hold(self._loads)

    def jacobian_one(self, pose: Array) -> Array:
        """d loads / d pose (L, 6) of one pose: dk/dz = -c/3·(1 + r)·exp(-r)·(z - z_i)."""
        self._squared_distances(pose)
        r, e, k = self._r, self._e, self._k
        np.sqrt(k, out=r)
        np.negative(r, out=e)
        np.exp(e, out=e)
        r += 1.0
        r *= e
        k *= e
        k *= 1.0 / 3.0
        k += r
        clamped = self._limits.beyond(self._alpha @ k + self._mean)
        sums = (self._alpha * r) @ self._ones_and_points / 3.0
        jacobian = (sums[:, 1:] - sums[:, :1] * self._z[:6]) * self._inverse
        jacobian[clamped] = 0.0
        return jacobian

    def _squared_distances(self, pose: Array) -> None:
        z = self._z[:6]
        np.subtract(pose, self._shift, out=z)
        np.multiply(z, self._inverse, out=z)
        self._z[7] = z @ z
        np.dot(self._points, self._z, out=self._k)
        np.maximum(self._k, 0.0, out=self._k)


def _matern(k: Array, r: Array) -> None:
    """Turn r² into (1 + r + r²/3)·exp(-r), in place; r is a place to work in."""
    np.maximum(k, 0.0, out=k)
    np.sqrt(k, out=r)
    k *= 1.0 / 3.0
    k += r
    k += 1.0
    np.negative(r, out=r)
    np.exp(r, out=r)
    k *= r


def _condition(lower: Array) -> float:
    """Estimated 1-norm condition number of K = L·Lᵀ; K has no negative entries, so ‖K‖₁ = max(K·1)."""
    norm = float((lower @ (lower.T @ np.ones(len(lower)))).max())
    reciprocal, _ = dpocon(lower.T, norm, uplo="U")
    return 1.0 / reciprocal if reciprocal > 0.0 else float("inf")


def likelihood_gflop(count: int) -> float:
    """10⁹ operations of one likelihood with its gradient: factor and inverse of the kernel matrix, n³/3 and 2n³, and
    200 an entry for the kernel and its derivatives, counted ten times because they run so much slower."""
    return 1e-9 * (7.0 / 3.0 * count**3 + 2000.0 * count**2)


def fit_gflop(count: int) -> float:
    """10⁹ operations of a fit with a given kernel, some 100 an entry; scikit-learn factorises twice."""
    return 1e-9 * (2.0 / 3.0 * count**3 + 100.0 * count**2)


class Ascent:
    """scikit-learn's own optimiser (L-BFGS-B on the likelihood) with a limit of likelihoods a start; ``evaluations``
    counts them over all starts."""

    def __init__(self, most: int) -> None:
        self.most, self.evaluations = most, 0

    def __call__(self, objective: Callable[[Array], Any], start: Array, bounds: Array) -> tuple[Array, float]:
        """Best point found within the bounds, and its objective."""
        found = minimize(objective, start, method="L-BFGS-B", jac=True, bounds=bounds, options={"maxfun": self.most})
        self.evaluations += found.nfev
        return found.x, found.fun


def tuned_kernel(data: TrainingSet, gflop: float, largest_nugget: float) -> tuple[Any, int]:
    """The kernel of greatest likelihood on the largest subset that the budget allows, and the subset's size.

    On the smallest subset the likelihood has several maxima: it is climbed from the STARTS most likely isotropic
    kernels of a coarse grid, which finds better ones than random restarts. Each larger subset starts from the answer
    before; each subset gets half of what is left of the budget.
    """
    gaussian_process = _sklearn()
    mean, deviation = data.load_scale
    x, y = (data.poses - data.centre) / data.spread, (data.loads - mean) / deviation
    count, ascents = min(SMALLEST_SUBSET, len(data)), STARTS

    def fitted(kernel: Any, ascent: Ascent | None) -> Any:
        process = gaussian_process.GaussianProcessRegressor(kernel, optimizer=ascent)
        with warnings.catch_warnings():
            # A length scale or nugget at its bound is an answer here (a load may ignore a pose parameter).
            warnings.simplefilter("ignore")
            return process.fit(x[:count], y[:count])

    def most_likely(processes: list[Any]) -> list[Any]:
        ordered = sorted(processes, key=lambda p: -p.log_marginal_likelihood_value_)
        return [process.kernel_ for process in ordered]

    grid = _isotropic_kernels(largest_nugget)
    starts, left = most_likely([fitted(kernel, None) for kernel in grid]), gflop - len(grid) * fit_gflop(count)
    while True:
        ascent = Ascent(max(1, int(0.5 * left / ascents / likelihood_gflop(count))))
        starts = most_likely([fitted(kernel, ascent) for kernel in starts[:ascents]])
        left, ascents = left - ascent.evaluations * likelihood_gflop(count), 1
        larger = min(2 * count, len(data))
        if larger == count or FEWEST_EVALUATIONS * likelihood_gflop(larger) > 0.5 * left:
            return starts[0], count
        count = larger


def _isotropic_kernels(largest_nugget: float) -> list[Any]:
    kernels = _sklearn().kernels
    nugget = kernels.WhiteKernel(min(1e-2, largest_nugget), (1e-10, largest_nugget))
    return [
        kernels.ConstantKernel(constant, (1e-2, 1e6)) * kernels.Matern(np.full(6, length), (1e-1, 1e3), nu=2.5) + nugget
        for constant in (1.0, 30.0, 1000.0)
        for length in (0.3, 1.0, 3.0, 10.0, 30.0)
    ]


def best_kernel(data: TrainingSet, gflop: float) -> tuple[Any, int]:
    """A kernel that interpolates and one that regresses, both tuned; the one that predicts TRIAL_POINTS others better.

    The likelihood of few points in six dimensions often takes what it cannot resolve for noise, though the samples
    have next to none.
    """
    count = min(TRIAL_POINTS, len(data) // 2)
    others, deviation = slice(count, 2 * count), data.load_scale[1]
    tuned = [tuned_kernel(data, gflop / len(LARGEST_NUGGETS), nugget) for nugget in LARGEST_NUGGETS]
    errors = []
    for kernel, _ in tuned:
        try:
            off = Kriging(data, count, kernel)(data.poses[others]) - data.loads[others]
        except np.linalg.LinAlgError:  # too ill-conditioned to factorise
            errors.append(np.inf)
            continue
        errors.append(float(np.mean((off / deviation) ** 2)))
    return tuned[int(np.argmin(errors))]


def kriging(data: TrainingSet, gflop: float) -> Iterator[Candidate]:
    """Gaussian processes on 1000, 2000, ... points: half of the budget for the kernel, half for the points."""
    began = time.process_time()
    kernel, subset = best_kernel(data, gflop / 2.0)
    tuning = time.process_time() - began

    def fit(count: int) -> Candidate:
        start = time.process_time()
        model = Kriging(data, count, kernel)
        return Candidate(
            f"{FAMILY} {count}",
            FAMILY,
            model,
            time_value=single_calls(model.one),
            time_jacobian=single_calls(model.jacobian_one),
            time_batch=one_call(model),
            samples=count,
            training_seconds=tuning + time.process_time() - start,
            parameters=model.parameter_count,
            remark=(
                f"condition number {model.condition:.1e}, nugget {kernel.k2.noise_level:.1e}, kernel tuned on {subset} "
                f"points{data.limits.remark}"
            ),
        )

    yield from grow(
        fit,
        family=FAMILY,
        points=len(data),
        gflop=gflop / 2.0,
        gflop_of=fit_gflop,
        bytes_per_pair=BYTES_PER_PAIR,
    )
