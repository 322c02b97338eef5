"""Tangents of a distance field at its nodes, and how far it falls below them: what cells are skipped by.

The bow M of a grid node q is the least with g(q) + ∇g(q)·δ - M|δ|²/2 <= g(q + δ) at all nodes q + δ near the surface or
inside the body, within a reach. Where the left side exceeds the distance at which cells are looked at, nothing of the
surface is there. Far tighter than a bound on second derivatives, which triangles make rough: only what lies between
the node and the surface counts.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from casadi_contact.conventions import Array

STRIDE = 2  # nodes of the field for one of these
BOW_REACH_MM = 3.2
_FAR_MM = 4.0  # beyond this, and deeper inside than the next, the steepest slope of g tells enough
_DEEP_MM = -2.0
_SURFACE_MM = 0.5
_OUTSIDE_MM = 1e6  # what far nodes count as
_SPARE = 0.004  # [1/mm], for points between nodes
_VALUE, _SLOPE = np.array([1.0, 4.0, 1.0]) / 6.0, np.array([-0.5, 0.0, 0.5])  # of a cubic B-spline at the nodes


def tangents(coefficients: Array, spacing_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Rows g, ∇g, M (n, 8) of nodes near the surface, in single precision, and the row of each node, at every `STRIDE`.

    Nodes far from the surface and at the edge of the grid share the first row outside of the body, the second inside.
    """
    g = _at_nodes(coefficients, (0, 0, 0))
    slopes = [_at_nodes(coefficients, order) / spacing_mm for order in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
    reach = int(np.ceil(BOW_REACH_MM / spacing_mm)) + 1
    known = np.zeros(g.shape, dtype=bool)
    known[::STRIDE, ::STRIDE, ::STRIDE] = True
    for axis in range(3):
        edges = np.moveaxis(known, axis, 0)
        edges[:reach] = edges[-reach:] = False
    known &= (g > _DEEP_MM) & (g < _FAR_MM)
    nodes = np.flatnonzero(known)
    at, tangent = g.ravel()[nodes], np.stack([slope.ravel()[nodes] for slope in slopes], 1)
    bow = np.zeros(len(nodes))
    steps = np.arange(-reach, reach + 1)
    for step in np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), -1).reshape(-1, 3):
        away = spacing_mm * step
        square = float(away @ away)
        if 0.0 < square <= (BOW_REACH_MM + spacing_mm) ** 2:
            there = g.ravel()[nodes + np.ravel_multi_index(tuple(step + reach), g.shape) - _middle(reach, g.shape)]
            fall = 2.0 * (at + tangent @ away - there) / square
            bow = np.where(there < _SURFACE_MM, np.maximum(bow, fall), bow)
    index = np.where(g > 0.0, 0, 1).astype(np.int32)
    index.ravel()[nodes] = np.arange(2, 2 + len(nodes))
    rows = np.zeros((2 + len(nodes), 8), dtype=np.float32)
    rows[:2, 0] = _OUTSIDE_MM, -_OUTSIDE_MM
    rows[2:, :5] = np.column_stack([at, tangent, bow + _SPARE])
    return rows, np.ascontiguousarray(index[::STRIDE, ::STRIDE, ::STRIDE])


def _middle(reach: int, shape: tuple[int, ...]) -> int:
    return int(np.ravel_multi_index((reach,) * 3, shape))


def _at_nodes(coefficients: Array, order: tuple[int, int, int]) -> Array:
    """Value or slope (in units of the spacing) along each axis."""
    for axis in range(3):
        coefficients = ndimage.correlate1d(coefficients, (_VALUE, _SLOPE)[order[axis]], axis, mode="mirror")
    return coefficients
