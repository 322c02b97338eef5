"""Parts of a surface on a raster: between walls, and of these between creases."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from casadi_contact.core.conventions import Array
from casadi_contact.geometry.projection import LEAST_UPWARD

_CREASE_COS = np.cos(np.deg2rad(30.0))  # between normals of neighbours: 0.15 mm apart on a fillet of 0.3 mm


def sheets_and_faces(
    on: np.ndarray, heights: Array, normals: Array, step: Array, fewest: int
) -> tuple[np.ndarray, np.ndarray]:
    """The numbers (nu, nv) of the sheet and of the face that each point `on` (nu, nv) of a raster lies on.

    Neighbours between which the surface is no wall lie on one sheet, by their heights (nu, nv) [mm] and the raster's
    step (2,) [mm]; those whose unit normals (nu, nv, 3) differ little, on one face of it. What has fewer than `fewest`
    points counts as the first.
    """
    level, alike = [], []
    for axis in (0, 1):
        here, there = _neighbours(on, axis)
        (low, high), (first, second) = _neighbours(heights, axis), _neighbours(normals, axis)
        level.append(here & there & (np.abs(high - low) < step[axis] / LEAST_UPWARD))
        alike.append(level[axis] & (np.einsum("uvk,uvk->uv", first, second) > _CREASE_COS))
    return _components(on, level, fewest), _components(on, alike, fewest)


def _neighbours(values: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Values at the raster's points but the last, and but the first, along an axis."""
    return np.delete(values, -1, axis), np.delete(values, 0, axis)


def _components(on: np.ndarray, joined: Sequence[np.ndarray], fewest: int) -> np.ndarray:
    """Numbers (nu, nv) of what hangs together by the joined neighbours along u (nu - 1, nv) and v (nu, nv - 1)."""
    number = np.arange(on.size).reshape(on.shape)
    pairs = [np.stack(_neighbours(number, axis))[:, joined[axis]] for axis in (0, 1)]
    first, second = np.concatenate(pairs, axis=1)
    graph = sparse.coo_matrix((np.ones(len(first)), (first, second)), shape=(on.size,) * 2)
    _, of = connected_components(graph, directed=False)
    large = np.flatnonzero(np.bincount(of[on.ravel()]) >= fewest)
    numbers = np.searchsorted(large, of)
    numbers[~np.isin(of, large)] = 0
    return numbers.reshape(on.shape)
