"""Fits on a device: networks of one shape are trained together, as batches of matrices (`batch`)."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from casadi_contact.conventions import Update
from casadi_contact.network import Network, Regression
from casadi_contact.training.arrays import torch_arrays
from casadi_contact.training.batch import Batch, Member
from casadi_contact.training.fit import Fit, Run
from casadi_contact.training.levenberg_marquardt import State
from casadi_contact.training.search import Search
from casadi_contact.training.settings import TrainingSettings
from casadi_contact.training.weights import flatten


class MemberSearch(Search):
    """The course of one fit whose steps a `Batch` makes; `judge` after each."""

    @property
    def member(self) -> Member:
        """The present network, for a batch."""
        member: Member = self._lm
        return member

    def _start(self, network: Network, state: State | None = None) -> None:
        start: dict[str, Any] = {"parameters": flatten(network)} if state is None else vars(state)
        columns = self._columns(self._training), self._columns(self._validation)
        self._lm, self._counted = Member(network, *columns, self._drawing_seed(), **start), 0

    def _validation_rms(self) -> float:
        return self.member.validation_rms

    def _flop_of_network(self) -> int:
        return self.member.flop


def fit_batches(
    regressions: Sequence[Regression],
    settings: Mapping[str, TrainingSettings],
    device: str,
    checkpoints: Mapping[str, Path | None],
    progress: Update | None = None,
    starts: Mapping[str, Network] | None = None,
) -> dict[str, Fit]:
    """`fit.fit` of every regression of one output, those whose networks have one shape side by side on a torch device.

    A network that grows, or begins again, goes on in the batch of its new shape. CPU seconds are shared out evenly.
    Raises ValueError as `fit.fit` does, and for a device that cannot be had.
    """
    arrays = torch_arrays(device)
    with ExitStack() as stack:
        runs = {
            r.name: stack.enter_context(
                Run(r, settings[r.name], checkpoints[r.name], progress, (starts or {}).get(r.name), MemberSearch)
            )
            for r in regressions
        }
        batches: dict[tuple[Member, ...], Batch] = {}
        while groups := _groups([run for run in runs.values() if not run.search.stop_reason]):
            now = {tuple(_member(run) for run in group): group for group in groups}
            batches = {members: batches[members] for members in now if members in batches}
            for members, group in now.items():
                began = time.thread_time()
                if members not in batches:
                    batches[members] = Batch(members, arrays, group[0].search.settings.chunk_rows)
                batches[members].step()
                for run in group:
                    run.search.judge()
                    run.note((time.thread_time() - began) / len(group))
        return {name: run.result() for name, run in runs.items()}


def _member(run: Run) -> Member:
    assert isinstance(run.search, MemberSearch)
    return run.search.member


def _groups(runs: Sequence[Run]) -> list[list[Run]]:
    """The runs by the shape of their present networks."""
    groups: dict[Any, list[Run]] = {}
    for run in runs:
        groups.setdefault(_member(run).shape, []).append(run)
    return list(groups.values())
