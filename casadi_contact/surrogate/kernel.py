"""A surrogate in C: loads, root loads of its patches, validity and expected error (``confidence.h``); compiled, over
arrays of poses on all cores.

That is done from `BATCH_FROM` poses on, whatever the cache holds, so that the same call gives the same bits each time:
NumPy takes 20 ms for that many, and compiling once some seconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np

from casadi_contact.core.compiler import CompilerError, shared_library, warn_once
from casadi_contact.core.conventions import Array
from casadi_contact.core.threads import call_in_shares
from casadi_contact.networks.kernel.networks import filled_up
from casadi_contact.networks.kernel.source import Kernel, c_text, external_function, roots_source, table
from casadi_contact.surrogate.confidence import SURE, Confidence

BATCH_FROM = 1000
# Of most structures: the root loads of the kernel.
OWN_ROOTS = """\
INLINE void confidence_roots(const double *pose, const double *parts, double *roots) {
  (void)pose;
  patch_roots(first_part, parts, roots, 0);
}
"""
_OUTSIDE = """\
INLINE int outside(const double *pose, const double *parts) {{
  (void)pose, (void)parts;
  return {condition};
}}
"""


@dataclass(frozen=True)
class SurrogateKernel:
    """kernel: of the loads and of root loads, those of patch p from bounds[p] to bounds[p + 1] (none where networks are
    missing); confidence: None for a surrogate that was not calibrated, whose loads are calibrated_loads;
    confidence_roots: C function that gives the root loads of the patches from the pose and the kernel's root loads.
    """

    kernel: Kernel
    loads: Sequence[str]
    calibrated_loads: Sequence[str]
    bounds: Sequence[int]
    confidence: Confidence | None
    confidence_roots: str

    @property
    def root_count(self) -> int:
        """Number of root loads that the kernel gives."""
        return self.bounds[-1] if self.bounds else 0

    def source(self) -> str:
        """C99 up to guarded_value and its like; patch_roots where there are roots; confidence_at where it was
        calibrated."""
        parts = [self.kernel.source(loads=len(self.loads), roots=self.root_count)]
        if self.root_count:
            parts.append(f"#define PATCHES {len(self.bounds) - 1}")
            parts.append(roots_source(self.bounds))
        if self.confidence is not None:
            parts.append(self._confidence_source(self.confidence))
        return "\n".join(parts)

    def _confidence_source(self, confidence: Confidence) -> str:
        """C function confidence_at(pose, parts, errors) -> validity. Raises ValueError for arrays of other shapes than
        the patches and loads have."""
        known = self.calibrated_loads
        confidence.check_shapes(len(self.bounds) - 1, len(known))
        numbers = {
            "CENTRES": len(confidence.centres),
            "CONFIDENCE_COLUMNS": len(confidence.columns),
            "CALIBRATED": len(known),
            "BANDWIDTH": float(confidence.bandwidth),
            "SHARPNESS": float(confidence.sharpness),
            "EDGE": float(confidence.edge),
            "SURE": SURE,
        }
        tables = {
            "whitening": confidence.whitening,
            "centres": filled_up(confidence.centres.T),
            "confidence_columns": confidence.columns.astype(int),
            "calibrated_load": np.array([known.index(load) if load in known else -1 for load in self.loads]),
            "growth": confidence.growth,
        }
        parts = [f"#define {name} ({value!r})" for name, value in numbers.items()]
        parts += [table(name, np.asarray(values)) for name, values in tables.items()]
        return "\n".join([*parts, self.confidence_roots, c_text("confidence.h", __package__)])

    def outside(self) -> tuple[str, str]:
        """C function outside(pose, parts), 1 for a pose that was not learned, as validity says; and in words when it is
        0."""
        if self.confidence is None:
            return _OUTSIDE.format(condition="0"), "unknown: this surrogate was never calibrated"
        return _OUTSIDE.format(condition="!(confidence_at(pose, parts, 0) >= 0.5)"), "validity of at least 1/2"


@dataclass(frozen=True)
class SurrogateArrays:
    """A compiled library of `load_names`; poses are (n, 6)."""

    library: Path
    load_names: Sequence[str]
    root_count: int

    def function(self, name: str, outputs: Sequence[str], frames: int) -> ca.Function:
        """casadi.Function pose (6 x frames) -> outputs, "loads" and/or "roots" (of the kernel)."""
        sizes = {"loads": len(self.load_names), "roots": self.root_count}
        return external_function(self.library, name, sizes, outputs, frames)

    def loads(self, poses: Array, names: Sequence[str]) -> Array:
        """Loads (n, L) by name."""
        loads = np.empty((len(poses), len(self.load_names)))
        call_in_shares(self.library, "values_of", poses, loads, None)
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
    try:
        library = shared_library("\n".join(["#define ENTRY", kernel.source(), c_text("arrays.h")]), waited_for)
    except CompilerError as error:
        warn_once(f"{error}; NumPy and the CasADi graph take the kernel's place, which are slower")
        return None
    return SurrogateArrays(library, tuple(kernel.loads), kernel.root_count)
