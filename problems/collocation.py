"""Direct collocation: each interval has a polynomial through its node and its collocation points."""

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from casadi_contact.core.conventions import Array


@dataclass(frozen=True)
class Collocation:
    """Equal intervals over a duration [s], each with `degree` Radau points; ValueError for less than 2, or above 9.

    Nodes are (n, intervals + 1), points (n, intervals·degree) CasADi matrices, in the order of time."""

    intervals: int
    degree: int
    duration_s: float

    def __post_init__(self) -> None:
        if self.intervals < 2 or not 1 <= self.degree <= 9:
            raise ValueError(f"intervals {self.intervals}, degree {self.degree}: expected >= 2, and 1 to 9")

    @cached_property
    def _coefficients(self) -> tuple[Array, Array, Array]:
        """Derivatives at the points (degree + 1, degree), end values (degree + 1), quadrature weights (degree)."""
        C, D, B = ca.collocation_coeff(ca.collocation_points(self.degree, "radau"))
        return np.asarray(C), np.asarray(D).ravel(), np.asarray(B).ravel()

    @property
    def step_s(self) -> float:
        """Length of an interval."""
        return self.duration_s / self.intervals

    @property
    def times_s(self) -> Array:
        """Times of the points (intervals·degree,)."""
        taus = np.asarray(ca.collocation_points(self.degree, "radau"))
        return np.asarray((np.arange(self.intervals)[:, None] + taus) * self.step_s).ravel()

    @property
    def weights(self) -> Array:
        """Shares of the points (intervals·degree,) in a mean over the duration."""
        return np.tile(self._coefficients[2] / self.intervals, self.intervals)

    def derivatives(self, nodes: ca.MX, points: ca.MX) -> ca.MX:
        """Derivatives at the points by time in intervals, so that over step_s they are rates."""
        return ca.horzcat(*(ca.mtimes(stacked, self._coefficients[0]) for stacked in self._stacked(nodes, points)))

    def jumps(self, nodes: ca.MX, points: ca.MX) -> ca.MX:
        """Ends of the intervals' polynomials minus the next nodes (n, intervals): zero where a curve is continuous."""
        ends = [ca.mtimes(stacked, self._coefficients[1]) for stacked in self._stacked(nodes, points)]
        return ca.horzcat(*ends) - nodes[:, 1:]

    def _stacked(self, nodes: ca.MX, points: ca.MX) -> list[ca.MX]:
        starts = range(0, self.intervals * self.degree, self.degree)
        return [ca.horzcat(nodes[:, k], points[:, at : at + self.degree]) for k, at in enumerate(starts)]
