"""A surrogate in C: loads, root loads, validity and expected error, compiled, over arrays of poses on all cores.

That is done from `BATCH_FROM` poses on, whatever the cache holds, so that the same call gives the same bits each time:
NumPy takes 20 ms for that many, and compiling once some seconds.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import casadi as ca
import numpy as np

from casadi_contact.core.compiler import CompilerError, shared_library, warn_once
from casadi_contact.core.conventions import Array
from casadi_contact.core.threads import call_in_shares
from casadi_contact.networks.kernel.networks import Bundle, filled_up, padded
from casadi_contact.networks.kernel.source import Kernel, c_text, external_function, guards, table
from casadi_contact.surrogate.confidence import SURE, Confidence
from casadi_contact.surrogate.patch.networks import with_all_inputs

BATCH_FROM = 1000
OF_CONFIDENCE, OWN = "confidence_", "own_"  # what names of C functions begin with: see `Kernel`


def confidence_kernel(
    confidence: Confidence, loads: Sequence[str], calibrated_loads: Sequence[str], patches: int, own: Kernel | None
) -> Kernel:
    """C of the expected errors of loads, some of calibrated_loads, and of validity, beside a kernel that gives root
    loads; own: another of these alone, where confidence depends on others (its names begin with `OWN`).

    Raises ValueError for arrays of other shapes than the patches and loads have.
    """
    confidence.check_shapes(patches, len(calibrated_loads))
    inputs = [*confidence.columns.astype(int), *range(6, 6 + patches)]
    network = with_all_inputs(confidence.network, inputs, 6 + patches)
    known = [calibrated_loads.index(load) for load in loads]
    outputs = [0, *(1 + k for k in known)]
    network = replace(
        network,
        weights=(*network.weights[:-1], network.weights[-1][outputs]),
        biases=(*network.biases[:-1], network.biases[-1][outputs]),
        output_scale=np.broadcast_to(network.output_scale, network.outputs)[outputs],
    )
    numbers = {
        "PADDED_CENTRES": padded(len(confidence.centres)),
        "SHARPNESS": float(confidence.sharpness),
        "EDGE": float(confidence.edge),
        "SURE": SURE,
    }
    centres = confidence.centres.T / confidence.bandwidth
    half = 0.5 * (centres**2).sum(axis=0)
    tables = {
        "whitening": confidence.whitening / confidence.bandwidth,
        "centres": filled_up(centres),
        "half_squares": np.pad(half, (0, padded(len(half)) - len(half)), constant_values=1e300),  # only fills up
        "growth": confidence.growth[known],
    }
    code = [own.code] if own else []
    code += [f"#define {name} ({value!r})" for name, value in numbers.items()]
    code += [table(name, values) for name, values in tables.items()]
    code += [f"#define ROOTS_OF(what) {OWN if own else ''}kernel_##what", c_text("confidence.h", __package__)]
    bundle = Bundle("confidence", 6 + patches, {"confidence": network})
    return Kernel([*(own.bundles if own else ()), bundle], "\n".join([*code, guards(OF_CONFIDENCE, roots="1")]))


@dataclass(frozen=True)
class SurrogateArrays:
    """A compiled library of `load_names`, with confidence where that is known; poses are (n, 6)."""

    library: Path
    load_names: Sequence[str]
    root_count: int

    def function(self, name: str, outputs: Sequence[str], frames: int) -> ca.Function:
        """casadi.Function pose (6 x frames) -> outputs, "loads" and/or "roots", or "expected_error" or "validity"."""
        kinds = {"": {"loads": 0, "roots": self.root_count}, OF_CONFIDENCE: {"expected_error": 0, "validity": 1}}
        before = next(kind for kind, sizes in kinds.items() if outputs[0] in sizes)
        sizes = {key: size or len(self.load_names) for key, size in kinds[before].items()}
        return external_function(self.library, name, sizes, outputs, frames, before)

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
        call_in_shares(self.library, f"{OF_CONFIDENCE}values_of", poses, None, validity)
        return validity

    def expected_error(self, poses: Array) -> Array:
        """Expected error (n, L) of all loads."""
        errors = np.empty((len(poses), len(self.load_names)))
        call_in_shares(self.library, f"{OF_CONFIDENCE}values_of", poses, errors, None)
        return errors

    def _picked(self, values: Array, names: Sequence[str]) -> Array:
        if tuple(names) == tuple(self.load_names):
            return values
        return values[:, [self.load_names.index(name) for name in names]]


def compiled_arrays(
    source: str, loads: Sequence[str], roots: int, said: str, called: str = ""
) -> SurrogateArrays | None:
    """The compiled kernel; None, with one warning, without a compiler. said: what is announced; called: C it calls."""
    try:
        linked = shared_library(called, said) if called else None
        library = shared_library("\n".join(["#define ENTRY", source]), said, linked=linked)
    except CompilerError as error:
        warn_once(f"{error}; NumPy and the CasADi graph take the kernel's place, which are slower")
        return None
    return SurrogateArrays(library, tuple(loads), roots)
