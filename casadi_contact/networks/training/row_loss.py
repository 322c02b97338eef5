"""What each row of the data adds to the loss, as a function of the network's output y there.

A row with target t, weight w and false load f (see `network.Regression`) has two residuals,

    r = w·(y - t),   e = f·max(y, 0)².

Both depend on y alone, so that the gradient and JᵀJ of ½Σ(r² + e²) are those of one residual R with ∂R/∂y = W,

    W² = w² + (∂e/∂y)²,   W·R = w·r + ∂e/∂y·e,   ∂e/∂y = 2f·max(y, 0).

They are not added before they are squared: behind a large r Gauss-Newton would not see how stiff e is at y = 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

_TINY = float(np.finfo(float).tiny)


@dataclass(frozen=True)
class RowLoss:
    """Arrays of one shape, of NumPy or torch; false_load: None where it is 0 in all rows."""

    target: Any
    weight: Any
    false_load: Any

    def of(self, rows: slice) -> RowLoss:
        """That of these rows."""
        false_load = None if self.false_load is None else self.false_load[rows]
        return RowLoss(self.target[rows], self.weight[rows], false_load)

    def residual(self, y: Any) -> Any:
        """r."""
        return self.weight * (y - self.target)

    def excess(self, y: Any) -> Any:
        """e."""
        return 0.0 * y if self.false_load is None else self.false_load * y.clip(min=0.0) ** 2

    def squares(self, y: Any) -> Any:
        """r² + e²."""
        squares = self.residual(y) ** 2
        return squares if self.false_load is None else squares + self.excess(y) ** 2

    def weight_and_residual(self, y: Any) -> tuple[Any, Any]:
        """W and R."""
        residual = self.residual(y)
        if self.false_load is None:
            return self.weight, residual
        steepness = 2.0 * self.false_load * y.clip(min=0.0)
        weight = (self.weight**2 + steepness**2) ** 0.5
        return weight, (self.weight * residual + steepness * self.excess(y)) / weight.clip(min=_TINY)
