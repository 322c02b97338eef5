"""A surrogate over arrays of poses by its C kernel, on all cores.

From `BATCH_FROM` poses on, whatever the cache holds, so that the same call gives the same bits each time: NumPy takes
20 ms for that many, and compiling once some seconds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar, cast

import numba
import numpy as np

from casadi_contact.core.compiler import CompilerError, call_in_shares, shared_library, warn_once
from casadi_contact.core.conventions import Array
from casadi_contact.networks.kernel.source import c_text
from casadi_contact.surrogate.surrogate_kernel import SurrogateKernel

BATCH_FROM = 1000


@dataclass(frozen=True)
class SurrogateArrays:
    """A compiled library of `load_names`; poses are (n, 6)."""

    library: Path
    load_names: Sequence[str]

    def loads(self, poses: Array, names: Sequence[str]) -> Array:
        """Loads (n, L) by name."""
        loads = np.empty((len(poses), len(self.load_names)))
        call_in_shares(self.library, "array_values", poses, loads, None)
        return self._picked(loads, names)

    def jacobian(self, poses: Array, names: Sequence[str]) -> tuple[Array, Array]:
        """Loads (n, L) and their derivatives (n, L, 6)."""
        loads = np.empty((len(poses), len(self.load_names)))
        slopes = np.empty((*loads.shape, 6))
        call_in_shares(self.library, "array_jacobians", poses, loads, slopes)
        return self._picked(loads, names), self._picked(slopes, names)

    def hessian(self, poses: Array, weights: Array, names: Sequence[str]) -> Array:
        """Second derivatives (n, 6, 6) of Σ weights·loads for weights (n, L)."""
        all_weights = np.zeros((len(poses), len(self.load_names)))
        for column, name in enumerate(names):  # a name may come twice
            all_weights[:, self.load_names.index(name)] += weights[:, column]
        hessians = np.empty((len(poses), 6, 6))
        call_in_shares(self.library, "array_hessians", poses, all_weights, hessians)
        return hessians

    def validity(self, poses: Array) -> Array:
        """Validity (n,)."""
        validity = np.empty(len(poses))
        call_in_shares(self.library, "array_confidence", poses, validity, None)
        return validity

    def expected_error(self, poses: Array) -> Array:
        """Expected error (n, L) of all loads."""
        validity, errors = np.empty(len(poses)), np.empty((len(poses), len(self.load_names)))
        call_in_shares(self.library, "array_confidence", poses, validity, errors)
        return errors

    def _picked(self, values: Array, names: Sequence[str]) -> Array:
        if tuple(names) == tuple(self.load_names):
            return values
        return values[:, [self.load_names.index(name) for name in names]]


def compiled_arrays(kernel: SurrogateKernel, waited_for: str) -> SurrogateArrays | None:
    """The compiled kernel; None, with one warning, without a compiler. waited_for: what is announced."""
    confidence = c_text("confidence_arrays.h", __package__) if kernel.confidence is not None else ""
    try:
        library = shared_library("\n".join([kernel.source(), c_text("arrays.h"), confidence]), waited_for)
    except CompilerError as error:
        warn_once(f"{error}; arrays of poses go through NumPy, which is slower")
        return None
    return SurrogateArrays(library, tuple(kernel.loads))


_ROWS = 2000  # whatever the number of threads, so that this does not change a bit of the results
_Arrays = TypeVar("_Arrays", bound=Array | tuple[Array, ...])


def map_in_chunks(function: Callable[[Array], _Arrays], poses: Array) -> _Arrays:
    """What a function of poses (n, 6) returns, an array (n, ...) or a tuple of such, from blocks of the poses."""
    if len(poses) <= _ROWS:
        return function(poses)
    blocks = [poses[first : first + _ROWS] for first in range(0, len(poses), _ROWS)]
    with ThreadPoolExecutor(numba.get_num_threads()) as pool:
        found = list(pool.map(function, blocks))
    if isinstance(found[0], tuple):
        return cast(_Arrays, tuple(np.concatenate(parts) for parts in zip(*found, strict=True)))
    return cast(_Arrays, np.concatenate(found))
