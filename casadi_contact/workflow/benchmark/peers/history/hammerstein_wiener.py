"""A Hammerstein-Wiener model: a linear filter between curves of single inputs and a curve of its output.

    u_t = Σ_i f_i(x_{i,t}),   w_t = a·w_{t-1} + (1 - a)·(b·u_t + (1 - b)·u_{t-1}),   F_t = g(w_t)

for each load, with piecewise linear f_i and g (as the usual toolboxes take them). The filter passes constants as they
are, so that gain belongs to the curves alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter

from casadi_contact.core.conventions import Array
from casadi_contact.workflow.benchmark.peers.history.cycles import Cycles
from casadi_contact.workflow.benchmark.peers.training_set import Limits

INPUT_KNOTS = 10
OUTPUT_KNOTS = 8
_RIDGE = 1e-3
_START_OF_POLE = 0.1

State = tuple[Array, Array]
"""u and w of one frame ago, (n, L) each."""


@dataclass(frozen=True)
class _Curves:
    """lowest, highest (6,): the range of each input; knots are spaced evenly on it, values go on straight beyond."""

    lowest: Array
    highest: Array

    def basis(self, poses: Array) -> Array:
        """Hat functions (..., 6·INPUT_KNOTS) of poses (..., 6): a curve's values are this times its knots' values."""
        share = (poses - self.lowest) / (self.highest - self.lowest) * (INPUT_KNOTS - 1)
        left = np.clip(np.floor(share), 0, INPUT_KNOTS - 2)
        part = (share - left)[..., None]
        knots = np.arange(INPUT_KNOTS)
        hats = np.where(knots == left[..., None], 1.0 - part, np.where(knots == left[..., None] + 1.0, part, 0.0))
        return np.reshape(hats, (*np.shape(poses)[:-1], 6 * INPUT_KNOTS))


def _hinges(w: Array) -> Array:
    """max(w - knot, 0) at even knots in [-2, 2] deviations of the load, (..., OUTPUT_KNOTS)."""
    return np.maximum(w[..., None] - np.linspace(-2.0, 2.0, OUTPUT_KNOTS), 0.0)


def _filtered(u: Array, pole: float, now: float) -> Array:
    """w of u (cycles, frames, ...), each cycle beginning at rest."""
    gain = 1.0 - pole
    rest = u[:, :1] * (gain * (1.0 - now) + pole)
    return np.asarray(lfilter([gain * now, gain * (1.0 - now)], [1.0, -pole], u, axis=1, zi=rest)[0])


class HammersteinWiener:
    """One filter with its curves for each load; parameters (L, 6·INPUT_KNOTS + 2 + OUTPUT_KNOTS)."""

    def __init__(self, curves: _Curves, parameters: Array, mean_loads: Array, spread: Array, limits: Limits) -> None:
        self._curves, self._mean, self._spread, self._limits = curves, mean_loads, spread, limits
        self._inputs, self._filter, self._heights = _split(parameters)
        self.parameter_count = parameters.size
        self.remark = f"{INPUT_KNOTS} knots an input, {OUTPUT_KNOTS} for the output, one filter for each load"

    def rest(self, poses: Array) -> State:
        """The filter passes constants as they are."""
        u = self._curves.basis(poses) @ self._inputs.T
        return u, u

    def advance(self, state: State, poses: Array) -> tuple[State, Array]:
        """u and w as the next state, and the loads (n, L)."""
        u, (u_before, w_before) = self._curves.basis(poses) @ self._inputs.T, state
        pole, now = self._filter.T
        w = pole * w_before + (1.0 - pole) * (now * u + (1.0 - now) * u_before)
        shares = w + np.einsum("nlk,lk->nl", _hinges(w), self._heights)
        return (u, w), self._limits.hold(self._mean + self._spread * shares)


def _split(parameters: Array) -> tuple[Array, Array, Array]:
    """Knots' values of the inputs, (pole, share of the present) with the pole inside of ±1, heights of the hinges."""
    knots = 6 * INPUT_KNOTS
    pole, now = np.tanh(parameters[..., knots]), parameters[..., knots + 1]
    return parameters[..., :knots], np.stack([pole, now], axis=-1), parameters[..., knots + 2 :]


