"""The networks of a patch's parts in training together (`network.PartsRegression`).

Fitted alone, each part meets its own root load, and the errors of its neighbours add up: what one bears too much the
others do not bear less. Together they are fitted on what the patch carries. JᵀJ is then as wide as all of them; its
preconditioner holds the blocks of the single parts alone, for conjugate gradients see the rest.

Most rows are far from contact for most parts. Where a root load weighs nothing and is below 0 it has no derivatives:
such rows are only looked at, whether a load is predicted there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
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


@dataclass
class _Piece:
    """Some rows of one part, by their numbers; matters: whether they have derivatives."""

    part: int
    rows: np.ndarray
    mlp: Mlp
    weighted: bool
    matters: bool = True


class PartsMlp:
    """Residuals of all parts' networks on the rows of a regression, with the methods of an `Mlp` that
    `LevenbergMarquardt` asks for. Parameters are those of one network after the other."""

    def __init__(
        self, networks: Sequence[Network], regression: PartsRegression, rows: np.ndarray, chunk_rows: int = 2000
    ) -> None:
        self.arrays, self.xp = BlockArrays(), np
        self._regression, self._rows, self.rows = regression, rows, len(rows)
        self._shares, self._weights = regression.shares[rows], regression.weights[rows]
        self._tried = np.empty(self._weights.shape)
        self._ends = np.cumsum([network.parameter_count for network in networks])
        self.parameter_count = int(self._ends[-1])
        self._pieces: list[_Piece] = []
        for k, (network, weights) in enumerate(zip(networks, self._weights.T, strict=True)):
            weighted, others = np.flatnonzero(weights), np.flatnonzero(weights == 0.0)
            for own in (weighted, *(others[i : i + chunk_rows] for i in range(0, len(others), chunk_rows))):
                inputs, nothing, one = regression.inputs[k][rows[own]], np.zeros(len(own)), np.ones(len(own))
                mlp = Mlp(network, inputs, nothing, one, 0.0, self.arrays, chunk_rows)
                self._pieces.append(_Piece(k, own, mlp, own is weighted))

    @property
    def block_parameters(self) -> int:
        """Parameters of a part, the largest."""
        return int(np.diff(self._ends, prepend=0).max())

    @property
    def flop(self) -> int:
        """Floating-point operations of all parts, see `Mlp`."""
        return sum(piece.mlp.flop for piece in self._pieces)

    def split(self, parameters: Array) -> list[Array]:
        """Those of each part."""
        return np.split(parameters, self._ends[:-1])

    def evaluate(self, parameters: Array, *, solve_output: bool = True) -> tuple[Array, float]:
        """The parameters as given and ½Σr² there: no output layer alone is a linear problem."""
        own = self.split(parameters)
        for piece in self._pieces:
            piece.mlp.evaluate(own[piece.part], solve_output=False)
            self._tried[piece.rows, piece.part] = piece.mlp.like.output_scale * piece.mlp.tried_outputs
        self._tried_residuals = self._regression.residuals(self._tried, self._rows)
        return parameters, 0.5 * float(np.sum(self._tried_residuals**2))

    def accept(self, parameters: Array) -> Array:
        """Make the parameters that `evaluate` saw last current; returns the gradient Jᵀr."""
        own = self.split(parameters)
        for piece in self._pieces:
            piece.matters = piece.weighted or bool((self._tried[piece.rows, piece.part] > 0.0).any())
            if piece.matters:
                piece.mlp.move(own[piece.part])
        self._slopes = 2.0 * np.maximum(self._tried, 0.0)[:, :, None] * self._shares
        self._effects = np.sqrt((self._slopes**2).sum(axis=2) + self._weights**2)
        return self._vjp(self._tried_residuals)

    @property
    def _mattering(self) -> list[_Piece]:
        return [piece for piece in self._pieces if piece.matters]

    def _jvp(self, direction: Array, *, rough: bool = False) -> Array:
        """J·v (rows, residuals)."""
        roots, own = np.zeros(self._tried.shape), self.split(direction)
        for piece in self._mattering:
            roots[piece.rows, piece.part] = piece.mlp.jvp(own[piece.part], rough=rough)
        return np.concatenate([np.einsum("nk,nkj->nj", roots, self._slopes), self._weights * roots], axis=1)

    def _vjp(self, rows: Array, *, rough: bool = False) -> Array:
        """Jᵀ·u (parameters,)."""
        wrenches = self._slopes.shape[2]
        roots = np.einsum("nj,nkj->kn", rows[:, :wrenches], self._slopes) + (self._weights * rows[:, wrenches:]).T
        total = np.zeros(self.parameter_count)
        own = self.split(total)
        for piece in self._mattering:
            own[piece.part] += piece.mlp.vjp(roots[piece.part, piece.rows], rough=rough)
        return total

    def gram_product(self, direction: Array) -> Array:
        """JᵀJ·v (parameters,), of many rows in single precision."""
        return self._vjp(self._jvp(direction, rough=True), rough=True)

    def gram(self) -> list[Array]:
        """The blocks of JᵀJ, one for each part, as `Mlp.gram`."""
        return self._blocks(lambda mlp, effects: mlp.gram(None, effects))

    def drawn_gram(self, seed: Sequence[int]) -> list[Array]:
        """The blocks, of rows drawn for each part by what its root load does to their residuals."""

        def drawn(mlp: Mlp, effects: Array) -> Array:
            rows, scales = draw_rows(effects, mlp.rows_to_draw, seed)
            return np.asarray(mlp.gram(rows, scales * effects[rows]))

        return self._blocks(drawn)

    def _blocks(self, gram_of: Callable[[Mlp, Array], Array]) -> list[Array]:
        blocks: dict[int, Array] = {}
        for piece in self._mattering:
            block = gram_of(piece.mlp, self._effects[piece.rows, piece.part])
            blocks[piece.part] = block + blocks[piece.part] if piece.part in blocks else block
        return list(blocks.values())


def flatten_parts(networks: Sequence[Network]) -> Array:
    """Weights and biases of all parts as one vector."""
    return np.concatenate([flatten(network) for network in networks])


def unflatten_parts(parameters: Array, like: Sequence[Network]) -> list[Network]:
    """The parts' networks with these parameters, of the sizes and scales of ``like``."""
    ends = np.cumsum([network.parameter_count for network in like])[:-1]
    return [unflatten(own, network) for own, network in zip(np.split(parameters, ends), like, strict=True)]
