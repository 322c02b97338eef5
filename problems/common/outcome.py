"""What every report says of a solver's work."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Any, Protocol

import numpy as np
from rich.console import Console

from casadi_contact.optimisation.verification.verdict import Verdict

_DETAILS, _NUMBER = re.compile("[:(]"), re.compile(r"\d\S*")


class SolverWork(Protocol):
    """What IPOPT says of itself in the result of every problem that it solves."""

    @property
    def ipopt_status(self) -> str:
        """IPOPT's return status."""

    @property
    def iterations(self) -> int:
        """IPOPT's iterations."""

    @property
    def seconds(self) -> float:
        """Time of the solution with its start."""


class Outcome(SolverWork, Protocol):
    """The result of a problem of many rows; converged and reason are (n,)."""

    @property
    def converged(self) -> np.ndarray:
        """True (n,) where a row is solved."""

    @property
    def reason(self) -> np.ndarray:
        """Why a row is not solved, or what else there is to say of it, (n,); empty where nothing."""


def solver_record(work: SolverWork) -> dict[str, Any]:
    """IPOPT's part of a summary."""
    return {"ipopt_status": work.ipopt_status, "ipopt_iterations": work.iterations, "seconds": work.seconds}


def ended_in_words(work: SolverWork) -> str:
    """How IPOPT ended, for a title: "solve succeeded after 8 iterations"."""
    return f"{work.ipopt_status.replace('_', ' ').lower()} after {work.iterations} iterations"


def print_verdict(console: Console, verdict: Verdict) -> None:
    """The first line of every report."""
    console.print(str(verdict), highlight=False, soft_wrap=True)


def rows_in_words(chosen: np.ndarray) -> str:
    """Which of rows (n,) are True: "0, 3 to 7, 9, 10"."""
    words = []
    for rows in _neighbours(chosen):
        words += [f"{rows[0]} to {rows[-1]}"] if len(rows) > 2 else [str(row) for row in rows]
    return ", ".join(words)


def _neighbours(kinds: Sequence[Any] | np.ndarray) -> Iterator[list[int]]:
    """Neighbouring rows (n,) of one kind together, those of a kind that is False or empty left out."""
    for kind, group in groupby(range(len(kinds)), key=lambda k: kinds[k]):
        if kind:
            yield list(group)


def print_reasons(console: Console, reason: np.ndarray, row: str = "frame") -> None:
    """What there is to say of rows (n,), such as why they are not verified: neighbouring ones together where they
    differ in numbers alone or in what follows a colon or bracket, with what is said of the middle one."""
    for rows in _neighbours([_NUMBER.sub("", _DETAILS.split(text)[0]) for text in reason]):
        middle = rows[len(rows) // 2]
        which = f"{row} {rows[0]}" if len(rows) == 1 else f"{row}s {rows[0]} to {rows[-1]}"
        which += "" if len(set(reason[rows])) == 1 else f", as {middle}"
        console.print(f"{which}: {reason[middle]}", highlight=False, soft_wrap=True)


def print_outcome(console: Console, result: Outcome, what: str = "frames converged", row: str = "frame") -> None:
    """How many rows are solved, what IPOPT needed, and whatever there is to say of them (`print_reasons`)."""
    console.print(
        f"{int(result.converged.sum())} of {len(result.converged)} {what}; IPOPT: {result.ipopt_status}, "
        f"{result.iterations} iterations, {result.seconds:.2f} s with its start",
        highlight=False,
    )
    print_reasons(console, result.reason, row)