def hammerstein_wiener(cycles: Cycles, gflop: float) -> HammersteinWiener:
    """Fitted load by load: additive curves by ridge regression, then all parameters by nonlinear least squares."""
    poses, loads = cycles.learned
    lowest, highest = poses.min(axis=(0, 1)), poses.max(axis=(0, 1))
    curves = _Curves(lowest, np.where(highest > lowest, highest, lowest + 1.0))
    basis = curves.basis(poses)
    targets = (loads - cycles.centre) / cycles.spread
    evaluations = _evaluations(gflop / targets.shape[2], basis)
    rows = [_fitted(basis, targets[..., k], evaluations) for k in range(targets.shape[2])]
    return HammersteinWiener(curves, np.stack(rows), cycles.centre, cycles.spread, cycles.limits)


def _evaluations(gflop: float, basis: Array) -> int:
    """How many steps of least squares the budget holds: each factors the residuals' Jacobian."""
    rows, parameters = basis.shape[0] * basis.shape[1], basis.shape[2] + 2 + OUTPUT_KNOTS
    return max(1, int(gflop * 1e9 / (2.0 * rows * parameters**2)))


def _fitted(basis: Array, target: Array, evaluations: int) -> Array:
    """Parameters for one load in deviations, target (cycles, frames)."""
    knots, flat = basis.shape[2], basis.reshape(-1, basis.shape[2])
    ridge = _RIDGE * len(flat) * np.eye(knots) / INPUT_KNOTS
    additive = np.linalg.solve(flat.T @ flat + ridge, flat.T @ target.ravel())
    scale = 1.0 / np.sqrt(target.size)
    # Curves add up, so that their heights are only known together, and hinges may lie where no load is.
    held = np.sqrt(_RIDGE / (knots + OUTPUT_KNOTS)) * np.delete(np.eye(knots + 2 + OUTPUT_KNOTS), [knots, knots + 1], 0)

    def residuals(parameters: Array) -> Array:
        inputs, (pole, now), heights = _split(parameters)
        w = _filtered(basis @ inputs, pole, now)
        errors = w + _hinges(w) @ heights - target
        return np.concatenate([errors.ravel() * scale, held @ (parameters - start)])

    def slopes(parameters: Array) -> Array:
        inputs, (pole, now), heights = _split(parameters)
        by_input, u = _filtered(basis, pole, now), basis @ inputs
        w = by_input @ inputs
        # w_t = a·w_{t-1} + v_t has the derivative ∂w_t/∂a = a·∂w_{t-1}/∂a + w_{t-1} + ∂v_t/∂a, a filter again.
        before, w_before = (np.concatenate([x[:, :1], x[:, :-1]], axis=1) for x in (u, w))
        by_pole = lfilter([1.0], [1.0, -pole], w_before - now * u - (1.0 - now) * before, axis=1) * (1.0 - pole**2)
        by_now = lfilter([1.0], [1.0, -pole], (1.0 - pole) * (u - before), axis=1)
        by_w = 1.0 + (_hinges(w) > 0.0) @ heights
        columns = [by_input, by_pole[..., None], by_now[..., None]]
        fitted = np.concatenate([by_w[..., None] * np.concatenate(columns, axis=2), _hinges(w)], axis=2)
        return np.vstack([fitted.reshape(target.size, -1) * scale, held])

    start = np.concatenate([additive, [_START_OF_POLE, 1.0], np.zeros(OUTPUT_KNOTS)])
    return np.asarray(least_squares(residuals, start, slopes, max_nfev=evaluations).x)
