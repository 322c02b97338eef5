"""The quadrature of cubic cells as C (``c/cells.h``) with its tables, among them tangents of the distance field.

The concavity M of a grid node q is the least with g(q) + ∇g(q)·δ - M|δ|²/2 <= g(q + δ) at all nodes q + δ near the
surface or inside the body, within a reach. Where the left side exceeds the distance up to which cells are evaluated,
nothing of the surface is there. Far tighter than a bound on second derivatives, which triangles make rough: only what
lies between the node and the surface counts. The grid is continued beyond its edge as the field is, and farther away
the clearance tells: within it lies nothing near the body. Both hold too where an open mesh makes the field jump.
"""

import itertools
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
from scipy import ndimage

from casadi_contact.contact.cells.basis import (
    corner_shares,
    hermite_functions,
    hermite_of,
    linear_shares,
    share_products,
)
from casadi_contact.contact.cells.patches import BOXES, CellPatch
from casadi_contact.contact.cells.quadrature import Quadrature
from casadi_contact.contact.foundation_source import C_FOLDER, braces, definitions
from casadi_contact.core.compiler import DATA_FILE
from casadi_contact.core.conventions import Array
from casadi_contact.geometry.distance_field import field_parts
from casadi_contact.geometry.moving_surface import HALF_SPACE, MESH_FIELD, MovingSurface
from casadi_contact.geometry.surface_distances import round_body
from casadi_contact.networks.kernel.source import c_text


@dataclass(frozen=True)
class _Tangents:
    """Of the nodes that have a tangent, and of the clearances of the others."""

    stride: int = 2  # nodes of the field for one of these
    longest_reach_mm: float = 5.0  # blocks of a knee's largest cells reach 3 to 4 mm from their middles
    far_mm: float = 5.0  # beyond this, and deeper inside than the next, the clearance suffices
    deep_mm: float = -2.0
    surface_mm: float = 0.5  # nodes with less count as near the surface
    near_mm: float = 0.9  # and as near the body: a point that touches has such a node at its cell's corners
    level_mm: float = 0.25  # of clearances that share a row
    unknown: float = 1e6  # concavity of nodes without a tangent
    spare: float = 0.004  # [1/mm], for points between nodes

    def reach_mm(self, largest_mm: float, spacing_mm: float) -> float:
        """How far from their nodes tangents have to be good, for blocks that reach so far; the cost is its cube."""
        return float(min(self.longest_reach_mm, largest_mm + np.sqrt(0.75) * self.stride * spacing_mm))


def tangents(
    coefficients: Array, spacing_mm: float, reach_mm: float, settings: _Tangents
) -> tuple[np.ndarray, np.ndarray]:
    """Rows g, ∇g, M, clearance (n, 8) in single precision, and the row of each node, at every stride.

    reach_mm: of concavities. Nodes far from the surface have the clearance alone, and share the rows of its levels.
    """
    stride, level_mm = settings.stride, settings.level_mm
    g = _at_nodes(coefficients, (0, 0, 0))
    slopes = [_at_nodes(coefficients, order) / spacing_mm for order in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
    reach = int(np.ceil(reach_mm / spacing_mm)) + 1
    field = _continued(g, reach, spacing_mm)
    body = field[(slice(reach, -reach),) * 3] < settings.near_mm
    clearance = ndimage.distance_transform_edt(~body, sampling=spacing_mm) - np.sqrt(0.75) * spacing_mm
    clearance = np.maximum(clearance, 0.0)
    known = np.zeros(g.shape, dtype=bool)
    known[::stride, ::stride, ::stride] = True
    known &= (g > settings.deep_mm) & (g < settings.far_mm)
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
            concavity = np.where(there < settings.surface_mm, np.maximum(concavity, fall), concavity)
    levels, level = np.unique(np.floor(clearance / level_mm).astype(np.int32), return_inverse=True)
    index = level.reshape(g.shape).astype(np.int32)
    index.ravel()[nodes] = np.arange(len(levels), len(levels) + len(nodes))
    rows = np.zeros((len(levels) + len(nodes), 8), dtype=np.float32)
    rows[: len(levels), 4], rows[: len(levels), 5] = settings.unknown, level_mm * levels
    rows[len(levels) :, :6] = np.column_stack([at, tangent, concavity + settings.spare, clearance.ravel()[nodes]])
    return rows, np.ascontiguousarray(index[::stride, ::stride, ::stride])


def _continued(g: Array, by: int, spacing_mm: float) -> Array:
    """g at the nodes and `by` more to each side: from the outermost on the nearest inner one's plus the way to it."""
    outwards = [np.arange(-by, count + by) for count in g.shape]
    beyond = [np.maximum(np.maximum(1 - i, i - (count - 2)), 0) for i, count in zip(outwards, g.shape, strict=True)]
    square = sum(b.astype(float) ** 2 for b in np.ix_(*beyond))
    return np.pad(g[1:-1, 1:-1, 1:-1], by + 1, mode="edge") + spacing_mm * np.sqrt(square)


def _at_nodes(coefficients: Array, order: tuple[int, int, int]) -> Array:
    """Value or derivative (in units of the spacing) of a cubic B-spline along each axis."""
    weights = np.array([1.0, 4.0, 1.0]) / 6.0, np.array([-0.5, 0.0, 0.5])
    for axis in range(3):
        coefficients = ndimage.correlate1d(coefficients, weights[order[axis]], axis, mode="mirror")
    return coefficients


_LINE = 64  # bytes that tables begin at multiples of
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


def _place(tables: bytearray, array: np.ndarray) -> int:
    """Add an array to the tables, which lie one after the other; where it begins."""
    start = len(tables)
    tables.extend(array.tobytes())
    tables.extend(bytes(-len(tables) % _LINE))
    return start


def cell_source(patches: Sequence[Quadrature], *, with_tangents: bool = True) -> tuple[str, bytes]:
    """C that defines `patch_loads`, and its data; with_tangents: False for half the data of a mesh, and more time."""
    tables, cells, law = bytearray(), patches[0].cells, patches[0].law
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
        *definitions(_sizes(patches)),
        *(f"static const double {name} = {{{', '.join(map(braces, rows_))}}};" for name, rows_ in arrays.items()),
        _INCLUDED,
        body,
        *(c_text(f"cells_{name}.h", C_FOLDER) for name in ("body", "boxes", "nodes", "search", "values")),
        f"static const Patch patches[PATCHES] = {{{', '.join(rows)}}};",
        *(c_text(name, C_FOLDER) for name in ("cells_sums.h", "cells_curvature.h", "cells.h")),
    ]
    return "\n".join(text), bytes(tables)


