"""Portable C source of a contact model, with a header and a small program that calls it ([EF15 §3.5] exports C++)."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from string import Template
from textwrap import fill

import numpy as np

from casadi_contact.core.compiler import DATA_FILE
from casadi_contact.core.conventions import POSE_NAMES, POSE_UNITS
from casadi_contact.core.files.writing import write_bytes, write_text
from casadi_contact.core.quantities import quantity
from casadi_contact.networks.kernel.casadi_interface import casadi_interface
from casadi_contact.networks.kernel.source import c_text
from casadi_contact.networks.names import (
    UNNAMED,
    check_name,
    check_unused,
    comment_text,
    identifier,
    name_of_parts,
    name_of_wrenches,
)

_EXAMPLE = "example"  # file of the program that calls the model


@dataclass(frozen=True)
class ExportedModel:
    """C of a contact model, and what a header must say of it.

    source: C99 up to guarded_value and its like, for these loads and `kernel_roots` root loads; patch_roots where there
    are roots; confidence_at where it is calibrated; outside(pose, parts), which is 1 for a pose that the model
    is made for. made_for says in words when it is. pressure_names: where there are any, source defines
    pressures_at(pose, pressures) for them. vectors: source needs the vectors of GCC and clang. data: what
    the source includes as the file DATA_FILE of the folder in which it is compiled. wrench_source: C of a kernel whose
    loads are the wrenches of all patches, for CasADi functions with parameters; none where the model has none of these.
    """

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

    def c_source(self, name: str) -> str:
        """One C file: the model, its functions by name, and the interface of casadi.external."""
        words, functions = self.words(name), c_text("export_api.c")
        shared = casadi_interface(self._casadi_functions(UNNAMED))
        suffixes = ("", *re.findall(r"\$\{name\}(\w+)", functions))
        check_unused(name, f"{self.source}\n{shared}", suffixes=suffixes)
        parts = [
            _written(words),
            self.source,
            f"#define CALIBRATED_MODEL {int(self.calibrated)}",
            Template(functions).substitute(words),
        ]
        return "\n".join([*parts, casadi_interface(self._casadi_functions(name))])

    def wrench_c_source(self, name: str) -> str:
        """Another C file: the wrenches of all patches, as casadi.external takes them."""
        outputs = {"loads": 6 * len(self.patch_names)}
        parts = [_written(self.words(name)), self.wrench_source, casadi_interface({name_of_wrenches(name): outputs})]
        return "\n".join(parts)

    def _casadi_functions(self, name: str) -> dict[str, dict[str, int]]:
        """What casadi.external finds in the file: loads, and where there are roots, these alone and with the loads."""
        loads, roots = {"loads": len(self.load_names)}, {"roots": self.kernel_roots}
        functions = {name: loads}
        if self.kernel_roots:
            named = f"{name}_root_loads", f"{name}_loads_and_roots"
            if self.kernel_roots > len(self.patch_names):
                named = name_of_parts(named[0]), name_of_parts(named[1])
            functions |= dict(zip(named, (roots, loads | roots), strict=True))
        return functions

    def header(self, name: str) -> str:
        """The header of that file."""
        return Template(c_text("export_api.h")).safe_substitute(self.words(name))

    def words(self, name: str) -> dict[str, object]:
        """What the templates ask for; raises ValueError for a name that C or CasADi refuses."""
        check_name(name)
        loads, units = _with_units(self.load_names)
        pressures, pressure_units = _with_units(self.pressure_names)
        patches = [identifier(patch) for patch in self.patch_names]
        return {
            "name": name,
            "guard": name.upper(),
            "guard_OK": f"{name.upper()}_OK",
            "guard_OUTSIDE": f"{name.upper()}_OUTSIDE",
            "guard_NOT_FINITE": f"{name.upper()}_NOT_FINITE",
            "count": len(loads),
            "patch_count": len(patches),
            "description": comment_text(self.description),
            "compiler": "C99 with the vectors of GCC and clang, libm" if self.vectors else "Plain C99, libm",
            "warnings": "-Wall -Wextra -Wno-psabi" if self.vectors else "-Wall -Wextra -pedantic",
            "version": version("casadi_contact"),
            "pose": ", ".join(f"{n} [{unit}]" for n, unit in zip(POSE_NAMES, POSE_UNITS, strict=True)),
            "loads": _listed(loads, units),
            "units": ", ".join(units),
            "patches": ", ".join(patches),
            "reference_load": f"{self.reference_load:g}",
            "no_roots": "" if self.kernel_roots else "; NaN: this model lacks their networks",
            "no_confidence": "" if self.calibrated else "; NaN: this model has neither",
            "learned": comment_text(self.made_for),
            "names": _quoted(loads),
            "unit_names": _quoted(units),
            "patch_names": _quoted(patches),
            "pressures": _pressures(pressures, pressure_units),
            "pressure_count": len(pressures),
            "pressure_names": _quoted(pressures),
            "pressure_unit_names": _quoted(pressure_units),
            "wrenches": f" {name_of_wrenches(name)}.c" if self.wrench_source else "",
        }


def _written(words: Mapping[str, object]) -> str:
    """The first line of a C file."""
    return f"/* {words['description']} Written by casadi_contact {words['version']}. */"


def _with_units(names: Sequence[str]) -> tuple[list[str], list[str]]:
    return [identifier(name) for name in names], [quantity(name).kind.plain_unit for name in names]


def _listed(names: Sequence[str], units: Sequence[str]) -> str:
    return ", ".join(f"{name} [{unit}]" for name, unit in zip(names, units, strict=True))


def _pressures(names: Sequence[str], units: Sequence[str]) -> str:
    """What the header's comment says of them."""
    if not names:
        return "none: this model has no integrals of pressure"
    text = f"{_listed(names, units)}; out of contact zero, and the centre of pressure (cop) NaN"
    return fill(text, 108, subsequent_indent=" *           ")


