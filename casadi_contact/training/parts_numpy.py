"""Networks of a patch's parts in training, in NumPy: what stands in for `parts_compiled` without a C compiler.

Most rows are far from contact for most parts. Rows that have no derivatives are only looked at, whether a load is
predicted there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from casadi_contact.conventions import Array
from casadi_contact.network import Network, PartsRegression
from casadi_contact.training.arrays import NumpyArrays
from casadi_contact.training.mlp import Mlp


@dataclass
class _Piece:
    """Some rows of one part, by their numbers; matters: whether they have derivatives."""

    part: int
    rows: np.ndarray
    mlp: Mlp
    matters: bool = True


class NumpyParts:
    """The parts' networks on the rows of a patch, with the methods of `CompiledParts`."""

    def __init__(self, networks: Sequence[Network], regression: PartsRegression, chunk_rows: int) -> None:
        self._shares, self._weights = regression.shares, regression.weights
        self._shape = self._weights.shape
        self._sizes = [network.parameter_count for network in networks]
        self._pieces: list[_Piece] = []
        for k, (network, x) in enumerate(zip(networks, regression.inputs, strict=True)):
            weighted = self._weights[:, k] != 0.0
            own, others = np.flatnonzero(weighted), np.flatnonzero(~weighted)
            for rows in (own, *(others[i : i + chunk_rows] for i in range(0, len(others), chunk_rows))):
                nothing, one = np.zeros(len(rows)), np.ones(len(rows))
                mlp = Mlp(network, x[rows], nothing, one, 0.0, NumpyArrays(), chunk_rows)
                self._pieces.append(_Piece(k, rows, mlp))

    def roots(self, parameters: Sequence[Array]) -> Array:
        """Root loads (n, K) at the parameters of each part."""
        found = np.empty(self._shape)
        for piece in self._pieces:
            piece.mlp.evaluate(parameters[piece.part], solve_output=False)
            found[piece.rows, piece.part] = piece.mlp.like.output_scale * piece.mlp.tried_outputs
        return found

    def move(self, parameters: Sequence[Array], matters: np.ndarray, slopes: Array, changes: Array) -> list[Array]:
        """Make the parameters that `roots` saw last current; otherwise as of `CompiledParts`."""
        self._slopes = slopes
        for piece in self._pieces:
            piece.matters = bool(matters[piece.rows, piece.part].any())
            if piece.matters:
                piece.mlp.move(parameters[piece.part])
        return self._by_parts(changes, rough=False)

    @property
    def _mattering(self) -> list[_Piece]:
        return [piece for piece in self._pieces if piece.matters]

    def _by_parts(self, changes: Array, *, rough: bool) -> list[Array]:
        """Jᵀ·changes of each part, of the changes (n, K) of root loads."""
        totals = [np.zeros(size) for size in self._sizes]
        for piece in self._mattering:
            totals[piece.part] += piece.mlp.vjp(changes[piece.rows, piece.part], rough=rough)
        return totals

    def gram_product(self, directions: Sequence[Array]) -> list[Array]:
        """JᵀJ·v of each part; of many rows in single precision."""
        roots = np.zeros(self._shape)
        for piece in self._mattering:
            roots[piece.rows, piece.part] = piece.mlp.jvp(directions[piece.part], rough=True)
        of_patch = np.einsum("nk,nkj->nj", self._slopes * roots, self._shares)
        back = self._slopes * np.einsum("nj,nkj->nk", of_patch, self._shares)
        return self._by_parts(back + self._weights**2 * roots, rough=True)

    def gram(self, number: int, rows: np.ndarray, scales: Array) -> Array:
        """JᵀJ of a part's root load on these ascending rows, which matter, each times its scale."""
        gram = np.zeros((self._sizes[number], self._sizes[number]))
        for piece in self._mattering:
            if piece.part == number:
                own = np.isin(rows, piece.rows, assume_unique=True)
                gram += piece.mlp.gram(np.searchsorted(piece.rows, rows[own]), scales[own])
        return gram
