"""Levenberg-Marquardt of several networks of one shape in lockstep: `levenberg_marquardt` on batches of matrices.

Every member keeps its own damping, preconditioner and step, and takes the decisions that it takes alone; one that is
done with a part of an iteration waits for the others. Its network so differs from one trained alone by rounding, which
training amplifies, and not in how good it is.

The preconditioner is kept as W = L⁻¹ with L·Lᵀ = JᵀJ + λ·d·I: z = Wᵀ·(W·r) is two products of a matrix and a vector,
where the substitutions of a GPU would go row by row.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from casadi_contact.conventions import Array
from casadi_contact.network import Network
from casadi_contact.training import levenberg_marquardt as alone
from casadi_contact.training.arrays import TorchArrays
from casadi_contact.training.batch_mlp import BatchMlp, Columns
from casadi_contact.training.drawn_rows import draw_rows
from casadi_contact.training.mlp import ROWS_PER_PARAMETER


@dataclass(eq=False)
class Member:
    """A network of a batch and where its optimiser stands after an iteration, as `search.Search` reads it.

    validation: rows that the network is judged by, and not trained on. Others: see `levenberg_marquardt.State`.
    """

    like: Network
    training: Columns
    validation: Columns
    seed: int
    parameters: Array
    damping: float = alone.FIRST_DAMPING
    damping_growth: float = 2.0
    iterations: int = 0
    loss: float = field(default=np.inf, init=False)
    validation_rms: float = field(default=np.nan, init=False)
    flop: int = field(default=0, init=False)
    exhausted: bool = field(default=False, init=False)

    @property
    def rms(self) -> float:
        """√(Σr²/n) over the training rows."""
        return float(np.sqrt(2.0 * self.loss / len(self.training[1])))

    @property
    def shape(self) -> tuple[int, tuple[int, ...], str]:
        """What networks of a batch share: inputs, neurons per hidden layer, activation."""
        return len(self.like.input_shift), self.like.hidden, self.like.activation

    def state(self) -> alone.State:
        """What a later batch, or a `LevenbergMarquardt` alone, continues from."""
        return alone.State(self.parameters, self.damping, self.damping_growth, self.iterations)


class Batch:
    """Minimises ½Σr² of every member, step by step; begins, or goes on, where its members stand."""

    def __init__(self, members: Sequence[Member], arrays: TorchArrays, chunk_rows: int) -> None:
        self.members, self.arrays, self.xp = list(members), arrays, arrays.xp
        likes, count = [m.like for m in members], len(members)
        self._mlp = BatchMlp(likes, [m.training for m in members], arrays, chunk_rows)
        self._validation = BatchMlp(likes, [m.validation for m in members], arrays, chunk_rows)
        self._size = self._mlp.parameter_count
        self._gram, self._root = (arrays.zeros(count, self._size, self._size) for _ in range(2))
        self._unit = np.ones(count)
        self._losses, self._counted = np.zeros(count), np.zeros(count, dtype=np.int64)
        self._begin(np.stack([m.parameters for m in members]), np.array([m.iterations == 0 for m in members]))
        self._tell()

    def _begin(self, parameters: Array, solve_output: np.ndarray) -> None:
        """Make parameters current, with the output layers solved where asked, which counts as work of a start."""
        given = self.arrays.array(parameters)
        solved, losses = self._mlp.evaluate(given, solve_output)
        self._losses = np.where(solve_output, losses, self._mlp.losses(given))
        if not np.isfinite(self._losses).all():
            raise ValueError("the residuals at the starting weights are not finite numbers, expected finite data")
        self._parameters = self._where(solve_output, solved, given)
        self._gradient = self._mlp.accept(self._parameters, solve_output)
        for member, values in zip(self.members, self.arrays.numpy(self._parameters), strict=True):
            member.parameters = values.copy()

    def step(self) -> None:
        """One iteration of every member; sets ``exhausted`` of those that no damping improves any more."""
        members = self.members
        live = self.arrays.numpy(self.xp.abs(self._gradient).amax(1)) > 0.0
        self._assemble(np.flatnonzero(live).tolist())
        live &= self._precondition(np.flatnonzero(live).tolist())
        x, predicted = self._solve(live)
        ratios = self._try(x, predicted, live)
        for member, alive, ratio in zip(members, live, ratios, strict=True):
            if alive:
                member.damping, member.damping_growth = alone.next_damping(member.damping, member.damping_growth, ratio)
            member.exhausted = not alive or member.damping > alone.MAX_DAMPING
        self._judge()
        self._tell()

    # --- parts of an iteration

    def _assemble(self, members: Sequence[int]) -> None:
        """Assemble the preconditioners of these members at their current parameters."""
        if not len(members):
            return
        rows, scales = [], []
        wanted = int(ROWS_PER_PARAMETER * self._size)
        for k in members:
            m = self.members[k]
            chosen, scale = draw_rows(self._mlp.draw_weights(k), wanted, [m.seed, m.iterations])
            rows.append(chosen)
            scales.append(scale)
            m.iterations += 1
        grams = self._mlp.gram(members, rows, scales)
        self._gram[list(members)] = grams
        means = self.arrays.numpy(self.xp.einsum("mii->m", grams)) / self._size
        self._unit[list(members)] = np.where(means == 0.0, 1.0, means)

    def _precondition(self, members: Sequence[int]) -> np.ndarray:
        """Factors for the dampings of these members; rounding may ask for more. Returns False (m,) for those that have
        none."""
        have = np.ones(len(self.members), dtype=bool)
        wanting = members
        while len(wanting):
            failed = self._factor(wanting)
            wanting = []
            for k in failed:
                have[k] = self.members[k].damping <= alone.MAX_DAMPING
                if have[k]:
                    self.members[k].damping *= 10.0
                    wanting.append(k)
        return have

    def _factor(self, members: Sequence[int]) -> list[int]:
        """W of these members at their dampings; returns those whose matrix is not positive definite."""
        index = list(members)
        shift = self.arrays.array(np.array([self.members[k].damping for k in index]) * self._unit[index])
        unit = self.arrays.identity(self._size)
        factor, failed = self.xp.linalg.cholesky_ex(self._gram[index] + shift[:, None, None] * unit)
        self._root[index] = self.xp.linalg.solve_triangular(factor, unit.expand_as(factor), upper=False)
        for k in index:
            self.members[k].flop += self._size**3 // 3
        bad = self.arrays.numpy(failed) != 0
        return [k for k, none in zip(index, bad, strict=True) if none]

    def _solve(self, live: np.ndarray) -> tuple[Any, Array]:
        """x ≈ -(JᵀJ + λ·d·I)⁻¹·Jᵀr of the live members, and the reduction of ½Σr² that their models predict (m,)."""
        shift = self.arrays.array(np.array([m.damping for m in self.members]) * self._unit)
        x, residual = self.xp.zeros_like(self._gradient), -self._gradient
        direction = self._preconditioned(residual)
        rz, gain, going = _dot(residual, direction), self.arrays.zeros(len(live)), live
        for count in range(1, alone.MAX_PRODUCTS + 1):
            product = self._mlp.gram_product(direction, going) + shift[:, None] * direction
            curvature = _dot(direction, product)
            going = going & self.arrays.numpy((curvature > 0.0) & (rz > 0.0))
            if not going.any():
                break
            length = rz / curvature
            x = self._where(going, x + length[:, None] * direction, x)
            residual = self._where(going, residual - length[:, None] * product, residual)
            gain = gain + self._where(going, length * rz, 0.0 * gain)
            for k in np.flatnonzero(going):
                self.members[k].flop += 2 * self._size**2
            if count > 1:
                going = going & self.arrays.numpy(length * rz * count >= alone.ACCURACY * gain)
                if not going.any():
                    break
            z = self._preconditioned(residual)
            rz, before = _dot(residual, z), rz
            direction = self._where(going, z + (rz / before)[:, None] * direction, z)
        predicted = -0.5 * _dot(self._gradient, x) + 0.5 * _dot(x, residual) + 0.5 * shift * _dot(x, x)
        return x, self.arrays.numpy(predicted)

    def _preconditioned(self, right: Any) -> Any:
        return (self._root.mT @ (self._root @ right[..., None]))[..., 0]

    def _try(self, x: Any, predicted: Array, live: np.ndarray) -> Array:
        """Take the step x, or a shorter one, where it reduces the loss; returns what the whole step reduced it by, as a
        share of what was predicted (m,), minus infinity where that says nothing."""
        start, length, chosen = self._losses, 1.0, self._parameters
        ratios, fell = np.full(len(live), -np.inf), np.zeros(len(live), dtype=bool)
        for trial in range(alone.TRIALS):
            trying = live & ~fell
            if not trying.any():
                break
            tried, losses = self._mlp.evaluate(self._parameters + length * x, trying)
            if trial == 0:
                known = trying & (predicted > 0.0) & np.isfinite(losses)
                ratios[known] = (start - losses)[known] / predicted[known]
            better = trying & (losses < start)
            chosen, self._losses = self._where(better, tried, chosen), np.where(better, losses, self._losses)
            fell |= better
            length *= alone.SHORTER
        if fell.any():
            self._parameters, self._gradient = chosen, self._mlp.accept(chosen, fell)
        return ratios

    # --- what the members are told

    def _where(self, mask: np.ndarray, yes: Any, no: Any) -> Any:
        chosen = self.arrays.mask(mask)
        return self.xp.where(chosen.reshape(-1, *(1,) * (yes.ndim - 1)), yes, no)

    def _tell(self) -> None:
        """Parameters, losses and work so far, to the members."""
        parameters = self.arrays.numpy(self._parameters)
        flop = self._mlp.flop + self._validation.flop
        for member, values, loss, done in zip(
            self.members, parameters, self._losses, flop - self._counted, strict=True
        ):
            member.parameters, member.loss = values.copy(), float(loss)
            member.flop += int(done)
        self._counted = flop

    def _judge(self) -> None:
        """Errors on the validation rows, to the members."""
        losses, rows = self._validation.losses(self._parameters), self._validation.rows
        self._validation.count(1, rows > 0)
        for member, loss, count in zip(self.members, losses, rows, strict=True):
            member.validation_rms = float(np.sqrt(2.0 * loss / count)) if count else np.nan


def _dot(a: Any, b: Any) -> Any:
    """Σ a·b (m,) of (m, parameters)."""
    return (a * b).sum(1)
