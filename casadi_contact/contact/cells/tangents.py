"""Tangents of a distance field at its nodes, and how far it falls below them: what cells are skipped by.

The concavity M of a grid node q is the least with g(q) + ∇g(q)·δ - M|δ|²/2 <= g(q + δ) at all nodes q + δ near the
surface or inside the body, within a reach. Where the left side exceeds the distance up to which cells are evaluated,
nothing of the surface is there. Far tighter than a bound on second derivatives, which triangles make rough: only what
lies between the node and the surface counts. The grid is continued beyond its edge as the field is, and farther away
the clearance tells: within it lies nothing near the body. Both are taken from the field as it is, so that they hold too
where an open mesh makes it jump.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from casadi_contact.core.conventions import Array

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
