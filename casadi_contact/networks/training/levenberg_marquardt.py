"""Batch Levenberg-Marquardt, its normal equations solved by conjugate gradients on all rows.

Every iteration solves (JᵀJ + λ·d·I)·x = -Jᵀr over all rows (d the mean diagonal of JᵀJ), but does not assemble that
JᵀJ: products JᵀJ·v cost about a hundredth of it. The preconditioner is a JᵀJ assembled from a weighted random
subset of a few rows per parameter, anew for each iteration (Blendenpik, Avron et al. 2010, has the same idea for
linear problems): two or three products then make a step that is exact enough.

λ follows Nielsen (1999): reduced by up to 3 where the model predicted the loss well, doubled at a growing pace where
not. A step that does not reduce the loss is shortened first, since evaluating one costs less than a product.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg

from casadi_contact.core.conventions import Array
from casadi_contact.networks.training.mlp import Mlp, cholesky

_MAX_PRODUCTS = 60  # of conjugate gradients
_SHORTEN, _EVALUATIONS = 0.4, 4  # a step that does not reduce the loss is multiplied by this, up to so many evaluations
_FIRST_DAMPING, _MIN_DAMPING, _MAX_DAMPING = 1e-2, 1e-15, 1e8  # λ; at the last the fit ends


@dataclass(frozen=True)
class State:
    """All that the next iteration depends on: what a checkpoint holds."""

    parameters: Array
    damping: float
    damping_growth: float
    iterations: int


class LevenbergMarquardt:
    """Minimises ½Σr² of an `Mlp` step by step; reproducible for a seed, and from a `State` at any iteration.

    accuracy: conjugate gradients end when a product adds less than this share of the mean gain so far.
    """

    def __init__(
        self, mlp: Mlp, parameters: Array, seed: int, state: State | None = None, accuracy: float = 0.1
    ) -> None:
        self.mlp, self._seed, self._accuracy = mlp, seed, accuracy
        self.damping, self._growth, self._iterations = _FIRST_DAMPING, 2.0, 0
        self.exhausted = False
        self._solver_flop = 0
        if state is not None and state.iterations:
            self.damping, self._growth, self._iterations = state.damping, state.damping_growth, state.iterations
        start = parameters if state is None else state.parameters
        self._parameters, self.loss = mlp.evaluate(np.ascontiguousarray(start), solve_output=not self._iterations)
        if not np.isfinite(self.loss):
            raise ValueError("the residuals at the starting weights are not finite numbers, expected finite data")
        self._gradient = mlp.accept(self._parameters)

    @property
    def parameters(self) -> Array:
        """Weights and biases (parameters,), see `weights`."""
        return self._parameters.copy()

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
        return State(self.parameters, self.damping, self._growth, self._iterations)

    def _precondition(self) -> Any | None:
        """A Cholesky factor of JᵀJ from some rows, damped until it is positive definite; None where that fails."""
        gram = self.mlp.drawn_gram([self._seed, self._iterations])
        self._iterations += 1
        self._unit = float(np.diagonal(gram).mean()) or 1.0
        while True:
            factor = cholesky(gram, self.damping * self._unit)
            self._solver_flop += self.mlp.parameter_count**3 // 3
            if factor is not None or self.damping > _MAX_DAMPING:
                return factor
            self.damping *= 10.0

    def _solve(self, factor: Any) -> tuple[Array, float]:
        """x ≈ -(JᵀJ + λ·d·I)⁻¹·Jᵀr, and the predicted reduction of ½Σr²; factor: of the preconditioner."""
        shift, x = self.damping * self._unit, np.zeros(self.mlp.parameter_count)
        residual = -self._gradient
        z = scipy.linalg.cho_solve(factor, residual, check_finite=False)
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
            gain += length * rz
            if count > 1 and length * rz * count < self._accuracy * gain:
                break
            z = scipy.linalg.cho_solve(factor, residual, check_finite=False)
            rz, before = float(residual @ z), rz
            direction = z + (rz / before) * direction
        # JᵀJ·x = -Jᵀr - residual - λ·d·x, so gᵀx + ½xᵀJᵀJx needs no further product.
        predicted = -0.5 * float(self._gradient @ x) + 0.5 * float(x @ residual) + 0.5 * shift * float(x @ x)
        return x, predicted

    def step(self) -> bool:
        """One iteration; True if the loss fell. Sets ``exhausted`` when no damping gives a lower loss any more."""
        factor = self._precondition() if float(np.abs(self._gradient).max()) > 0.0 else None
        if factor is None:
            self.exhausted = True
            return False
        x, predicted = self._solve(factor)
        start, length, ratio, fell = self.loss, 1.0, -np.inf, False
        for count in range(_EVALUATIONS):
            parameters, loss = self.mlp.evaluate(self._parameters + length * x)
            if count == 0 and predicted > 0.0 and np.isfinite(loss):
                ratio = (start - loss) / predicted
            fell = loss < start
            if fell:
                self._gradient = self.mlp.accept(parameters)
                self._parameters, self.loss = parameters, loss
                break
            length *= _SHORTEN
        if ratio > 0.0:
            self.damping *= max(1.0 / 3.0, 1.0 - (2.0 * min(ratio, 1.0) - 1.0) ** 3)
            self._growth = 2.0
        else:
            self.damping, self._growth = self.damping * self._growth, min(2.0 * self._growth, 16.0)
        self.damping = max(self.damping, _MIN_DAMPING)
        self.exhausted = self.damping > _MAX_DAMPING
        return fell
