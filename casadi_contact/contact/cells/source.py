"""The quadrature of cubic cells as C (``c/cells.h``) with its tables, among them tangents of the distance field.

The concavity M of a grid node q is the least with g(q) + ∇g(q)·δ - M|δ|²/2 <= g(q + δ) at all nodes q + δ near the
surface or inside the body, within a reach. Where the left side exceeds the distance up to which cells are evaluated,
nothing of the surface is there. Far tighter than a bound on second derivatives, which triangles make rough: only what
lies between the node and the surface counts. The grid is continued beyond its edge as the field is, and farther away
the clearance tells: within it lies nothing near the body. Both are taken from the field as it is, so that they hold too
where an open mesh makes it jump.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from casadi_contact.contact.cells import quadrature
from casadi_contact.contact.cells.basis import (
    corner_shares,
    hermite_functions,
    hermite_of,
    linear_shares,
    share_products,
)
from casadi_contact.contact.cells.patches import BOXES, CellPatch
from casadi_contact.contact.cells.quadrature import POWER, Quadrature
from casadi_contact.contact.elements.loops import STEEPEST_FIELD
from casadi_contact.contact.foundation_source import C_FOLDER, braces
from casadi_contact.core.compiler import DATA_FILE
from casadi_contact.core.conventions import Array
from casadi_contact.geometry.distance_field import field_parts
from casadi_contact.geometry.moving_surface import HALF_SPACE, MESH_FIELD, MovingSurface
from casadi_contact.geometry.surface_distances import round_body
from casadi_contact.networks.kernel.source import c_text

STRIDE = 2  # nodes of the field for one of these
_LONGEST_REACH_MM = 5.0  # blocks of a knee's largest cells reach 3 to 4 mm from their middles
_FAR_MM = 5.0  # beyond this, and deeper inside than the next, the clearance tells enough
_DEEP_MM = -2.0
_SURFACE_MM = 0.5
_NEAR_MM = 0.9  # what counts as near the body: a point that touches has such a node at its cell's corners
_LEVEL_MM = 0.25  # of clearances that share a row
_UNKNOWN = 1e6  # concavity of nodes without a tangent
_SPARE = 0.004  # [1/mm], for points between nodes
_VALUE, _SLOPE = np.array([1.0, 4.0, 1.0]) / 6.0, np.array([-0.5, 0.0, 0.5])  # of a cubic B-spline at the nodes


def tangents_reach(largest_mm: float, spacing_mm: float) -> float:
    """How far from their nodes tangents have to be good [mm]: for blocks that reach so far from their middles, which
    lie between the nodes. Their cost grows with its third power."""
    return float(min(_LONGEST_REACH_MM, largest_mm + np.sqrt(0.75) * STRIDE * spacing_mm))


def tangents(coefficients: Array, spacing_mm: float, reach_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Rows g, ∇g, M, clearance (n, 8) in single precision, and the row of each node, at every `STRIDE`.

    reach_mm: of concavities. Nodes far from the surface have the clearance alone, and share the rows of its levels.
    """
    g = _at_nodes(coefficients, (0, 0, 0))
    slopes = [_at_nodes(coefficients, order) / spacing_mm for order in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
    reach = int(np.ceil(reach_mm / spacing_mm)) + 1
    field = _continued(g, reach, spacing_mm)
    body = field[(slice(reach, -reach),) * 3] < _NEAR_MM
    clearance = ndimage.distance_transform_edt(~body, sampling=spacing_mm) - np.sqrt(0.75) * spacing_mm
    clearance = np.maximum(clearance, 0.0)
    known = np.zeros(g.shape, dtype=bool)
    known[::STRIDE, ::STRIDE, ::STRIDE] = True
    known &= (g > _DEEP_MM) & (g < _FAR_MM)
    nodes = np.flatnonzero(known)
    places = np.ravel_multi_index(tuple(i + reach for i in np.nonzero(known)), field.shape)
    at, tangent = g.ravel()[nodes], np.stack([slope.ravel()[nodes] for slope in slopes], 1)
    concavity, strides = np.zeros(len(nodes)), np.array(field.strides) // field.itemsize
    steps = np.arange(-reach, reach + 1)
    for step in np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), -1).reshape(-1, 3):
        away = spacing_mm * step
        square = float(away @ away)
        if 0.0 < square <= (reach_mm + spacing_mm) ** 2:
            there = field.ravel()[places + step @ strides]
            fall = 2.0 * (at + tangent @ away - there) / square
            concavity = np.where(there < _SURFACE_MM, np.maximum(concavity, fall), concavity)
    levels, level = np.unique(np.floor(clearance / _LEVEL_MM).astype(np.int32), return_inverse=True)
    index = level.reshape(g.shape).astype(np.int32)
    index.ravel()[nodes] = np.arange(len(levels), len(levels) + len(nodes))
    rows = np.zeros((len(levels) + len(nodes), 8), dtype=np.float32)
    rows[: len(levels), 4], rows[: len(levels), 5] = _UNKNOWN, _LEVEL_MM * levels
    rows[len(levels) :, :6] = np.column_stack([at, tangent, concavity + _SPARE, clearance.ravel()[nodes]])
    return rows, np.ascontiguousarray(index[::STRIDE, ::STRIDE, ::STRIDE])


