"""Portable C source of a contact model, with a header and a small program that calls it ([EF15 §3.5] exports C++)."""

import re
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from string import Template
from textwrap import fill
from typing import Any

from casadi_contact.core.compiler import DATA_FILE
from casadi_contact.core.conventions import POSE_NAMES, POSE_UNITS, as_poses
from casadi_contact.core.files.writing import write_bytes, write_text
from casadi_contact.core.quantities import quantity
from casadi_contact.networks.kernel.source import ExportedModel, c_text, casadi_interface
from casadi_contact.networks.names import check_name, check_unused, comment_text, identifier, name_of_wrenches

TEMPLATES = f"{__package__}.c"
_EXAMPLE = "example"  # file of the program that calls the model


def pose_or_example(model: Any, pose: Sequence[float] | None) -> list[float]:
    """The pose, the model's own `example_pose()` for none; raises ValueError unless it is six finite numbers."""
    (checked,) = as_poses([model.example_pose() if pose is None else pose])
    return [float(value) for value in checked]


def c_source(model: ExportedModel, name: str) -> str:
    """One C file: the model, its functions by name, and the interface of casadi.external."""
    words, functions = template_words(model, name), c_text("export_api.c", TEMPLATES)
    suffixes = ("", *re.findall(r"\$\{name\}(\w+)", functions))
    check_unused(name, f"{model.source}\n{functions}\n{casadi_interface({})}", suffixes=suffixes)
    # What casadi.external finds in the file: loads, root loads, and both.
    loads, roots = {"loads": len(model.load_names)}, {"roots": len(model.patch_names)}
    found = {name: loads, f"{name}_root_loads": roots, f"{name}_loads_and_roots": loads | roots}
    calibrated = f"#define CALIBRATED_MODEL {int(model.calibrated)}"
    own = Template(functions).substitute(words)
    return "\n".join([_written(words), model.source, calibrated, own, casadi_interface(found)])


def header(model: ExportedModel, name: str) -> str:
    """The header of that file."""
    return Template(c_text("export_api.h", TEMPLATES)).safe_substitute(template_words(model, name))


def template_words(model: ExportedModel, name: str) -> dict[str, object]:
    """Values of the templates' placeholders; raises ValueError for a name that C or CasADi does not accept."""
    check_name(name)
    loads, units, listed = _with_units(model.load_names)
    pressures, pressure_units, of_pressure = _with_units(model.pressure_names)
    of_pressure += "; out of contact zero, and the centre of pressure (cop) NaN"
    wrapped = fill(of_pressure, 108, subsequent_indent=" *           ")
    patches = [identifier(patch) for patch in model.patch_names]
    return {
        "name": name,
        "guard": name.upper(),
        "count": len(loads),
        "patch_count": len(patches),
        "description": comment_text(model.description),
        "compiler": "C99 with the vectors of GCC and clang, libm" if model.vectors else "Plain C99, libm",
        "warnings": "-Wall -Wextra -Wno-psabi" if model.vectors else "-Wall -Wextra -pedantic",
        "version": version("casadi_contact"),
        "pose": ", ".join(f"{n} [{unit}]" for n, unit in zip(POSE_NAMES, POSE_UNITS, strict=True)),
        "loads": listed,
        "units": ", ".join(units),
        "patches": ", ".join(patches),
        "reference_load": f"{model.reference_load:g}",
        "no_confidence": "" if model.calibrated else "; NaN: this model has neither",
        "learned": comment_text(model.made_for),
        "names": _quoted(loads),
        "unit_names": _quoted(units),
        "patch_names": _quoted(patches),
        "pressures": wrapped if pressures else "none: this model has no integrals of pressure",
        "pressure_count": len(pressures),
        "pressure_names": _quoted(pressures),
        "pressure_unit_names": _quoted(pressure_units),
        "wrenches": f" {name_of_wrenches(name)}.c" if model.wrench_source else "",
    }


def _written(words: Mapping[str, object]) -> str:
    """The first line of a C file."""
    return f"/* {words['description']} Written by casadi_contact {words['version']}. */"


def _with_units(names: Sequence[str]) -> tuple[list[str], list[str], str]:
    """Names and units in C, and both in words."""
    found, units = [identifier(name) for name in names], [quantity(name).kind.plain_unit for name in names]
    return found, units, ", ".join(f"{name} [{unit}]" for name, unit in zip(found, units, strict=True))


def _quoted(names: Sequence[str]) -> str:
    return ", ".join(f'"{name}"' for name in names)


def export_c(
    model: Any,
    folder: str | Path,
    name: str | None = None,
    loads: Iterable[str] | None = None,
    example_pose: Sequence[float] | None = None,
) -> list[Path]:
    """Write ``name.c`` and ``name.h``, ``example.c``, a ``Makefile`` and ``name_mex.c`` for MATLAB and Octave, and of a
    model with `wrench_source` ``name_patch_wrenches.c``; return their paths in folder.

    model: a surrogate, or what `cc.foundation` chooses. Left out: the model's own name, all loads, and `example_pose()`
    as the pose at which ``example.c`` evaluates it. C99 without dependencies: pose (6) -> loads, Jacobian, weighted
    Hessian, root loads, validity and expected error, each with a status, and pressures. casadi.external, and code that
    CasADi generates, find ``name`` (loads), ``name_root_loads``, ``name_loads_and_roots``, ``name_patch_wrenches``.
    Raises ValueError for an unusable name and a pose that is not six finite numbers."""
    exported, pose = model.exported(loads), pose_or_example(model, example_pose)
    name = name or exported.name
    if name == _EXAMPLE:
        raise ValueError(f"function name {name!r} is not usable, {_EXAMPLE}.c is the example program: choose another")
    words = template_words(exported, name) | {"example_pose": ", ".join(map(repr, pose))}
    texts = {
        f"{name}.h": header(exported, name),
        f"{name}.c": c_source(exported, name),
        f"{name}_mex.c": Template(c_text("export_mex.c", TEMPLATES)).substitute(words),
        f"{_EXAMPLE}.c": Template(c_text("export_example.c", TEMPLATES)).substitute(words),
        "Makefile": Template(c_text("export_makefile", TEMPLATES)).safe_substitute(words),
    }
    if exported.wrench_source:
        # Another C file: the wrenches of all patches, as casadi.external takes them.
        interface = casadi_interface({name_of_wrenches(name): {"loads": 6 * len(exported.patch_names)}})
        texts[f"{name_of_wrenches(name)}.c"] = "\n".join([_written(words), exported.wrench_source, interface])
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for file_name, text in texts.items():
        write_text(folder / file_name, text)
    if exported.data:
        write_bytes(folder / DATA_FILE, exported.data)
    return sorted(folder / file_name for file_name in (*texts, *([DATA_FILE] if exported.data else [])))
