"""The models of a page as C, and the functions that the page calls: ``live/web/kernel.js`` is the other side."""

from __future__ import annotations

from casadi_contact.contact.cells.foundation import CellFoundation
from casadi_contact.contact.compiled_foundation import CompiledFoundation
from casadi_contact.contact.cup.foundation import CupFoundation
from casadi_contact.contact.foundation_source import C_FOLDER
from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.core.compiler import DATA_FILE
from casadi_contact.networks.export_c import ExportedModel
from casadi_contact.networks.kernel.source import c_text
from casadi_contact.pictures.live.webassembly import webassembly
from casadi_contact.surrogate.base import Surrogate

CONTACT, SURROGATE = "contact", "surrogate"
_FUNCTIONS = ("loads", "jacobian", "roots", "confidence")
_DEPTHS = ((PolarFoundation, "polar_depths.h"), (CupFoundation, "cup_depths.h"), (CellFoundation, "cells_depths.h"))


def page_kernel(contact: CompiledFoundation, surrogate: Surrogate | None) -> bytes:
    """WebAssembly of the exported C of both models, and of the contact model's pressures.

    Raises like `webassembly`, and ValueError for a pressure law without C.
    """
    exported = contact.exported()
    files: dict[str, str | bytes] = _files(exported, CONTACT)
    names = [f"{CONTACT}_{function}" for function in _FUNCTIONS]
    depths = next(name for kind, name in _DEPTHS if isinstance(contact, kind))
    names += [f"{CONTACT}_pressures", "foundation_pressures"]
    texts = [exported.c_source(CONTACT), *(c_text(name, C_FOLDER) for name in (depths, "depths.h"))]
    files[f"{CONTACT}.c"] = "\n".join(texts)
    if exported.data:
        files[DATA_FILE] = exported.data
    if surrogate is not None:
        files |= _files(surrogate.exported(), SURROGATE)
        names += [f"{SURROGATE}_{function}" for function in _FUNCTIONS]
    return webassembly(files, names)


def _files(model: ExportedModel, name: str) -> dict[str, str | bytes]:
    return {f"{name}.c": model.c_source(name), f"{name}.h": model.header(name)}