def _continued(g: Array, by: int, spacing_mm: float) -> Array:
    """g at the nodes and `by` more to each side: there, as at the grid's outermost nodes, g is that of the nearest node
    further in and the distance to it."""
    outwards = [np.arange(-by, count + by) for count in g.shape]
    beyond = [np.maximum(np.maximum(1 - i, i - (count - 2)), 0) for i, count in zip(outwards, g.shape, strict=True)]
    square = sum(b.astype(float) ** 2 for b in np.ix_(*beyond))
    return np.pad(g[1:-1, 1:-1, 1:-1], by + 1, mode="edge") + spacing_mm * np.sqrt(square)


def _at_nodes(coefficients: Array, order: tuple[int, int, int]) -> Array:
    """Value or slope (in units of the spacing) along each axis."""
    for axis in range(3):
        coefficients = ndimage.correlate1d(coefficients, (_VALUE, _SLOPE)[order[axis]], axis, mode="mirror")
    return coefficients


_LINE = 64  # bytes that tables begin at multiples of
_FACETED_MM = 0.01  # by which boxes are larger than the sub-points
_NODE = np.dtype(
    [("c", float, 3), ("first", "f4", (3, 3)), ("unused", "f4"), ("bends", "f4", (2, 3)), ("loads", "f4", 10)]
)
_CELL = np.dtype([("corners", "i4", 4), ("present", "i4"), ("rim", "i4")])
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
    rows, reaches = zip(*(_patch(quad.patch, functions, tables) for quad in patches), strict=True)
    body = _body(patches[0].body, tables, max(reaches) if with_tangents else None)
    sides = (("u", "ALONG_U", cells.along_u), ("v", "ALONG_V", cells.along_v))
    arrays = {
        "hermite[SUB_POINTS][12]": functions,
        "share[SUB_POINTS][4]": shares,
        "whole[4][12]": whole,
        **{f"product_{side}[{rows}][8]": share_products(count) for side, rows, count in sides},
        **{f"hermite_{side}[{rows}][4]": hermite_of(count) for side, rows, count in sides},
        **{f"share_{side}[{rows}][2]": linear_shares(count) for side, rows, count in sides},
    }
    text = [
        "#include <limits.h>",
        "#include <stddef.h>",
        *(f"#undef {name}\n#define {name} {value}" for name, value in _sizes(patches).items()),
        *(f"static const double {name} = {{{', '.join(map(braces, rows_))}}};" for name, rows_ in arrays.items()),
        _INCLUDED,
        body,
        *(c_text(f"cells_{name}.h", C_FOLDER) for name in ("body", "boxes", "nodes", "search", "values")),
        f"static const Patch patches[PATCHES] = {{{', '.join(rows)}}};",
        *(c_text(name, C_FOLDER) for name in ("cells_sums.h", "cells_curvature.h", "cells.h")),
    ]
    return "\n".join(text), tables.data


def _sizes(patches: Sequence[Quadrature]) -> dict[str, float]:
    """What the C is written in terms of, by name: sizes of its arrays, and lengths [mm], forces [N] and cosines of
    `quadrature`."""
    cells = patches[0].cells
    return {
        "BOXES": BOXES,
        "SUB_POINTS": cells.along_u * cells.along_v,
        "ALONG_U": cells.along_u,
        "ALONG_V": cells.along_v,
        "MOST_NODES": max(len(quad.patch.c) for quad in patches),
        "MOST_CELLS": max(len(quad.patch.corners) for quad in patches),
        "MOST_GROUPS": max(_groups(quad.patch)[-1] for quad in patches),
        "MOST_BLOCKS": max(len(quad.patch.blocks) - 1 for quad in patches),
        "WIDTH": quadrature.WIDTH_MM,
        "FLATTEST": quadrature.FLATTEST,
        "FLATTEST_WIDTH": quadrature.FLATTEST_WIDTH,
        "STEEP_RAY": quadrature.STEEP_RAY,
        "STEEP_RAY_WIDTH": quadrature.STEEP_RAY_WIDTH,
        "DEEPEST_START": quadrature.DEEPEST_START_MM,
        "HIGHEST_START": quadrature.HIGHEST_START_MM,
        "SMALL_DEPTH": quadrature.SMALL_MM,
        "SMALL_DEPTH_WIDTH": quadrature.SMALL_WIDTH_MM,
        "SPARE": 0.5 * quadrature.touch_mm(cells),
        "FAR_DEPTH": quadrature.FAR_MM,
        "FAR_WIDTH": quadrature.FAR_WIDTH_MM,
        "TOUCH": quadrature.touch_mm(cells),
        "FADE": patches[0].fade_n,
        "POWER": POWER,
        "STEEPEST": STEEPEST_FIELD,
    }


