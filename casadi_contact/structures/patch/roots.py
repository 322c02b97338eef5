"""Root loads of patches from those of their parts, in NumPy; `transcription.part_roots` has the formula."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from casadi_contact.conventions import Array
from casadi_contact.structures.part_roots import LEAST_ROOT


def roots_of_patches(s: Array, ds: Array, first_parts: Sequence[int]) -> tuple[Array, Array]:
    """S (n, P) and dS (n, P, 6) from s (n, parts) and ds (n, parts, 6); first_parts: where each patch's parts begin."""
    if len(first_parts) == s.shape[1]:
        return s, ds
    patches = []
    for a, b in itertools.pairwise([*first_parts, s.shape[1]]):
        patches.append(_together(s[:, a:b], ds[:, a:b]) if b - a > 1 else (s[:, a], ds[:, a]))
    return np.stack([S for S, _ in patches], axis=1), np.stack([dS for _, dS in patches], axis=1)


def _together(s: Array, ds: Array) -> tuple[Array, Array]:
    pressed, free = np.maximum(s, 0.0), np.minimum(s, -LEAST_ROOT)
    loaded: np.ndarray = np.any(pressed > 0.0, axis=1)
    inside = np.linalg.norm(pressed, axis=1)
    nearest = free.max(axis=1)
    outside = nearest / np.linalg.norm(nearest[:, None] / free, axis=1)
    root = np.where(loaded, inside, outside)
    slopes = np.where(loaded[:, None], pressed / np.where(loaded, inside, 1.0)[:, None], (outside[:, None] / free) ** 3)
    return root, np.einsum("ni,nij->nj", slopes, ds)
