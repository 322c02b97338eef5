"""One set of networks, many forms: the paper's two-stage surrogate as its users might evaluate it.

All forms give the same loads, so only their times differ.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from casadi_contact.core.compiler import machine_flags
from casadi_contact.core.conventions import Array
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.two_stage.surrogate import TwoStageSurrogate
from casadi_contact.workflow.benchmark.candidate import Candidate, Stopwatch
from casadi_contact.workflow.benchmark.peers.casadi_forms import FLAGS, CasadiModel, Form, compiled_form, plain_form
from casadi_contact.workflow.benchmark.peers.stopwatch import casadi_calls, one_call, single_calls
from casadi_contact.workflow.benchmark.peers.torch_form import TorchForm, l4casadi_form

FAMILY = "two-stage form"


def two_stage_forms(surrogate: Surrogate | None, names: Sequence[str]) -> Iterator[Candidate]:
    """Each form as a candidate; one that cannot be built says why.

    Raises ValueError without a two-stage surrogate, or for loads that it lacks.
    """
    if not isinstance(surrogate, TwoStageSurrogate):
        got = "none" if surrogate is None else f"a {surrogate.structure} surrogate"
        raise ValueError(f"the forms of the two-stage networks need a two_stage surrogate, got {got}")
    names = surrogate.check_loads(names)
    builders: dict[str, tuple[Callable[[], Form], str]] = {
        "own function": (
            lambda: Form.of_function(surrogate.function(names)),
            "surrogate.function(): MX with both derivatives written out",
        ),
        "CasADi MX": (
            lambda: plain_form(surrogate, names, ca.MX),
            "plain graph, derivatives by CasADi; also l4casadi's naive form",
        ),
        "CasADi SX": (lambda: plain_form(surrogate, names, ca.SX), "expanded to scalars"),
        "CasADi C": (
            lambda: compiled_form(plain_form(surrogate, names, ca.MX)),
            f"generated from the plain MX graph, gcc {' '.join((*FLAGS, *machine_flags()))}",
        ),
        "l4casadi": (lambda: l4casadi_form(surrogate, names), "float32"),
    }
    for what, (build, remark) in builders.items():
        yield _with_cost(_timed(what, build, remark, names), surrogate)
    yield _with_cost(_torch_candidate(surrogate, names), surrogate)


def _with_cost(candidate: Candidate, surrogate: Surrogate) -> Candidate:
    """The candidate with what its surrogate's record says of samples and training time."""
    return replace(
        candidate,
        samples=sum(surrogate.record.get("samples", {}).values()),
        training_seconds=float(sum(surrogate.record.get("seconds", {}).values())),
        parameters=sum(network.parameter_count for network in surrogate.networks.values()),
    )


def _timed(what: str, build: Callable[[], Form], remark: str, names: Sequence[str]) -> Candidate:
    name, began = f"two-stage, {what}", time.perf_counter()
    try:
        form = build()
    except Exception as error:  # compilers, l4casadi and CasADi fail in ways of their own
        text = " ".join(str(error).split()) or type(error).__name__
        return Candidate(name, FAMILY, None, failure=text)
    took = time.perf_counter() - began
    model = CasadiModel(form.loads, names)
    return Candidate(
        name,
        FAMILY,
        model,
        time_value=casadi_calls(form.loads),
        time_jacobian=casadi_calls(form.jacobian),
        time_hessian=casadi_calls(form.hessian, np.ones(len(names))) if form.hessian is not None else None,
        time_batch=one_call(model),
        remark=f"{remark}; built in {took:.1f} s" + ("" if form.hessian is not None else "; gives no Hessian"),
    )


def _torch_candidate(surrogate: Surrogate, names: Sequence[str]) -> Candidate:
    name = "two-stage, PyTorch"
    try:
        form = TorchForm(surrogate, names)
    except Exception as error:  # torch missing, or without what tracing needs
        text = " ".join(str(error).split()) or type(error).__name__
        return Candidate(name, FAMILY, None, failure=text)

    def timed(call: Callable[[Array], Array]) -> Stopwatch:
        calls = single_calls(call)

        def measure(poses: Array) -> float:
            with form.inference():
                return calls(poses)

        return measure

    return Candidate(
        name,
        FAMILY,
        form,
        time_value=timed(form.one),
        time_jacobian=timed(form.jacobian_one),
        time_hessian=timed(form.hessian_one),
        time_batch=one_call(form),
        remark="float64, inference mode, networks of a stage stacked, traced",
    )
