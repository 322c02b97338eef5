"""What a surrogate's file says of how its networks were made."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from casadi_contact.core.machine import machine_record
from casadi_contact.networks.training.fit import Fit
from casadi_contact.samples.errors import domain_errors
from casadi_contact.samples.samples import Samples
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.sample_rows import samples_record
from casadi_contact.workflow.project import Project, has_motion, read_motion

_COURSE_POINTS = 60  # of a fit that the record keeps


def training_record(
    project: Project, samples: Samples, surrogate: Surrogate, fits: dict[str, Any], command: str
) -> dict[str, Any]:
    """The record itself, in plain JSON values; its keys are told of in `casadi_contact.surrogate.info`."""
    return {
        **samples_record(samples),
        **fits_record(fits),
        "test_errors": domain_errors(surrogate, samples),
        "command": command,
        "reference_cycles": read_motion(project)[1] if has_motion(project) else [],
        "machine": machine_record(),
    }


def fits_record(fits: Mapping[str, Fit]) -> dict[str, Any]:
    """What the record says of the fits alone."""
    return {
        "training_errors": {name: fit.rms for name, fit in fits.items()},
        "stop_reasons": {name: fit.stop_reason for name, fit in fits.items()},
        "gflop": {name: round(fit.gflop, 1) for name, fit in fits.items()},
        "convergence": {name: _course(fit.history) for name, fit in fits.items()},
        "seconds": {name: round(fit.cpu_s, 1) for name, fit in fits.items()},
    }


def exchanged(before: Mapping[str, Any], other: Mapping[str, Any], names: Collection[str]) -> dict[str, Any]:
    """The record of networks of which those named come from another fit of the same samples, whose record is `other`;
    work and time are those of both."""
    taken = {
        key: {**before[key], **{name: value for name, value in other[key].items() if name in names}}
        for key in ("training_errors", "stop_reasons", "convergence")
    }
    return {**before, **taken, **work_of_both(before, other)}


def work_of_both(before: Mapping[str, Any], record: Mapping[str, Any]) -> dict[str, Any]:
    """Work and time of networks that went on from others, whose record may not tell theirs."""
    both = {}
    for key in ("gflop", "seconds"):
        spent, later = before.get(key, {}), record[key]
        both[key] = {name: round(spent.get(name, 0.0) + later.get(name, 0.0), 1) for name in {**spent, **later}}
    return both


def gone_on(before: Mapping[str, Any], record: Mapping[str, Any]) -> dict[str, Any]:
    """The record of networks that went on from others: work and time are those of both, dropped shares the former's,
    since of what a round draws only the worst is kept; all else is the later's."""
    added = sum(record["samples"].values()) - sum(before["samples"].values())
    return {
        **record,
        **work_of_both(before, record),
        "dropped": before["dropped"],
        "active": [*before.get("active", []), added],
    }


def _course(history: Mapping[str, Any]) -> dict[str, list[float]]:
    """Work done [Gflop] and RMS of the fit at up to `_COURSE_POINTS` of its iterations, evenly spaced in log work."""
    gflop, rms = history["gflop"], history["training_rms"]
    begun = np.flatnonzero(gflop > 0.0)
    if not len(begun):
        return {"gflop": [], "rms": []}
    wanted = np.geomspace(gflop[begun[0]], gflop[-1], _COURSE_POINTS)
    chosen = np.unique(np.minimum(np.searchsorted(gflop, wanted), len(gflop) - 1))
    return {"gflop": [float(f"{x:.4g}") for x in gflop[chosen]], "rms": [float(f"{x:.4g}") for x in rms[chosen]]}
