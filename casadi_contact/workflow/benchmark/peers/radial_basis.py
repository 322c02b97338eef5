"""Radial basis functions: SciPy's RBFInterpolator, global on as many points as possible, and local on neighbours."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
from scipy.interpolate import RBFInterpolator

from casadi_contact.core.conventions import Array, as_poses
from casadi_contact.workflow.benchmark.candidate import Candidate
from casadi_contact.workflow.benchmark.peers.growth import grow
from casadi_contact.workflow.benchmark.peers.stopwatch import one_call, single_calls
from casadi_contact.workflow.benchmark.peers.training_set import TrainingSet

FAMILY, LOCAL_FAMILY = "radial basis", "radial basis, local"
KERNELS = ("thin_plate_spline", "cubic", "quintic")  # scale-invariant, so there is no shape parameter to tune
NEIGHBOURS = (30, 100)
BYTES_PER_PAIR = 24.0  # the matrix and its factorisation
TRIAL_POINTS = 1000


class RadialBasis:
    """Loads by an interpolator on scaled poses, of the pose parameters that vary; neighbours None: all `count` points
    take part in every call."""

    def __init__(self, data: TrainingSet, count: int, kernel: str, neighbours: int | None = None) -> None:
        self.load_names, self._limits = data.load_names, data.limits
        self._varying = np.flatnonzero(np.ptp(data.poses, axis=0) > 0.0)
        self._shift, self._inverse = data.centre[self._varying], 1.0 / data.spread[self._varying]
        self._interpolator = RBFInterpolator(
            self._scaled(data.poses[:count]), data.loads[:count], neighbors=neighbours, kernel=kernel
        )

    def __call__(self, poses: Array) -> Array:
        """Named loads (n, L)."""
        return self._limits.hold(self._interpolator(self._scaled(as_poses(poses))))

    def one(self, pose: Array) -> Array:
        """Loads (L) of one pose."""
        loads: Array = self._interpolator(self._scaled(np.asarray(pose)[None]))[0]
        return self._limits.hold(loads)

    def _scaled(self, poses: Array) -> Array:
        return np.asarray((poses[:, self._varying] - self._shift) * self._inverse)


def best_kernel(data: TrainingSet) -> str:
    """The kernel that, fitted on TRIAL_POINTS points (half of fewer), predicts as many others best.

    Raises ValueError where no kernel can be fitted to so few samples.
    """
    count = min(TRIAL_POINTS, len(data) // 2)
    others, deviation = slice(count, 2 * count), data.load_scale[1]
    errors = {}
    for kernel in KERNELS:
        try:
            off = RadialBasis(data, count, kernel)(data.poses[others]) - data.loads[others]
        except (np.linalg.LinAlgError, ValueError):  # singular, or too few points for the kernel's polynomial
            continue
        errors[kernel] = float(np.mean((off / deviation) ** 2))
    if not errors:
        raise ValueError(f"{len(data)} training samples are too few for radial basis functions, draw more")
    return min(errors, key=lambda kernel: errors[kernel])


def fit_gflop(count: int) -> float:
    """10⁹ operations of a global fit: the kernel matrix, some 50 an entry, and its LU factors, 2n³/3."""
    return 1e-9 * (2.0 / 3.0 * count**3 + 50.0 * count**2)


def _candidate(data: TrainingSet, count: int, kernel: str, neighbours: int | None = None) -> Candidate:
    began = time.process_time()
    model = RadialBasis(data, count, kernel, neighbours)
    took = time.process_time() - began
    local = neighbours is not None
    return Candidate(
        f"{LOCAL_FAMILY} {neighbours}" if local else f"{FAMILY} {count}",
        LOCAL_FAMILY if local else FAMILY,
        model,
        time_value=single_calls(model.one),
        time_batch=one_call(model),
        samples=count,
        training_seconds=took,
        parameters=count * (6 + len(data.load_names)),
        remark=f"{kernel} kernel, SciPy has no derivatives{data.limits.remark}"
        + (f", solves {neighbours} neighbours anew in every call" if local else ""),
    )


def radial_basis(data: TrainingSet, gflop: float) -> Iterator[Candidate]:
    """Local interpolators on all points, then global ones on 1000, 2000, ... points."""
    kernel = best_kernel(data)
    for neighbours in NEIGHBOURS:
        if neighbours < len(data):
            yield _candidate(data, len(data), kernel, neighbours)
    yield from grow(
        lambda count: _candidate(data, count, kernel),
        family=FAMILY,
        points=len(data),
        gflop=gflop,
        gflop_of=fit_gflop,
        bytes_per_pair=BYTES_PER_PAIR,
    )
