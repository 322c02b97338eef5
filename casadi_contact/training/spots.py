"""A network whose outputs are the root loads of the spots of one patch, in training on the root load of the patch.

The loss of a row is that of `row_loss` with S(y), the joint root load of all outputs (`network.spots`), in
place of y: nobody says which spot bears how much. S grows in proportion to y, so that outputs of one common scale keep
it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from casadi_contact.network.spots import joint_root
from casadi_contact.training.chunk import Chunk
from casadi_contact.training.trunk import TrunkMlp


class SpotMlp(TrunkMlp):
    """Residuals of one network of K outputs, targets and weights (rows,); otherwise as `TrunkMlp`."""

    @property
    def per_row(self) -> int:
        """Number of residuals of a row."""
        return 1

    def _output(self, a: Any, layer: Any) -> Any:
        return joint_root(self.xp, (layer @ a).T)[0]

    def _output_step(self, weight: Any, residuals: Any) -> Any | None:
        return None  # no linear problem

    def _head(self, chunk: Chunk, layer: Any) -> Any:
        """W·∂S/∂y (outputs, rows)."""
        _, slopes = joint_root(self.xp, (layer @ chunk.current[-1]).T)
        return slopes.T * self._weight[chunk.rows]

    def _of_outputs(self, tangent: Any, head: Any) -> Any:
        return (tangent * head).sum(0)

    def _by_outputs(self, rows: Any, head: Any) -> Any:
        return rows * head

    def _seeds(self, rows: np.ndarray) -> Any:
        return self._columns(rows, lambda chunk: chunk.exact.derivatives[-1]).T[:, None, :]
