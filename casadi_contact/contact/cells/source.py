"""The cubic cells of a scene's patches as C (``contact/c/cells.h``), and the tables that it reads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from casadi_contact.contact.c_text import braces
from casadi_contact.contact.cells import quadrature
from casadi_contact.contact.cells.basis import corner_shares, hermite_functions
from casadi_contact.contact.cells.patches import CellPatch
from casadi_contact.contact.cells.quadrature import Quadrature
from casadi_contact.contact.cells.tangents import BOW_REACH_MM, tangents
from casadi_contact.contact.culling import STEEPEST_FIELD
from casadi_contact.conventions import Array
from casadi_contact.geometry.distance_field import field_parts
from casadi_contact.geometry.field_derivatives import round_body
from casadi_contact.geometry.moving_surface import HALF_SPACE, MESH_FIELD, MovingSurface
from casadi_contact.transcription.kernel.compiler import DATA_FILE
from casadi_contact.transcription.kernel.source import c_text

_C = "casadi_contact.contact.c"
_LINE = 64  # bytes that tables begin at multiples of
_FACETED_MM = 0.01  # by which boxes are larger than the sub-points
_NODE = np.dtype([(name, float, size) for name, size in (("c", 3), ("n", 3), ("along", 6), ("bend", 6), ("loads", 7))])
_CELL = np.dtype(
    [("middle", float, 3), ("half", float, 3), ("corners", "i4", 4), ("present", "i4"), ("rim", "i4")], align=True
)
_BLOCK = np.dtype([("middle", float, 3), ("half", float, 3), ("first", "i4"), ("last", "i4")], align=True)
_INCLUDED = f"""\
#if defined(__wasm__)
static const _Alignas({_LINE}) char cells_data[] = {{
#embed "{DATA_FILE}"
}};
#elif defined(__APPLE__)
__asm__(".section __DATA,__const\\n.balign {_LINE}\\n_cells_data:\\n.incbin \\"{DATA_FILE}\\"\\n.text\\n");
#else
__asm__(".pushsection .rodata\\n.balign {_LINE}\\ncells_data:\\n.incbin \\"{DATA_FILE}\\"\\n.popsection\\n");
#endif
#if !defined(__wasm__)
extern const char cells_data[] __attribute__((visibility("hidden")));
#endif
"""


@dataclass
class _Tables:
    """Arrays one after the other."""

    data: bytes = b""

    def place(self, array: np.ndarray) -> int:
        """Add an array; where it begins."""
        start = len(self.data)
        self.data += array.tobytes()
        self.data += bytes(-len(self.data) % _LINE)
        return start


def cell_source(patches: Sequence[Quadrature], *, with_tangents: bool = True) -> tuple[str, bytes]:
    """C that defines `patch_loads`, and its data; with_tangents: False for half the data of a mesh, and more time."""
    tables, cells, law = _Tables(), patches[0].cells, patches[0].law
    functions, shares = hermite_functions(cells).T, corner_shares(cells).T
    whole = law[1] / law[2] * shares.T @ functions
    body = _body(patches[0].body, tables, with_tangents)
    rows = [_patch(quad.patch, functions, tables) for quad in patches]
    sizes = {
        "SUB_POINTS": len(functions),
        "MOST_NODES": max(len(quad.patch.c) for quad in patches),
        "MOST_CELLS": max(len(quad.patch.corners) for quad in patches),
        "MOST_BLOCKS": max(len(quad.patch.blocks) - 1 for quad in patches),
        "WIDTH": quadrature.WIDTH_MM,
        "FLATTEST": quadrature.FLATTEST,
        "FLATTEST_WIDTH": quadrature.FLATTEST_WIDTH,
        "DEEPEST_START": quadrature.DEEPEST_START_MM,
        "HIGHEST_START": quadrature.HIGHEST_START_MM,
        "FAR_DEPTH": quadrature.FAR_MM,
        "FAR_WIDTH": quadrature.FAR_WIDTH_MM,
        "TOUCH": quadrature.TOUCH_MM,
        "FADE": patches[0].fade_n,
        "STEEPEST": STEEPEST_FIELD,
        "BOW_REACH": BOW_REACH_MM,
    }
    arrays = {"hermite[SUB_POINTS][12]": functions, "share[SUB_POINTS][4]": shares, "whole[4][12]": whole}
    text = [
        "#include <stddef.h>",
        *(f"#undef {name}\n#define {name} {value!r}" for name, value in sizes.items()),
        *(f"static const double {name} = {{{', '.join(map(braces, rows_))}}};" for name, rows_ in arrays.items()),
        _INCLUDED,
        body,
        *(c_text(name, _C) for name in ("cells_body.h", "cells_nodes.h", "cells_search.h")),
        f"static const Patch patches[PATCHES] = {{{', '.join(rows)}}};",
        *(c_text(name, _C) for name in ("cells_sums.h", "cells_curvature.h", "cells.h")),
    ]
    return "\n".join(text), tables.data


def _body(surface: MovingSurface, tables: _Tables, with_tangents: bool) -> str:
    """Definitions that ``cells_body.h`` reads."""
    if surface.family == HALF_SPACE:
        return "#define BODY_FIELD 0\n#define BODY_ROUND 0"
    if surface.family != MESH_FIELD:
        axes, centre, radius = round_body(surface)
        return (
            "#define BODY_FIELD 0\n#define BODY_ROUND 1\n"
            f"#define ROUND_RADIUS {radius!r}\nstatic const double round_axes[3] = {braces(axes)};\n"
            f"static const double round_centre[3] = {braces(centre)};"
        )
    origin, spacing, coefficients, _ = field_parts(surface.parameters)
    sizes = {
        **{f"FIELD_{axis}": count for axis, count in zip("XYZ", coefficients.shape, strict=True)},
        "FIELD_SPACING": spacing,
        "FIELD_COEFFICIENTS": f"((const double *)(cells_data + {tables.place(coefficients)}))",
    }
    if with_tangents:
        rows, index = tangents(coefficients, spacing)
        sizes["FIELD_TANGENTS"] = f"((const Tangent *)(cells_data + {tables.place(rows)}))"
        sizes["FIELD_INDEX"] = f"((const int *)(cells_data + {tables.place(index)}))"
    lines = [f"#define {name} {value}" for name, value in sizes.items()]
    return "\n".join(["#define BODY_FIELD 1", *lines, f"static const double field_origin[3] = {braces(origin)};"])


def _patch(patch: CellPatch, functions: Array, tables: _Tables) -> str:
    """The fields of `Patch` in their order."""
    nodes = np.zeros(len(patch.c), _NODE)
    for name, values in (("c", patch.c), ("n", patch.n), ("along", patch.tangents), ("bend", patch.bends)):
        nodes[name] = values.reshape(len(nodes), -1)
    nodes["loads"] = patch.loads
    corners = np.concatenate([patch.c[:, None], patch.tangents], 1)[patch.corners].reshape(-1, 12, 3)
    points = np.concatenate([functions @ corners, patch.c[patch.corners]], 1)
    low, high = points.min(axis=1) - _FACETED_MM, points.max(axis=1) + _FACETED_MM
    patterns, kind = np.unique(1.0 - patch.present, axis=0, return_inverse=True)
    whole = np.zeros((1, patch.present.shape[1]))
    cells = np.zeros(len(low), _CELL)
    cells["middle"], cells["half"] = 0.5 * (low + high), 0.5 * (high - low)
    cells["corners"], cells["rim"] = patch.corners, patch.rim
    cells["present"] = np.where((patch.present == 1.0).all(axis=1), 0, kind.ravel() + 1)
    first, last = patch.blocks[:-1], patch.blocks[1:]
    lows, highs = np.minimum.reduceat(low, first), np.maximum.reduceat(high, first)
    blocks = np.zeros(len(first), _BLOCK)
    blocks["middle"], blocks["half"] = 0.5 * (lows + highs), 0.5 * (highs - lows)
    blocks["first"], blocks["last"] = first, last
    pointers = [
        f"(const {kind} *)(cells_data + {tables.place(array)})"
        for kind, array in (
            ("Node", nodes),
            ("Cell", cells),
            ("Block", blocks),
            ("unsigned char", patch.known.astype("u1")),
        )
    ]
    shares = tables.place(1.0 - np.concatenate([whole, patterns]))
    pointers.append(f"(const double (*)[SUB_POINTS])(cells_data + {shares})")
    return f"{{{', '.join([*pointers, str(len(nodes)), str(len(blocks))])}}}"
