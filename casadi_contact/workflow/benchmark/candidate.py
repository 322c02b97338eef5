"""A model that may stand on the speed-accuracy chart: what it predicts, what it cost and how to time it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from casadi_contact.core.conventions import Array
from casadi_contact.samples.errors import LoadModel

Stopwatch = Callable[[Array], float]
"""Poses (n, 6) -> seconds per pose, on one thread."""


@dataclass(frozen=True)
class Candidate:
    """One point of the chart.

    name: "EF 80×40", "patch 14-14"; family: what shares a colour ("EF", "patch", "Kriging"). model is None where it
    could not be made; then failure says why and the point stays in the table. time_value times single calls, as an
    optimiser makes them, time_batch one call with all poses; a time that a model cannot have is None. samples and
    training_seconds are zero for models that learn nothing; parameters counts stored numbers. remark: what a reader
    must know (condition number, settings).
    """

    name: str
    family: str
    model: LoadModel | None
    time_value: Stopwatch | None = None
    time_jacobian: Stopwatch | None = None
    time_hessian: Stopwatch | None = None
    time_batch: Stopwatch | None = None
    samples: int = 0
    training_seconds: float = 0.0
    parameters: int = 0
    remark: str = ""
    failure: str = ""
