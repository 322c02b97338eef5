"""The networks of a patch's parts in training together (`network.PartsRegression`).

Fitted alone, each part meets its own root load, and the errors of its neighbours add up: what one bears too much the
others do not bear less. Together they are fitted on what the patch carries. JᵀJ is then as wide as all of them; its
preconditioner holds the blocks of the single parts alone, for conjugate gradients see the rest. A root load of weight 0
is taken as its target, and its network is not asked: most rows are far from contact for most parts.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from casadi_contact.conventions import Array
from casadi_contact.network import Network, PartsRegression
from casadi_contact.training.arrays import NumpyArrays
from casadi_contact.training.drawn_rows import draw_rows
from casadi_contact.training.mlp import Mlp
from casadi_contact.training.weights import flatten, unflatten


class BlockArrays(NumpyArrays):
    """Arrays whose JᵀJ is a list of blocks along its diagonal."""

    def diagonal(self, gram: Any) -> Any:
        """The diagonals of all blocks."""
        return np.concatenate([np.diagonal(block) for block in gram])

    def factor(self, gram: Any, shift: float) -> Any | None:
        """A Cholesky factor of each block; None where one has none."""
        factors = [NumpyArrays.factor(self, block, shift) for block in gram]
        return None if any(factor is None for factor in factors) else factors

    def solve(self, factor: Any, right: Any) -> Any:
        """Block by block."""
        ends = np.cumsum([len(block) for block, _ in factor])[:-1]
        parts = zip(factor, np.split(right, ends), strict=True)
        return np.concatenate([NumpyArrays.solve(self, *part) for part in parts])


class PartsMlp:
    """Residuals of all parts' networks on the rows of a regression, with the methods of an `Mlp` that
    `LevenbergMarquardt` asks for. Parameters are those of one network after the other."""

    def __init__(
        self, networks: Sequence[Network], regression: PartsRegression, rows: np.ndarray, chunk_rows: int = 2000
    ) -> None:
        self.arrays, self.xp = BlockArrays(), np
        self._regression, self._rows, self.rows = regression, rows, len(rows)
        self._shares, self._weights = regression.shares[rows], regression.weights[rows]
        self._tried = regression.targets[rows]
        self._asked = [np.flatnonzero(weights) for weights in self._weights.T]
        self._parts = [
            Mlp(network, inputs[rows[asked]], np.zeros(len(asked)), np.ones(len(asked)), 0.0, self.arrays, chunk_rows)
            for network, inputs, asked in zip(networks, regression.inputs, self._asked, strict=True)
        ]
        self._ends = np.cumsum([part.parameter_count for part in self._parts])
        self.parameter_count = int(self._ends[-1])

    @property
    def block_parameters(self) -> int:
        """Parameters of a part, the largest."""
        return max(part.parameter_count for part in self._parts)

    @property
    def flop(self) -> int:
        """Floating-point operations of all parts, see `Mlp`."""
        return sum(part.flop for part in self._parts)

    def split(self, parameters: Array) -> list[Array]:
        """Those of each part."""
        return np.split(parameters, self._ends[:-1])

    def evaluate(self, parameters: Array, *, solve_output: bool = True) -> tuple[Array, float]:
        """The parameters as given and ½Σr² there: no output layer alone is a linear problem."""
        for k, (part, own) in enumerate(zip(self._parts, self.split(parameters), strict=True)):
            part.evaluate(own, solve_output=False)
            self._tried[self._asked[k], k] = part.like.output_scale * part.tried_outputs
        self._tried_residuals = self._regression.residuals(self._tried, self._rows)
        return parameters, 0.5 * float(np.sum(self._tried_residuals**2))

    def accept(self, parameters: Array) -> Array:
        """Make the parameters that `evaluate` saw last current; returns the gradient Jᵀr."""
        for part, own in zip(self._parts, self.split(parameters), strict=True):
            part.move(own)
        self._slopes = 2.0 * np.maximum(self._tried, 0.0)[:, :, None] * self._shares
        effects = np.sqrt((self._slopes**2).sum(axis=2) + self._weights**2)
        self._effects = [effects[asked, k] for k, asked in enumerate(self._asked)]
        return self._vjp(self._tried_residuals)

    def _jvp(self, direction: Array, *, rough: bool = False) -> Array:
        """J·v (rows, residuals)."""
        roots = np.zeros(self._tried.shape)
        for k, (part, own) in enumerate(zip(self._parts, self.split(direction), strict=True)):
            roots[self._asked[k], k] = part.jvp(own, rough=rough)
        return np.concatenate([np.einsum("nk,nkj->nj", roots, self._slopes), self._weights * roots], axis=1)

    def _vjp(self, rows: Array, *, rough: bool = False) -> Array:
        """Jᵀ·u (parameters,)."""
        wrenches = self._slopes.shape[2]
        roots = np.einsum("nj,nkj->kn", rows[:, :wrenches], self._slopes) + (self._weights * rows[:, wrenches:]).T
        parts = zip(self._parts, roots, self._asked, strict=True)
        return np.concatenate([part.vjp(own[asked], rough=rough) for part, own, asked in parts])

    def gram_product(self, direction: Array) -> Array:
        """JᵀJ·v (parameters,), of many rows in single precision."""
        return self._vjp(self._jvp(direction, rough=True), rough=True)

    def gram(self) -> list[Array]:
        """The blocks of JᵀJ, one for each part, as `Mlp.gram`."""
        return [part.gram(None, effect) for part, effect in zip(self._parts, self._effects, strict=True)]

    def drawn_gram(self, seed: Sequence[int]) -> list[Array]:
        """The blocks, of rows drawn for each part by what its root load does to their residuals."""
        blocks = []
        for k, (part, effect) in enumerate(zip(self._parts, self._effects, strict=True)):
            rows, scales = draw_rows(effect, part.rows_to_draw, [*seed, k])
            blocks.append(part.gram(rows, scales * effect[rows]))
        return blocks


def flatten_parts(networks: Sequence[Network]) -> Array:
    """Weights and biases of all parts as one vector."""
    return np.concatenate([flatten(network) for network in networks])


def unflatten_parts(parameters: Array, like: Sequence[Network]) -> list[Network]:
    """The parts' networks with these parameters, of the sizes and scales of ``like``."""
    ends = np.cumsum([network.parameter_count for network in like])[:-1]
    return [unflatten(own, network) for own, network in zip(np.split(parameters, ends), like, strict=True)]