def _body(surface: MovingSurface, tables: _Tables, largest_mm: float | None) -> str:
    """Definitions that ``cells_body.h`` reads; with tangents for blocks that reach as far as largest_mm from their
    middles, if that is given."""
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
        "FIELD_COEFFICIENTS": f"((const float *)(cells_data + {tables.place(coefficients.astype(np.float32))}))",
    }
    if largest_mm is not None:
        reach_mm = tangents_reach(largest_mm, spacing)
        rows, index = tangents(coefficients, spacing, reach_mm)
        sizes["CONCAVITY_REACH"] = reach_mm
        sizes |= {f"TANGENTS_{axis}": count for axis, count in zip("XYZ", index.shape, strict=True)}
        sizes["TANGENT_SPACING"] = STRIDE * spacing
        sizes["FIELD_TANGENTS"] = f"((const Tangent *)(cells_data + {tables.place(rows)}))"
        sizes["FIELD_INDEX"] = f"((const int *)(cells_data + {tables.place(index)}))"
    lines = [f"#define {name} {value}" for name, value in sizes.items()]
    return "\n".join(["#define BODY_FIELD 1", *lines, f"static const double field_origin[3] = {braces(origin)};"])


def _patch(patch: CellPatch, functions: Array, tables: _Tables) -> tuple[str, float]:
    """The fields of `Patch` in their order, and how far its largest block reaches from its middle [mm]."""
    nodes = np.zeros(len(patch.c), _NODE)
    nodes["c"], nodes["first"][:, 0], nodes["first"][:, 1:] = patch.c, patch.n, patch.tangents
    nodes["bends"], nodes["loads"][:, :7] = patch.bends, patch.loads
    patterns, kind = np.unique(1.0 - patch.present, axis=0, return_inverse=True)
    whole = np.zeros((1, patch.present.shape[1]))
    sizes = np.diff(patch.blocks)
    groups = _groups(patch)
    place = np.arange(len(patch.corners)) + np.repeat(BOXES * groups[:-1] - patch.blocks[:-1], sizes)
    cells = np.zeros(BOXES * groups[-1], _CELL)
    cells["corners"][place], cells["rim"][place] = patch.corners, patch.rim
    cells["present"][place] = np.where((patch.present == 1.0).all(axis=1), 0, kind.ravel() + 1)
    corners = np.concatenate([patch.c[:, None], patch.tangents], 1)[patch.corners].reshape(-1, 12, 3)
    points = np.concatenate([functions @ corners, patch.c[patch.corners]], 1)
    spans = [points[first:last].reshape(-1, 3) for first, last in itertools.pairwise(patch.blocks)]
    blocks = _boxes(spans, np.arange(len(spans)), -(-len(spans) // BOXES) * BOXES)
    tables_of = (
        ("Node", nodes),
        ("Cell", cells),
        ("Boxes", _boxes([*points], place, len(cells))),
        ("Boxes", blocks),
        ("Block", np.stack([groups[:-1], groups[1:]], 1).astype("i4")),
        ("unsigned char", patch.known.astype("u1")),
    )
    pointers = [f"(const {kind} *)(cells_data + {tables.place(array)})" for kind, array in tables_of]
    shares = tables.place(1.0 - np.concatenate([whole, patterns]))
    pointers.append(f"(const double (*)[SUB_POINTS])(cells_data + {shares})")
    return f"{{{', '.join([*pointers, str(len(spans))])}}}", float(blocks[:, 10].max())


def _groups(patch: CellPatch) -> np.ndarray:
    """The first of the boxes of cells, `BOXES` together, of each block (b + 1,)."""
    return np.concatenate([[0], np.cumsum(-(-np.diff(patch.blocks) // BOXES))])


def _boxes(spans: Sequence[Array], place: np.ndarray, count: int) -> np.ndarray:
    """Middle, two half sides, what lies beyond them, how far all of it reaches: of `count` boxes, `BOXES` together.

    Those at `place` are flat parallelograms about spans of points (m, 3), along their main directions; others are none.
    """
    rows = np.zeros((count, 11))
    rows[:, 10] = -1.0
    for k, points in zip(place, spans, strict=True):
        frame = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2]
        along = points @ frame.T
        low, high = along.min(axis=0), along.max(axis=0)
        half = 0.5 * (high - low)
        beyond = half[2] + _FACETED_MM
        sides = half[:2, None] * frame[:2]
        rows[k] = [*(0.5 * (low + high) @ frame), *sides.ravel(), beyond, np.hypot(*half[:2]) + beyond]
    return rows.reshape(-1, BOXES, 11).transpose(0, 2, 1).astype(np.float32)
