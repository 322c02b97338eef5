"""What a page computes with: the scene's contact model, its arrays, and its C compiled to WebAssembly."""

import base64
import gzip
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.contact.cells.basis import Cells
from casadi_contact.contact.cells.foundation import CellFoundation
from casadi_contact.contact.cells.source import cell_source
from casadi_contact.contact.choice import foundation
from casadi_contact.contact.compiled_foundation import CompiledFoundation
from casadi_contact.contact.cup import CupFoundation
from casadi_contact.contact.foundation_source import C_FOLDER
from casadi_contact.contact.polar.foundation import PolarFoundation
from casadi_contact.core.compiler import DATA_FILE, run_compiler
from casadi_contact.core.conventions import Array
from casadi_contact.core.files.writing import write_bytes
from casadi_contact.export.c_source import c_source, header
from casadi_contact.geometry.distance_field import field_parts
from casadi_contact.geometry.moving_surface import MESH_FIELD, MovingSurface
from casadi_contact.networks.kernel.source import ExportedModel, c_text
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.base import Surrogate

_KINDS = {"f4": np.float32, "f8": np.float64, "u4": np.uint32, "u1": np.uint8}
_ALIGNED = 8


def packed(arrays: Mapping[str, np.ndarray]) -> tuple[list[dict[str, Any]], str]:
    """An index of name, kind, offset and count of each array, and base64 of their bytes, compressed; always the same
    for the same arrays. Raises KeyError for a type that the page has none for."""
    kinds = {np.dtype(kind): name for name, kind in _KINDS.items()}
    index, data = [], b""
    for name, array in arrays.items():
        data += bytes(-len(data) % _ALIGNED)
        index.append({"name": name, "kind": kinds[array.dtype], "offset": len(data), "count": array.size})
        data += array.tobytes()
    return index, base64.b64encode(gzip.compress(data, compresslevel=9, mtime=0)).decode("ascii")


CONTACT, SURROGATE = "contact", "surrogate"
_FUNCTIONS = ("loads", "jacobian", "roots", "confidence")
_DEPTHS = ((PolarFoundation, "polar_depths.h"), (CupFoundation, "cup_depths.h"), (CellFoundation, "cells_depths.h"))


def page_kernel(contact: CompiledFoundation, surrogate: Surrogate | None) -> bytes:
    """WebAssembly of the exported C of both models, and of the contact model's pressures. Raises like `webassembly`,
    and ValueError for a pressure law without C."""
    exported = contact.exported()
    files: dict[str, str | bytes] = _files(exported, CONTACT)
    names = [f"{CONTACT}_{function}" for function in _FUNCTIONS]
    depths = next(name for kind, name in _DEPTHS if isinstance(contact, kind))
    names += [f"{CONTACT}_pressures", "foundation_pressures"]
    texts = [c_source(exported, CONTACT), *(c_text(name, C_FOLDER) for name in (depths, "depths.h"))]
    files[f"{CONTACT}.c"] = "\n".join(texts)
    if exported.data:
        files[DATA_FILE] = exported.data
    if surrogate is not None:
        files |= _files(surrogate.exported(), SURROGATE)
        names += [f"{SURROGATE}_{function}" for function in _FUNCTIONS]
    return webassembly(files, names)


def _files(model: ExportedModel, name: str) -> dict[str, str | bytes]:
    return {f"{name}.c": c_source(model, name), f"{name}.h": header(model, name)}


# No -ffast-math, as for every kernel. Vectors of 128 bits run in every browser since 2021 (Safari 2023).
_FLAGS = ("-std=gnu99", "-O2", "-g0", "-s", "-fno-math-errno", "-fno-trapping-math", "-msimd128", "-Wno-psabi")
_TARGET = ("-target", "wasm32-wasi", "-mexec-model=reactor")


def webassembly(files: Mapping[str, str | bytes], exports: Sequence[str]) -> bytes:
    """A WebAssembly module of C sources and what they include (by file name), with the named functions. It imports
    nothing; its memory from ``__heap_base`` on is the caller's. Raises ImportError without the package `ziglang`,
    CompilerError (an OSError) where its compiler refuses."""
    if find_spec("ziglang") is None:
        raise ImportError("a page is compiled by ziglang, which is missing: pip install casadi_contact[page]")
    with tempfile.TemporaryDirectory() as folder:
        for name, content in files.items():
            write_bytes(Path(folder) / name, content.encode() if isinstance(content, str) else content)
        sources = [name for name in files if name.endswith(".c")]
        exported = [f"-Wl,--export={name}" for name in (*exports, "__heap_base")]
        command = [sys.executable, "-m", "ziglang", "cc", *_TARGET, *_FLAGS, "-o", "kernel.wasm", *sources, *exported]
        run_compiler(command, Path(folder))
        return (Path(folder) / "kernel.wasm").read_bytes()


FARTHEST_MM = 3.0  # at which the distance from a mesh ends: what lies farther off is as far
_NEAR_MM = 1.5  # of the surface: here the field counts for loads, farther off for gaps
_NEAR_STEP_MM, _FAR_STEP_MM = 2.0**-12, 2.0**-3  # that coefficients are rounded to, so that they compress
_CELLS = Cells(2.4, 0.85)


class PageCells(CellFoundation):
    """Cubic cells of meshes, the distance field rounded to about 0.1 µm near the surface, none beyond `FARTHEST_MM`."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene, _CELLS)
        self.patches = [
            replace(patch, body=MovingSurface(MESH_FIELD, _rounded(patch.body.parameters))) for patch in self.patches
        ]

    @cached_property
    def _code(self) -> tuple[str, bytes]:
        return cell_source(self.patches, with_tangents=False)


def page_contact(scene: Scene) -> CompiledFoundation:
    """`foundation` of a scene, or for meshes `PageCells`: the page's numbers are those of this model. Raises ValueError
    for a shape that has none."""
    return PageCells(scene) if scene.shape == "mesh" else foundation(scene)


def _rounded(parameters: Array) -> Array:
    """A field's parameters with few digits: all that are needed near the surface, and hardly any elsewhere."""
    _, _, coefficients, bounds = field_parts(parameters)
    step = np.where(np.abs(coefficients) < _NEAR_MM, _NEAR_STEP_MM, _FAR_STEP_MM)
    rounded = np.clip(np.round(coefficients / step) * step, -FARTHEST_MM, FARTHEST_MM)
    head = parameters[: len(parameters) - 2 * coefficients.size]
    return np.concatenate([head, rounded.ravel(), bounds.ravel()])