def _sizes(patches: Sequence[Quadrature]) -> dict[str, float]:
    """Sizes of the C's arrays, and lengths [mm], forces [N] and cosines, by name."""
    cells, tuning = patches[0].cells, patches[0].tuning
    return {
        "BOXES": BOXES,
        "SUB_POINTS": cells.along_u * cells.along_v,
        "ALONG_U": cells.along_u,
        "ALONG_V": cells.along_v,
        "MOST_NODES": max(len(quad.patch.c) for quad in patches),
        "MOST_CELLS": max(len(quad.patch.corners) for quad in patches),
        "MOST_GROUPS": max(_groups(quad.patch)[-1] for quad in patches),
        "MOST_BLOCKS": max(len(quad.patch.blocks) - 1 for quad in patches),
        **{name.upper(): value for name, value in asdict(tuning).items()},
        "TOUCH": tuning.touch_mm(cells),
        "SPARE": 0.5 * tuning.touch_mm(cells),
        "FADE": patches[0].fade_n,
    }


def _body(surface: MovingSurface, tables: bytearray, largest_mm: float | None) -> str:
    """What ``cells_body.h`` reads; with tangents for blocks that reach so far from their middles, if that is given."""
    if surface.family == HALF_SPACE:
        return f"#define BODY_FIELD 0\n#define BODY_ROUND 0\n#define SOLID_SIDE {float(surface.parameters[0])!r}"
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
        "FIELD_COEFFICIENTS": f"((const float *)(cells_data + {_place(tables, coefficients.astype(np.float32))}))",
    }
    if largest_mm is not None:
        settings = _Tangents()
        reach_mm = settings.reach_mm(largest_mm, spacing)
        rows, index = tangents(coefficients, spacing, reach_mm, settings)
        sizes |= {f"TANGENTS_{axis}": count for axis, count in zip("XYZ", index.shape, strict=True)}
        sizes |= {"CONCAVITY_REACH": reach_mm, "TANGENT_SPACING": settings.stride * spacing}
        sizes["FIELD_TANGENTS"] = f"((const Tangent *)(cells_data + {_place(tables, rows)}))"
        sizes["FIELD_INDEX"] = f"((const int *)(cells_data + {_place(tables, index)}))"
    lines = [f"#define {name} {value}" for name, value in sizes.items()]
    return "\n".join(["#define BODY_FIELD 1", *lines, f"static const double field_origin[3] = {braces(origin)};"])


def _patch(patch: CellPatch, functions: Array, tables: bytearray) -> tuple[str, float]:
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
    pointers = [f"(const {kind} *)(cells_data + {_place(tables, array)})" for kind, array in tables_of]
    shares = _place(tables, 1.0 - np.concatenate([whole, patterns]))
    pointers.append(f"(const double (*)[SUB_POINTS])(cells_data + {shares})")
    return f"{{{', '.join([*pointers, str(len(spans))])}}}", float(blocks[:, 10].max())


def _groups(patch: CellPatch) -> np.ndarray:
    """The first of the boxes of cells, `BOXES` together, of each block (b + 1,)."""
    return np.concatenate([[0], np.cumsum(-(-np.diff(patch.blocks) // BOXES))])


def _boxes(spans: Sequence[Array], place: np.ndarray, count: int, faceted_mm: float = 0.01) -> np.ndarray:
    """Middle, two half sides, what lies beyond them, how far all of it reaches: of `count` boxes, `BOXES` together.
    They are larger than the points by faceted_mm, for the surface between these.

    Those at `place` are flat parallelograms about spans of points (m, 3), along their main directions; others are none.
    """
    rows = np.zeros((count, 11))
    rows[:, 10] = -1.0
    for k, points in zip(place, spans, strict=True):
        frame = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2]
        along = points @ frame.T
        low, high = along.min(axis=0), along.max(axis=0)
        half = 0.5 * (high - low)
        beyond = half[2] + faceted_mm
        sides = half[:2, None] * frame[:2]
        rows[k] = [*(0.5 * (low + high) @ frame), *sides.ravel(), beyond, np.hypot(*half[:2]) + beyond]
    return rows.reshape(-1, BOXES, 11).transpose(0, 2, 1).astype(np.float32)
