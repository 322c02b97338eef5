"""The loads of a patch's elements under swept arcs in C: what `loops.wrench_many` computes.

Both stay. Numba has every surface and pressure law, and needs no compiler; meshes have elements by it alone. The C has
swept arcs only, as in the knee, with four elements in a vector: 8 against 105 µs a pose of 80×40 elements (two shared
cores), which samples, references and verification of knees wait for.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from casadi_contact.contact.foundation_source import C_FOLDER, C_LAWS, law_source
from casadi_contact.core.compiler import CompilerError, call_in_shares, shared_library
from casadi_contact.core.conventions import Array
from casadi_contact.geometry.elements import BLOCK_SIDE, ElementGrid
from casadi_contact.geometry.moving_surface import SWEPT_ARCS, MovingSurface
from casadi_contact.networks.kernel.source import c_text
from casadi_contact.scenes.material import Material

_LANES = 4
_GROUP = BLOCK_SIDE**2


@dataclass(frozen=True)
class CompiledElements:
    """One bed as C reads it (``c/elements.h``): the library, and what it gets besides poses."""

    library: Path
    constants: tuple[np.ndarray, ...]

    @classmethod
    def of(cls, surface: MovingSurface, elements: ElementGrid, material: Material) -> CompiledElements | None:
        """None where there is no C for the surface or the pressure law, or no compiler: numba has the same numbers."""
        if surface.family != SWEPT_ARCS or material.law not in C_LAWS:
            return None
        texts = [law_source(material), c_text("elements.h", C_FOLDER)]
        try:
            library = shared_library("\n".join(texts))
        except CompilerError:
            return None
        members, present = _in_groups(elements)
        boxes = _boxes(members, present).reshape(-1, _LANES, 12).transpose(0, 2, 1).copy()
        count = np.array([len(members)], dtype=np.int64)
        return cls(library, (count, surface.parameters.copy(), boxes, members.transpose(0, 2, 1).copy()))

    def wrenches(self, rotations: Array, translations: Array, *, derivatives: bool) -> tuple[Array, Array]:
        """Wrenches (n, 6), and d wrench/d twist (n, 6, 6) if asked for (else none), at n poses."""
        count = len(translations)
        wrenches = np.empty((count, 6))
        slopes = np.empty((count, 6, 6)) if derivatives else None
        arrays = (np.ascontiguousarray(translations), wrenches, slopes)
        rotations = np.ascontiguousarray(rotations)
        call_in_shares(self.library, "element_wrenches", rotations, *arrays, constants=self.constants)
        return wrenches, np.empty((0, 6, 6)) if slopes is None else slopes


def _in_groups(elements: ElementGrid) -> tuple[Array, np.ndarray]:
    """c, n and area (groups, _GROUP, 7) of the blocks' elements, a multiple of _LANES groups filled up with zeros, and
    which of them there are (groups, _GROUP)."""
    spans = itertools.pairwise(elements.blocks.tolist())
    groups = [(k, min(_GROUP, end - k)) for start, end in spans for k in range(start, end, _GROUP)]
    groups += [(0, 0)] * (-len(groups) % _LANES)
    starts, sizes = np.array(groups).T
    place = np.arange(_GROUP)
    present = np.asarray(place < sizes[:, None])
    columns = np.column_stack([elements.centres_mm, elements.normals, elements.areas_mm2])
    return columns[np.where(present, starts[:, None] + place, 0)] * present[..., None], present


def _boxes(members: Array, present: np.ndarray) -> Array:
    """Middle and three half axes (groups, 12) of boxes about the elements, flat along their mean normals."""
    normals = members[..., 3:6].sum(axis=1)
    across = np.eye(3)[np.abs(normals).argmin(axis=1)]
    frames = np.linalg.qr(np.stack([normals, across, np.ones_like(normals)], -1))[0]
    along = members[..., :3] @ frames
    low = np.where(present[..., None], along, np.inf).min(axis=1)
    high = np.where(present[..., None], along, -np.inf).max(axis=1)
    filled = np.any(present, axis=1, keepdims=True)
    low, high = np.where(filled, low, 0.0), np.where(filled, high, 0.0)
    middle = np.einsum("gik,gk->gi", frames, 0.5 * (low + high))
    axes = (0.5 * (high - low))[:, :, None] * np.swapaxes(frames, 1, 2)
    return np.concatenate([middle, axes.reshape(-1, 9)], 1)
