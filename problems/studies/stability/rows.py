"""Rows of the table: which study measures each, on methods that are built once in every process."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

from casadi_contact.core.workers import cancelled_if_left
from casadi_contact.workflow.project import Project
from problems.studies.stability import (
    bad_training_data,
    clusters,
    consistency,
    derivative_steps,
    liftoff,
    out_of_range,
    settling_starts,
    single_precision,
    starts,
    time_steps,
)
from problems.studies.stability.methods import Bench, bench, project_bench
from problems.studies.stability.table import FAILURES, Line

ROWS_OF_ANY_SCENE = (1, 3, 4, 9)


@dataclass(frozen=True)
class Plan:
    """What is measured, and how much of it."""

    count: int
    quick: bool
    patch: str = "knee"
    two_stage: str = "knee_two_stage"
    scene: str = "knee"
    preset: str = "quick"  # that another scene was built by,
    folder: Path | None = None  # and where

    @cached_property
    def project(self) -> Project | None:
        """The build of another scene than the knee."""
        return None if self.scene == "knee" else Project.open(self.scene, self.preset, self.folder)

    @cached_property
    def bench(self) -> Bench:
        """The methods, loaded or built once in each process."""
        points, gflop = (400, 60.0) if self.quick else (2000, 300.0)
        if self.project is not None:
            return project_bench(self.project, peer_points=points, peer_gflop=gflop)
        return bench(self.patch, self.two_stage, peer_points=points, peer_gflop=gflop)

    @property
    def rows(self) -> tuple[int, ...]:
        """Those that can be measured: others of a knee alone."""
        return tuple(FAILURES) if self.project is None else ROWS_OF_ANY_SCENE

    @property
    def settings(self) -> dict[str, Any]:
        """What the table's files say of it."""
        return {**self.bench.settings, "count": self.count, "quick": self.quick}


@lru_cache(maxsize=1)
def kept(plan: Plan) -> Plan:
    """The equal plan that came first in this process, with its bench."""
    return plan


def measure_row(row: int, plan: Plan) -> tuple[list[Line], Any]:
    """Lines of one row, and what its picture needs."""
    known, quick = kept(plan).bench, plan.quick
    rows: dict[int, Callable[[], tuple[list[Line], Any]]] = {
        1: lambda: (starts if plan.project is None else settling_starts).measure(known, plan.count),
        2: lambda: liftoff.measure(known, 21 if quick else 61),
        3: lambda: out_of_range.measure(known, 2_000 if quick else 100_000),
        4: lambda: derivative_steps.measure(known, 4 if quick else 20),
        5: lambda: clusters.measure(known, (1e-5, 0.0) if quick else clusters.SPACINGS),
        6: lambda: time_steps.measure(known, (800.0,) if quick else time_steps.AXIAL_N),
        7: lambda: single_precision.measure(known, 4 if quick else 10),
        8: lambda: bad_training_data.measure(known, 500 if quick else 1500, 40 if quick else 150),
        9: lambda: consistency.measure(known),
    }
    return rows[row]()


def measure_rows(rows: Sequence[int], plan: Plan, executor: Executor | None) -> Iterator[tuple[int, list[Line], Any]]:
    """Row by row here, or side by side on an executor, as they come."""
    if executor is None:
        for row in rows:
            print(f"{row}. {FAILURES[row]}", file=sys.stderr)
            yield row, *measure_row(row, plan)
        return
    futures = {executor.submit(measure_row, row, plan): row for row in rows}
    with cancelled_if_left(executor, futures):
        for future in as_completed(futures):
            yield futures[future], *future.result()
            print(f"{futures[future]}. {FAILURES[futures[future]]}", file=sys.stderr)