def _quoted(names: Sequence[str]) -> str:
    return ", ".join(f'"{name}"' for name in names)


def export_c(model: ExportedModel, folder: str | Path, *, name: str, example_pose: Sequence[float]) -> list[Path]:
    """Write ``name.c`` and ``name.h``, ``example.c``, a ``Makefile`` and ``name_mex.c`` for MATLAB and Octave.

    ``name_patch_wrenches.c`` too where the model has `wrench_source`. Returns their paths in folder.

    C99 without dependencies: pose (6) -> loads, Jacobian, weighted Hessian, root loads, validity and expected error,
    each with a status, and pressures where the model has them. casadi.external, and code that CasADi generates, find
    ``name`` (loads), ``name_root_loads``, ``name_loads_and_roots`` and ``name_patch_wrenches`` there.
    Raises ValueError for an unusable name, OSError where folder cannot be written.
    """
    if name == _EXAMPLE:
        raise ValueError(f"function name {name!r} is not usable, {_EXAMPLE}.c is the example program: choose another")
    words = model.words(name)
    words["example_pose"] = ", ".join(repr(float(np.float64(value))) for value in example_pose)
    texts = {
        f"{name}.h": model.header(name),
        f"{name}.c": model.c_source(name),
        f"{name}_mex.c": Template(c_text("export_mex.c")).substitute(words),
        f"{_EXAMPLE}.c": Template(c_text("export_example.c")).substitute(words),
        "Makefile": Template(c_text("export_makefile")).safe_substitute(words),
    }
    if model.wrench_source:
        texts[f"{name_of_wrenches(name)}.c"] = model.wrench_c_source(name)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for file_name, text in texts.items():
        write_text(folder / file_name, text)
    if model.data:
        write_bytes(folder / DATA_FILE, model.data)
    return sorted(folder / file_name for file_name in (*texts, *([DATA_FILE] if model.data else [])))
