"""How fast compiled kernels are: against CasADi graphs, elastic foundations, single calls."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path

import casadi as ca
import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation, grid_text
from casadi_contact.core.compiler import shared_library
from casadi_contact.core.conventions import Array
from casadi_contact.core.files.writing import write_text
from casadi_contact.core.machine import machine_record
from casadi_contact.core.workers import one_thread
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.workflow.benchmark.timing import Timing, compare, time_batch, time_mapped, time_single_calls
from casadi_contact.workflow.project import Project, available_poses, available_surrogates

BATCH = 1000
CALL_ALONE = "call alone"
GRIDS = ((40, 30), (80, 40))


def kernel_speed(surrogate: Surrogate, poses: Array, repeats: int = 15) -> dict[str, Timing]:
    """Times per pose of value, Jacobian and Lagrangian Hessian of all loads as graph and as kernel, of a batch and of
    EF grids, in one run on one core.

    Single calls go through CasADi's buffer and include the copy of each pose, which "call alone" times of a function
    that computes nothing; EF grids are timed as one batch of poses, their cheapest form; a scene without geometry has
    none. Raises CompilerError without a compiler.
    """
    measurements: dict[str, Callable[[], float]] = {CALL_ALONE: partial(time_single_calls, copy_of_one_number(), poses)}
    for name, compiled in (("graph", False), ("kernel", True)):
        function = surrogate.function(compiled=compiled)
        weights = np.ones(function.numel_out(0))
        measurements[f"value, {name}"] = partial(time_single_calls, function, poses)
        measurements[f"Jacobian, {name}"] = partial(time_single_calls, jacobian_of(function), poses)
        measurements[f"Hessian, {name}"] = partial(time_single_calls, lagrangian_hessian(function), poses, weights)
    batch = surrogate.function(compiled=True, batch=BATCH)
    measurements[f"value, kernel, batch of {BATCH}"] = partial(time_mapped, batch, np.resize(poses, (BATCH, 6)))
    for grid in () if surrogate.scene.layer is None else GRIDS:
        measurements[f"EF {grid_text(grid)}"] = partial(time_batch, ElasticFoundation(surrogate.scene, grid), poses)
    with one_thread():
        return compare(measurements, repeats)


def copy_of_one_number() -> ca.Function:
    """pose -> its first coordinate, compiled: what remains is the call."""
    pose = ca.MX.sym("pose", 6)
    code = ca.CodeGenerator("call_alone")
    code.add(ca.Function("call_alone", [pose], [pose[0]]))
    return ca.external("call_alone", str(shared_library(code.dump())))


def jacobian_of(function: ca.Function) -> ca.Function:
    """pose -> Jacobian of the loads, as nlpsol builds it."""
    pose = ca.MX.sym("pose", 6)
    return ca.Function("jacobian", [pose], [ca.jacobian(function(pose), pose)])


def lagrangian_hessian(function: ca.Function) -> ca.Function:
    """pose, λ -> Hessian of λᵀ·loads by the pose, as nlpsol builds it."""
    pose, weights = ca.MX.sym("pose", 6), ca.MX.sym("weights", function.numel_out(0))
    return ca.Function("hessian", [pose, weights], [ca.hessian(ca.dot(weights, function(pose)), pose)[0]])


SPEED_FILE = "kernel_speed.json"
_POSES = 505


def speed(project: Project) -> Path:
    """Time the kernels of the project's surrogates on poses of its cycles or table; write ``kernel_speed.json``.

    Where nothing has been built: of the scene's shipped surrogates, on poses of the built-in cycles.
    """
    surrogates = available_surrogates(project)
    poses = available_poses(project)[:_POSES]
    measured = {structure: kernel_speed(surrogate, poses) for structure, surrogate in surrogates.items()}
    content = {
        "format": "casadi_contact kernel speed",
        "format_version": 1,
        "machine": machine_record(),
        "surrogates": {
            structure: {"microseconds": {what: asdict(timing) for what, timing in timings.items()}}
            for structure, timings in measured.items()
        },
    }
    path = project.folder / SPEED_FILE
    write_text(path, json.dumps(content, indent=1, ensure_ascii=False))
    return path
