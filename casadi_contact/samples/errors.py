"""Errors of a model's loads against a reference, per load and per domain [EF15 §2.7, Tables 2 and 3]."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.core.quantities import FORCE, TORQUE, of_kind, quantity
from casadi_contact.samples.samples import DOMAINS, TEST, Samples

LoadErrors = dict[str, dict[str, float]]


class LoadModel(Protocol):
    """Anything that gives named loads (n, loads) for poses (n, 6)."""

    load_names: tuple[str, ...]

    def __call__(self, poses: Array) -> Array:
        """Named loads (n, loads)."""


def load_errors(names: Sequence[str], got: Array, reference: Array) -> LoadErrors:
    """{load: {"rms": √mean(e²), "max": max|e|, "mean": mean|e|}} of loads (n, loads), in N and N·mm; ValueError for
    shapes that differ."""
    if got.shape != reference.shape or got.shape[1] != len(names):
        raise ValueError(f"loads have shapes {got.shape} and {reference.shape}, expected (n, {len(names)}) twice")
    off = np.abs(got - reference)
    return {
        name: {
            "rms": float(np.sqrt(np.mean(column**2))),
            "max": float(column.max()),
            "mean": float(column.mean()),
        }
        for name, column in zip(names, off.T, strict=True)
    }


def domain_errors(model: LoadModel, samples: Samples, role: int = TEST) -> dict[str, LoadErrors]:
    """`load_errors` against the samples' own (teacher grid) loads in each domain that has samples of this role."""
    errors = {}
    for domain in DOMAINS:
        part = samples.select(domain, role)
        if len(part):
            errors[domain] = load_errors(model.load_names, model(part.poses), part.loads(model.load_names))
    return errors


def rms_by_kind(errors: LoadErrors) -> dict[str, float]:
    """{"force": RMS over all forces [N], "torque": over all torques [N·mm]} and likewise for other kinds of quantity,
    in their units: of those kinds that are among the errors, forces and torques first."""
    found = {quantity(name).kind for name in errors}
    kinds = dict.fromkeys((*(kind for kind in (FORCE, TORQUE) if kind in found), *(quantity(n).kind for n in errors)))
    squares = {kind: [errors[name]["rms"] ** 2 for name in of_kind(list(errors), kind)] for kind in kinds}
    return {kind.name: float(np.sqrt(np.mean(values))) for kind, values in squares.items()}
