"""The networks of a patch's parts in training together (`network.PartsRegression`).

Fitted alone, each part meets its own root load, and the errors of its neighbours add up: what one bears too much the
others do not bear less. Together they are fitted on what the patch carries. JᵀJ is then as wide as all of them; its
preconditioner holds the blocks of the single parts alone, for conjugate gradients see the rest.

Where a root load weighs nothing and is below 0 it has no derivatives.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from casadi_contact.conventions import Array
from casadi_contact.network import Network, PartsRegression
from casadi_contact.training.arrays import NumpyArrays
from casadi_contact.training.drawn_rows import draw_rows
from casadi_contact.training.mlp import ROWS_PER_PARAMETER
from casadi_contact.training.parts_compiled import compiled_parts
from casadi_contact.training.parts_numpy import NumpyParts
from casadi_contact.training.weights import flatten, unflatten


class BlockArrays(NumpyArrays):
    """Arrays whose JᵀJ is a list of blocks along its diagonal. Its factors precondition: they are found in double
    precision and kept in single, which halves what a solve reads."""

    def diagonal(self, gram: Any) -> Any:
        """The diagonals of all blocks."""
        return np.concatenate([np.diagonal(block) for block in gram])

    def factor(self, gram: Any, shift: float) -> Any | None:
        """A Cholesky factor of each block; None where one has none."""
        factors = []
        for block in gram:
            factor = NumpyArrays.factor(self, block, shift)
            if factor is None:
                return None
            factors.append(factor)
        unit = float(np.mean([np.diagonal(block).mean() for block, _ in factors]))  # near 1 in single precision
        return unit, [
            (np.divide(block, unit, dtype=np.float32, casting="same_kind"), lower) for block, lower in factors
        ]

    def solve(self, factor: Any, right: Any) -> Any:
        """Block by block."""
        unit, blocks = factor
        size = float(np.abs(right).max()) or 1.0
        parts = np.split((right / size).astype(np.float32), np.cumsum([len(block) for block, _ in blocks])[:-1])
        solved = [NumpyArrays.solve(self, *part) for part in zip(blocks, parts, strict=True)]
        return (size / unit**2) * np.concatenate(solved).astype(np.float64)


class PartsMlp:
    """Residuals of all parts' networks on the rows of a regression, with the methods of an `Mlp` that
    `LevenbergMarquardt` asks for. Parameters are those of one network after the other.

    compiled: False for NumPy in any case. ``flop`` counts as `Mlp` does, by the rows that have derivatives.
    """

    def __init__(
        self,
        networks: Sequence[Network],
        regression: PartsRegression,
        chunk_rows: int = 2000,
        *,
        compiled: bool = True,
    ) -> None:
        self.arrays, self.xp = BlockArrays(), np
        self._regression, self.rows = regression, len(regression.weights)
        self._sizes = np.array([network.parameter_count for network in networks])
        self.parameter_count, self.block_parameters = int(self._sizes.sum()), int(self._sizes.max())
        self.flop = 0
        parts = compiled_parts(networks, regression) if compiled else None
        self._parts = parts or NumpyParts(networks, regression, chunk_rows)
        self._squares = np.einsum("nkj,nkj->nk", regression.shares, regression.shares)

    def split(self, parameters: Array) -> list[Array]:
        """Those of each part."""
        return np.split(parameters, np.cumsum(self._sizes)[:-1])

    def _count(self, products: int) -> None:
        """Count products of one operation pair for each parameter of a part and row that matters to it."""
        self.flop += 2 * products * self._parameters_that_matter

    def evaluate(self, parameters: Array, *, solve_output: bool = True) -> tuple[Array, float]:
        """The parameters as given and ½Σr² there: no output layer alone is a linear problem."""
        self._tried = self._parts.roots(self.split(parameters))
        self._tried_residuals = self._regression.residuals(self._tried)
        self.flop += 2 * self.rows * self.parameter_count
        return parameters, 0.5 * float(np.sum(self._tried_residuals**2))

    def accept(self, parameters: Array) -> Array:
        """Make the parameters that `evaluate` saw last current; returns the gradient Jᵀr."""
        of = self._regression
        self._matters = (of.weights != 0.0) | (self._tried > 0.0)
        self._parameters_that_matter = int(self._matters.sum(axis=0) @ self._sizes)
        slopes = 2.0 * np.maximum(self._tried, 0.0)
        self._effects = np.sqrt(slopes**2 * self._squares + of.weights**2)
        of_patch, of_roots = np.split(self._tried_residuals, [of.wanted.shape[1]], axis=1)
        changes = slopes * np.einsum("nj,nkj->nk", of_patch, of.shares) + of.weights * of_roots
        self._count(2)
        return np.concatenate(self._parts.move(self.split(parameters), self._matters, slopes, changes))

    def gram_product(self, direction: Array) -> Array:
        """JᵀJ·v (parameters,), of many rows in single precision."""
        self._count(2)
        return np.concatenate(self._parts.gram_product(self.split(direction)))

    def gram(self) -> list[Array]:
        """The blocks of JᵀJ (upper triangles at least), one for each part."""
        return self._blocks(lambda effects, size: (np.arange(len(effects)), np.ones(len(effects))))

    def drawn_gram(self, seed: Sequence[int]) -> list[Array]:
        """The blocks, of rows drawn for each part by what its root load does to their residuals."""
        return self._blocks(lambda effects, size: draw_rows(effects, int(ROWS_PER_PARAMETER * size), seed))

    def _blocks(self, drawn: Callable[[Array, int], tuple[np.ndarray, Array]]) -> list[Array]:
        blocks = []
        for k, (matters, size) in enumerate(zip(self._matters.T, self._sizes.tolist(), strict=True)):
            rows = np.flatnonzero(matters)
            effects = self._effects[rows, k]
            chosen, scales = drawn(effects, size)
            blocks.append(self._parts.gram(k, rows[chosen], scales * effects[chosen]))
            self.flop += len(chosen) * size**2
        return blocks


def flatten_parts(networks: Sequence[Network]) -> Array:
    """Weights and biases of all parts as one vector."""
    return np.concatenate([flatten(network) for network in networks])


def unflatten_parts(parameters: Array, like: Sequence[Network]) -> list[Network]:
    """The parts' networks with these parameters, of the sizes and scales of ``like``."""
    ends = np.cumsum([network.parameter_count for network in like])[:-1]
    return [unflatten(own, network) for own, network in zip(np.split(parameters, ends), like, strict=True)]
