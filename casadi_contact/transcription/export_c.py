"""Portable C source of a kernel, with a header and a small program that calls it ([EF15 §3.5] exports C++)."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from string import Template

import numpy as np

from casadi_contact.conventions import POSE_NAMES
from casadi_contact.files import write_text
from casadi_contact.quantities import quantity
from casadi_contact.transcription.c_names import comment_text, identifier
from casadi_contact.transcription.functions import check_name
from casadi_contact.transcription.kernel.casadi_interface import casadi_interface
from casadi_contact.transcription.kernel.source import Kernel, c_text


def export_c(
    kernel: Kernel,
    folder: str | Path,
    *,
    name: str,
    load_names: Sequence[str],
    example_pose: Sequence[float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    description: str = "Joint contact loads of a pose.",
) -> list[Path]:
    """Write ``name.c`` and ``name.h``, ``example.c`` and a ``Makefile`` into folder; return their paths.

    C99 without dependencies: pose (6) -> loads, Jacobian, weighted Hessian; also loadable by casadi.external.
    Raises ValueError for an unusable name, OSError where folder cannot be written.
    """
    check_name(name)
    load_names = [identifier(load) for load in load_names]
    words = {
        "name": name,
        "guard": name.upper(),
        "count": len(load_names),
        "description": comment_text(description),
        "version": version("casadi_contact"),
        "pose": ", ".join(POSE_NAMES),
        "loads": ", ".join(load_names),
        "units": ", ".join(quantity(load).unit for load in load_names),
        "names": ", ".join(f'"{load}"' for load in load_names),
        "example_pose": ", ".join(repr(float(np.float64(value))) for value in example_pose),
    }
    source = Template(c_text("export_api.c")).substitute(words)
    texts = {
        f"{name}.h": Template(c_text("export_api.h")).substitute(words),
        f"{name}.c": "\n".join(
            [
                f"/* {words['description']} Written by casadi_contact {words['version']}. */",
                kernel.source(loads=len(load_names), roots=0),
                source,
                casadi_interface(name, {"loads": len(load_names)}),
            ]
        ),
        "example.c": Template(c_text("export_example.c")).substitute(words),
        "Makefile": Template(c_text("export_makefile")).safe_substitute(words),
    }
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for file_name, text in texts.items():
        write_text(folder / file_name, text)
    return sorted(folder / file_name for file_name in texts)
