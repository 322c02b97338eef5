"""A network whose outputs are the root loads of the spots of one patch, in training on the root load of the patch.

The residual of a row is r = w·(S(y) - target), with S the joint root load of all outputs (`casadi_contact.spots`):
nobody says which spot bears how much. S grows in proportion to y, so that outputs of one common scale keep it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from casadi_contact.conventions import Array
from casadi_contact.spots import joint_root
from casadi_contact.training.trunk import TrunkMlp


class SpotMlp(TrunkMlp):
    """Residuals of one network of K outputs, targets and weights (rows,); otherwise as `TrunkMlp`."""

    @property
    def per_row(self) -> int:
        """Number of residuals of a row."""
        return 1

    def _prepare(self) -> None:
        super()._prepare()
        self._head = self.arrays.zeros(self.rows, self.outputs)

    @property
    def draw_weights(self) -> Array:
        """Weight (rows,) by which rows are drawn for the preconditioner."""
        return np.abs(self.row_weights)

    def _output(self, a: Any, layer: Any) -> Any:
        return joint_root(self.xp, a @ layer.T)[0]

    def _output_step(self, residuals: Any) -> Any | None:
        return None  # no linear problem

    def _accept_output(self) -> None:
        for c in self._chunks():
            _, slopes = joint_root(self.xp, self._current[-1][c] @ self._layers[-1].T)
            self._head[c] = slopes * self._weight[c][:, None]

    def _of_outputs(self, tangent: Any, c: slice) -> Any:
        return self.xp.einsum("nk,nk->n", tangent, self._head[c])

    def _by_outputs(self, rows: Any, c: slice) -> Any:
        return rows[:, None] * self._head[c]

    def _seeds(self, rows: Any) -> Any:
        return self._head[rows][:, None, :]
