"""All peers, one after the other; what fails stays as a candidate that says why."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

from casadi_contact.samples.reference import ReferenceMotion
from casadi_contact.samples.samples import Samples
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.workflow.benchmark.candidate import Candidate
from casadi_contact.workflow.benchmark.peers.history.models import HISTORY_MODELS, history
from casadi_contact.workflow.benchmark.peers.kriging import kriging
from casadi_contact.workflow.benchmark.peers.lazy_learning import lazy_learning
from casadi_contact.workflow.benchmark.peers.polynomial import polynomials
from casadi_contact.workflow.benchmark.peers.radial_basis import radial_basis
from casadi_contact.workflow.benchmark.peers.training_set import TrainingSet
from casadi_contact.workflow.benchmark.peers.two_stage_forms import two_stage_forms
from casadi_contact.workflow.benchmark.timing import one_thread

Peer = Callable[[], Iterator[Candidate]]
FAMILIES = ("polynomial", "Kriging", "radial basis", "lazy learning", *HISTORY_MODELS, "two-stage form")


def peer_candidates(
    samples: Samples,
    *,
    gflop: float,
    two_stage: Surrogate | None = None,
    names: Sequence[str] | None = None,
    motion: ReferenceMotion | None = None,
    domains: Sequence[str] | None = None,
    families: Sequence[str] = FAMILIES,
) -> Iterator[Candidate]:
    """Every peer, fitted on the training samples on one thread within `gflop` a family, as it gets ready.

    gflop: budget of 10⁹ floating-point operations, counted and not timed, so that a busy machine gives the same peers.
    names: loads to predict, the scene's if left out. two_stage: the surrogate whose other forms are timed. motion:
    what history models learn from. domains: fit on the samples of these domains alone, and say so in the names; a
    method that holds few points may serve one domain better than all. A family that lacks what it needs, or fails,
    becomes one candidate with model None and the failure's text, beside what it gave before. Raises ValueError for
    samples without training rows, unknown loads or families, and a budget that is not positive.
    """
    if not gflop > 0.0:
        raise ValueError(f"gflop is {gflop!r}, expected 10⁹ operations, above 0")
    unknown = [family for family in families if family not in FAMILIES]
    if unknown:
        raise ValueError(f"unknown peer {unknown[0]!r}, expected some of {', '.join(FAMILIES)}")
    data = TrainingSet.of(samples if domains is None else samples.select(domain=domains), names)
    suffix = "" if domains is None else f" ({', '.join(domains)})"
    peers: dict[str, Peer] = {
        "polynomial": lambda: polynomials(data, gflop),
        "Kriging": lambda: kriging(data, gflop),
        "radial basis": lambda: radial_basis(data, gflop),
        "lazy learning": lambda: lazy_learning(data),
        **{family: partial(history, family, data, gflop, motion) for family in HISTORY_MODELS},
        "two-stage form": lambda: two_stage_forms(two_stage, data.load_names),
    }
    made = (candidate for family in families for candidate in _kept(family, peers[family]))
    return (replace(candidate, name=candidate.name + suffix) for candidate in made)


def _kept(family: str, peer: Peer) -> Iterator[Candidate]:
    """The peer's candidates, each made on one thread, and its failure as the last."""
    candidates: Iterator[Candidate] | None = None
    while True:
        try:
            with one_thread():
                candidates = peer() if candidates is None else candidates
                candidate = next(candidates, None)
        except Exception as error:  # a peer is someone else's method: whatever stops it is its entry in the table
            text = " ".join(str(error).split()) or type(error).__name__
            yield Candidate(family, family, None, failure=text)
            return
        if candidate is None:
            return
        yield candidate
