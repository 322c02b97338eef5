"""Batch Levenberg-Marquardt, its normal equations solved by conjugate gradients on all rows.

Every iteration solves (JᵀJ + λ·d·I)·x = -Jᵀr over all rows (d the mean diagonal of JᵀJ), but does not assemble that
JᵀJ: products JᵀJ·v cost about a hundredth of it. The preconditioner is a JᵀJ assembled from a weighted random
subset of a few rows per parameter, at parameters of some iterations ago, and assembled anew when the products spent
on it have cost as much as a few assemblies (Blendenpik, Avron et al. 2010, has the same idea for linear problems).
Steps are exact enough (eight or so products), at a fraction of the price: on 10k rows and a 24-24 network the error
falls about four times faster in time than with the full JᵀJ.

λ follows Nielsen (1999): reduced by up to 3 where the model foretold the loss well, doubled at a growing pace where
not. A step that does not reduce the loss is shortened first, since a trial costs less than one product.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from casadi_contact.conventions import Array
from casadi_contact.training.mlp import Mlp

_ROWS_PER_PARAMETER = 3.0
_ASSEMBLIES_WORTH = 1.5
_ACCURACY = 0.1  # conjugate gradients end when an iteration adds less than this share of the mean gain so far
_MAX_PRODUCTS = 60
_REFACTOR_RATIO = 3.0
_SHORTER = 0.4
_TRIALS = 4
_MIN_DAMPING, _MAX_DAMPING = 1e-15, 1e8


@dataclass(frozen=True)
class State:
    """All that the next iteration depends on: what a checkpoint holds."""

    parameters: Array
    damping: float
    damping_growth: float
    assembled_at: Array  # parameters at which the preconditioner was assembled
    assemblies: int
    products: int  # spent on the preconditioner since
    factored_damping: float  # λ at which it was factored, NaN if it is not


class LevenbergMarquardt:
    """Minimises ½Σr² of an `Mlp` step by step; reproducible for a seed, and from a `State` at any iteration."""

    def __init__(self, mlp: Mlp, parameters: Array, seed: int, state: State | None = None) -> None:
        self.mlp, self.xp, self._seed = mlp, mlp.xp, seed
        self.damping, self._growth = 1e-2, 2.0
        self._assemblies = self._products = 0
        self._factor: Any = None
        self._factored = np.nan
        self.exhausted = False
        self._solver_flop = 0
        if state is None:
            self._move_to(parameters, solve_output=True)
            self._assemble()
            return
        self._move_to(state.assembled_at, solve_output=False)
        self._assemblies = state.assemblies - 1
        self._assemble()
        self._products, self.damping, self._growth = state.products, state.damping, state.damping_growth
        if np.isfinite(state.factored_damping):
            self._factored = state.factored_damping
            self._factor = mlp.arrays.factor(self._gram, self._factored * self._unit)
        self._move_to(state.parameters, solve_output=False)

    def _move_to(self, parameters: Array, *, solve_output: bool) -> None:
        self._parameters, self.loss = self.mlp.evaluate(self.mlp.arrays.array(parameters), solve_output=solve_output)
        if not np.isfinite(self.loss):
            raise ValueError("the residuals at the starting weights are not finite numbers, expected finite data")
        self._gradient = self.mlp.accept(self._parameters)

    @property
    def parameters(self) -> Array:
        """Weights and biases (parameters,), see `mlp`."""
        return self.mlp.arrays.numpy(self._parameters).copy()

    @property
    def flop(self) -> int:
        """Floating-point operations so far: those of the `Mlp`, and of the factors and their solves."""
        return self.mlp.flop + self._solver_flop

    @property
    def rms(self) -> float:
        """√(Σr²/n) over the training rows."""
        return float(np.sqrt(2.0 * self.loss / self.mlp.rows))

    def state(self) -> State:
        """What a later `LevenbergMarquardt` continues from, bit for bit on one thread."""
        return State(
            self.parameters,
            self.damping,
            self._growth,
            self._assembled_at,
            self._assemblies,
            self._products,
            self._factored,
        )

    def _assemble(self) -> None:
        """Assemble the preconditioner at the current parameters: rows drawn with probability ∝ their weight, each
        scaled so that the expectation is JᵀJ of all rows."""
        rows, wanted = self.mlp.rows, int(_ROWS_PER_PARAMETER * self.mlp.parameter_count / self.mlp.per_row)
        weights = self.mlp.draw_weights
        if wanted < rows and weights.sum() > 0.0:
            chance = np.minimum(1.0, weights * (wanted / weights.sum()))
            drawn = np.flatnonzero(np.random.default_rng([self._seed, self._assemblies]).random(rows) < chance)
            self._gram = self.mlp.gram(drawn, 1.0 / np.sqrt(chance[drawn]))
        else:
            drawn = np.arange(rows)
            self._gram = self.mlp.gram()
        self._unit = float(self.mlp.arrays.diagonal(self._gram).mean()) or 1.0
        # A product costs about 4 floating-point operations per row and parameter at a third of the speed of JᵀJ.
        self._allowance = _ASSEMBLIES_WORTH * 0.1 * self.mlp.parameter_count * len(drawn) / rows
        self._assembled_at, self._assemblies, self._products = self.parameters, self._assemblies + 1, 0
        self._factor, self._factored = None, np.nan

    def _precondition(self) -> None:
        """A Cholesky factor for a damping near the present one; rounding may ask for more damping."""
        near = 1.0 / _REFACTOR_RATIO <= self._factored / self.damping <= _REFACTOR_RATIO
        if self._factor is not None and near:
            return
        while True:
            self._factor = self.mlp.arrays.factor(self._gram, self.damping * self._unit)
            self._factored = self.damping
            self._solver_flop += self.mlp.parameter_count**3 // 3
            if self._factor is not None or self.damping > _MAX_DAMPING:
                return
            self.damping *= 10.0

    def _solve(self) -> tuple[Any, float]:
        """x ≈ -(JᵀJ + λ·d·I)⁻¹·Jᵀr, and the reduction of ½Σr² that the linear model foretells."""
        arrays, shift = self.mlp.arrays, self.damping * self._unit
        x = arrays.zeros(self.mlp.parameter_count)
        residual = -self._gradient
        z = arrays.solve(self._factor, residual)
        direction, rz, gain = z, float(residual @ z), 0.0
        for count in range(1, _MAX_PRODUCTS + 1):
            product = self.mlp.gram_product(direction) + shift * direction
            curvature = float(direction @ product)
            if not (curvature > 0.0 and rz > 0.0):
                break
            self._solver_flop += 2 * self.mlp.parameter_count**2
            length = rz / curvature
            x = x + length * direction
            residual = residual - length * product
            self._products += 1
            gain += length * rz
            if count > 1 and length * rz * count < _ACCURACY * gain:
                break
            z = arrays.solve(self._factor, residual)
            rz, before = float(residual @ z), rz
            direction = z + (rz / before) * direction
        # JᵀJ·x = -Jᵀr - residual - λ·d·x, so gᵀx + ½xᵀJᵀJx needs no further product.
        foretold = -0.5 * float(self._gradient @ x) + 0.5 * float(x @ residual) + 0.5 * shift * float(x @ x)
        return x, foretold

    def step(self) -> bool:
        """One iteration; True if the loss fell. Sets ``exhausted`` when no damping gives a lower loss any more."""
        if float(self.xp.abs(self._gradient).max()) == 0.0:
            self.exhausted = True
            return False
        if self._products > self._allowance:
            self._assemble()
        self._precondition()
        if self._factor is None:
            self.exhausted = True
            return False
        x, foretold = self._solve()
        start, length, ratio, fell = self.loss, 1.0, -np.inf, False
        for trial in range(_TRIALS):
            tried, loss = self.mlp.evaluate(self._parameters + length * x)
            if trial == 0 and foretold > 0.0 and np.isfinite(loss):
                ratio = (start - loss) / foretold
            fell = loss < start
            if fell:
                self._gradient = self.mlp.accept(tried)
                self._parameters, self.loss = tried, loss
                break
            length *= _SHORTER
        if ratio > 0.0:
            self.damping *= max(1.0 / 3.0, 1.0 - (2.0 * min(ratio, 1.0) - 1.0) ** 3)
            self._growth = 2.0
        else:
            self.damping *= self._growth
            self._growth = min(2.0 * self._growth, 16.0)
        self.damping = max(self.damping, _MIN_DAMPING)
        self.exhausted = self.damping > _MAX_DAMPING
        return fell
