"""How fast compiled kernels are: against CasADi graphs, elastic foundations, single calls, the machine's limit."""

from __future__ import annotations

import ctypes
import json
import timeit
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
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
from casadi_contact.networks.kernel.source import sigmoid_source
from casadi_contact.networks.network import Network
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.workflow.benchmark.timing import Timing, compare, time_batch, time_mapped, time_single_calls
from casadi_contact.workflow.project import Project, available_poses, available_surrogates

BATCH = 1000
CALL_ALONE = "call alone"
GRIDS = ((40, 30), (80, 40))
_MATRIX = 768  # large enough for the BLAS library to run at its best
_SIGMOIDS, _REPEATS = 1024, 2000  # a vector that stays in the nearest cache


@dataclass(frozen=True)
class MachineLimit:
    """What one pose costs at least on one core: multiply-adds and sigmoids of all networks at their measured rates."""

    multiply_adds: int
    sigmoids: int
    multiply_adds_per_s: float
    sigmoids_per_s: float

    @property
    def us(self) -> float:
        """Least time per pose [µs]."""
        return 1e6 * (self.multiply_adds / self.multiply_adds_per_s + self.sigmoids / self.sigmoids_per_s)

    def __str__(self) -> str:
        return (
            f"machine's limit {self.us:.2f} µs: {self.multiply_adds} multiply-adds at {self.multiply_adds_per_s:.3g}/s "
            f"(NumPy's product of two {_MATRIX}×{_MATRIX} matrices on one thread) and {self.sigmoids} sigmoids at "
            f"{self.sigmoids_per_s:.3g}/s (the kernel's own loop over {_SIGMOIDS} numbers); best of the repeats"
        )


def kernel_speed(surrogate: Surrogate, poses: Array, repeats: int = 15) -> tuple[dict[str, Timing], MachineLimit]:
    """Times per pose of value, Jacobian and Lagrangian Hessian of all loads as graph and as kernel, of a batch and of
    EF grids, in one run on one core, and the machine's limit.

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
        return compare(measurements, repeats), _limit(list(surrogate.networks.values()), repeats)


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


def _limit(networks: Sequence[Network], repeats: int) -> MachineLimit:
    matrix = np.random.default_rng(0).random((_MATRIX, _MATRIX))
    product = np.empty_like(matrix)
    library = ctypes.CDLL(str(shared_library(sigmoid_source(min(network.activation for network in networks)))))
    numbers = (ctypes.c_double * _SIGMOIDS)(*np.linspace(-2.0, 2.0, _SIGMOIDS))
    library.sigmoids.argtypes = [ctypes.c_int, ctypes.c_int, ctypes.POINTER(ctypes.c_double)]
    return MachineLimit(
        multiply_adds=sum(weight.size for network in networks for weight in network.weights),
        sigmoids=sum(sum(network.hidden) for network in networks),
        multiply_adds_per_s=_MATRIX**3 / _least(lambda: np.matmul(matrix, matrix, out=product), repeats),
        sigmoids_per_s=_SIGMOIDS * _REPEATS / _least(lambda: library.sigmoids(_REPEATS, _SIGMOIDS, numbers), repeats),
    )


def _least(run: Callable[[], object], repeats: int) -> float:
    """Shortest of several times [s]."""
    return min(timeit.repeat(run, number=1, repeat=repeats))


SPEED_FILE = "kernel_speed.json"
_POSES = 505


def speed(project: Project) -> Path:
    """Time the kernels of the project's surrogates on poses of its cycles or table; write ``kernel_speed.json``.

    Where nothing has been built: of the scene's shipped surrogates, on poses of the built-in cycles.

    Raises FileNotFoundError without a trained surrogate, CompilerError without a compiler.
    """
    surrogates = available_surrogates(project)
    poses = available_poses(project)[:_POSES]
    measured = {structure: kernel_speed(surrogate, poses) for structure, surrogate in surrogates.items()}
    content = {
        "format": "casadi_contact kernel speed",
        "format_version": 1,
        "machine": machine_record(),
        "surrogates": {
            structure: {
                "microseconds": {what: asdict(timing) for what, timing in timings.items()},
                "limit_us": limit.us,
                "limit": str(limit),
            }
            for structure, (timings, limit) in measured.items()
        },
    }
    path = project.folder / SPEED_FILE
    write_text(path, json.dumps(content, indent=1, ensure_ascii=False))
    return path
