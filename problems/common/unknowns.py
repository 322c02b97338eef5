"""The unknowns of a transcribed problem: CasADi matrices with bounds, stacked into one vector."""

from __future__ import annotations

import casadi as ca
import numpy as np

from casadi_contact.conventions import Array


class Unknowns:
    """Matrices one after the other, each column by column, with their bounds."""

    def __init__(self) -> None:
        self._parts: list[ca.MX] = []
        self._bounds: list[tuple[Array, Array]] = []

    def add(
        self, name: str, rows: int, columns: int, low: Array | float = -np.inf, high: Array | float = np.inf
    ) -> ca.MX:
        """A new matrix (rows, columns), bounds numbers or (rows,), the same for every column."""
        part = ca.MX.sym(name, rows, columns)
        self._parts.append(part)
        low, high = (np.broadcast_to(bound, (columns, rows)).ravel() for bound in (low, high))
        self._bounds.append((low, high))
        return part

    @property
    def x(self) -> ca.MX:
        """All of them (k)."""
        return ca.vertcat(*(ca.vec(part) for part in self._parts))

    @property
    def bounds(self) -> Array:
        """Lower and upper ones (2, k)."""
        return np.concatenate(self._bounds, axis=1)
