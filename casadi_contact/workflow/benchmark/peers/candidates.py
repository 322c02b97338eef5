"""All peers, one after the other; what fails stays as a candidate that says why."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial

from casadi_contact.samples.reference import ReferenceMotion
from casadi_contact.samples.samples import Samples
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.workflow.benchmark.peers.forms import two_stage_forms
from casadi_contact.workflow.benchmark.peers.history import HISTORY_MODELS, history_candidates
from casadi_contact.workflow.benchmark.peers.regressors import REGRESSORS, TrainingSet, regressor_candidates
from casadi_contact.workflow.benchmark.timing import Candidate, one_thread

FORMS = "two-stage form"
FAMILIES = (*REGRESSORS, *HISTORY_MODELS, FORMS)


def peer_candidates(
    samples: Samples,
    *,
    gflop: float,
    two_stage: Surrogate | None = None,
    names: Sequence[str] | None = None,
    motion: ReferenceMotion | None = None,
    families: Sequence[str] = FAMILIES,
) -> Iterator[Candidate]:
    """Every peer, fitted on the training samples on one thread, one after the other.

    gflop: 10⁹ floating-point operations for each peer whose fit has a budget (Gaussian process, networks); counted and
    not timed, so that a busy machine gives the same peers. names: loads to predict, the scene's if left out. two_stage:
    the surrogate whose other forms are timed. motion: what history models learn from. A family that fails becomes a
    candidate with model None and the failure's text. Raises ValueError for samples without training rows, unknown
    loads or families, and a budget that is not positive.
    """
    if not gflop > 0.0:
        raise ValueError(f"gflop is {gflop!r}, expected 10⁹ operations, above 0")
    if unknown := [family for family in families if family not in FAMILIES]:
        raise ValueError(f"unknown peer {unknown[0]!r}, expected some of {', '.join(FAMILIES)}")
    data = TrainingSet.of(samples, names)

    def made(family: str) -> Iterator[Candidate]:
        if family in REGRESSORS:
            return regressor_candidates(family, data, gflop)
        if family in HISTORY_MODELS:
            return history_candidates(family, data, gflop, motion)
        return two_stage_forms(two_stage, data.load_names)

    return (candidate for family in families for candidate in _until_failure(family, partial(made, family)))


def _until_failure(family: str, made: Callable[[], Iterator[Candidate]]) -> Iterator[Candidate]:
    """The family's candidates, each made on one thread, and its failure as the last."""
    candidates: Iterator[Candidate] | None = None
    while True:
        try:
            with one_thread():
                candidates = made() if candidates is None else candidates
                candidate = next(candidates, None)
        except Exception as error:  # a peer is someone else's method: whatever stops it is its entry in the table
            yield Candidate(family, family, None, failure=" ".join(str(error).split()) or type(error).__name__)
            return
        if candidate is None:
            return
        yield candidate
