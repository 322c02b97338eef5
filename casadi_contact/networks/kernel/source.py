"""A kernel's C: what a surrogate's structure gives, put together into one file without dependencies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources

import numpy as np

from casadi_contact.networks.kernel.network_functions import (
    LANES,
    activation_loops,
    bundle_functions,
    network_functions,
)
from casadi_contact.networks.kernel.networks import WIDTH, Bundle


def c_text(name: str, package: str = f"{__package__}.c") -> str:
    """A C file that lies in a package: the core's own, or a structure's template."""
    return resources.files(package).joinpath(name).read_text("utf-8")


@dataclass(frozen=True)
class Kernel:
    """Networks, and C code that calls them and defines four functions for LOADS loads and ROOTS root loads:

    kernel_value(pose, loads, roots), kernel_jacobian(pose, loads, roots, loads_jacobian, roots_jacobian),
    kernel_hessian(pose, loads_weight, roots_weight, hessian): of the weighted sum, 6 x 6 in full,
    kernel_batch(pose, loads, roots): LANES poses at once. With ROOTS 0 the roots are neither computed nor touched.
    """

    bundles: Sequence[Bundle]
    code: str

    def source(self, *, loads: int, roots: int) -> str:
        """C99 up to guarded_value, _jacobian, _hessian and _batch: the four, and NaN where a pose is not finite."""
        widest = max(group.shape.widest for bundle in self.bundles for group in bundle.groups)
        sizes = {"LOADS": loads, "ROOTS": roots, "WIDEST": widest, "WIDTH": WIDTH, "LANES": LANES}
        definitions = "\n".join(f"#define {name} {value}" for name, value in sizes.items())
        networks = "\n\n".join([network_functions(self.bundles), *map(bundle_functions, self.bundles)])
        head = [definitions, "", c_text("core.h"), c_text("batch.h")]
        return "\n".join([*head, networks, "", self.code, c_text("guards.h")])


@dataclass(frozen=True)
class ExportedModel:
    """C of a contact model, and what a header must say of it (see the room `export`).

    name: default name of files and functions, unlike that of any other model.
    source: C99 up to guarded_value and its like, for these loads and `kernel_roots` root loads; patch_roots where there
    are roots; confidence_at where it is calibrated; outside(pose, parts), which is 0 for a pose that the model
    is made for. made_for says in words when it is. pressure_names: where there are any, source defines
    pressures_at(pose, pressures) for them. vectors: source needs the vectors of GCC and clang. data: what
    the source includes as the file DATA_FILE of the folder in which it is compiled. wrench_source: C of a kernel whose
    loads are the wrenches of all patches, for CasADi functions with parameters; none where the model has none of these.
    """

    name: str
    source: str
    load_names: Sequence[str]
    patch_names: Sequence[str]
    kernel_roots: int
    calibrated: bool
    made_for: str
    reference_load: float
    description: str
    vectors: bool = False
    data: bytes = b""
    pressure_names: Sequence[str] = ()
    wrench_source: str = ""


def table(name: str, numbers: np.ndarray) -> str:
    """Numbers as a C array of their own shape: of int or double."""
    kind = "int" if numbers.dtype.kind == "i" else "double"
    sizes = "".join(f"[{size}]" for size in numbers.shape)
    return f"static const {kind} {name}{sizes} = {_braces(numbers)};"


def _braces(table: np.ndarray) -> str:
    if table.ndim > 1:
        return "{" + ",\n  ".join(map(_braces, table)) + "}"
    return "{" + ", ".join("NAN" if value != value else repr(value) for value in table.tolist()) + "}"


def roots_source(first_parts: Sequence[int], count: int) -> str:
    """C function patch_roots, and the table first_part of the `count` root loads that a kernel gives."""
    return f"{table('first_part', np.array([*first_parts, count]))}\n" + c_text("roots.h")


def sigmoid_source(activation: str) -> str:
    """C function sigmoids(repeats, n, z): the kernel's sigmoid loop alone, to measure the rate of this machine."""
    definitions = "".join(f"#define {name} 8\n" for name in ("WIDEST", "WIDTH"))
    text = f"{c_text('core.h')}\n{activation_loops(activation)}"
    loop = f"for (int i = 0; i < repeats; i++) {activation}_0(n, z);"
    return f"{definitions}{text}\nvoid sigmoids(int repeats, int n, double *z) {{ {loop} }}\n"
