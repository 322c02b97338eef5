"""The loads of a bed of elements under swept arcs in C: what `kernels.wrench_many` computes, several times faster."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from casadi_contact.contact.kernel_source import C_FOLDER, C_LAWS, law_source
from casadi_contact.conventions import Array
from casadi_contact.geometry.elements import BLOCK_SIDE, ElementGrid
from casadi_contact.geometry.moving_surface import SWEPT_ARCS, MovingSurface
from casadi_contact.scenes import Material
from casadi_contact.transcription.kernel import CompilerError
from casadi_contact.transcription.kernel.arrays import call_in_shares
from casadi_contact.transcription.kernel.compiler import shared_library
from casadi_contact.transcription.kernel.source import c_text

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
        spans = itertools.pairwise(elements.blocks.tolist())
        groups = [slice(k, min(k + _GROUP, end)) for start, end in spans for k in range(start, end, _GROUP)]
        padded = -(-len(groups) // _LANES) * _LANES
        boxes, members = np.zeros((padded, 12)), np.zeros((padded, 7, _GROUP))
        columns = np.column_stack([elements.centres_mm, elements.normals, elements.areas_mm2])
        for b, rows in enumerate(columns[group] for group in groups):
            boxes[b] = _box(rows[:, :3], rows[:, 3:6])
            members[b, :, : len(rows)] = rows.T
        together = boxes.reshape(-1, _LANES, 12).transpose(0, 2, 1).copy()
        return cls(library, (np.array([padded], dtype=np.int64), surface.parameters.copy(), together, members))

    def wrenches(self, rotations: Array, translations: Array, *, derivatives: bool) -> tuple[Array, Array]:
        """Wrenches (n, 6), and d wrench/d twist (n, 6, 6) if asked for (else none), at n poses."""
        count = len(translations)
        wrenches = np.empty((count, 6))
        slopes = np.empty((count, 6, 6)) if derivatives else None
        arrays = (np.ascontiguousarray(translations), wrenches, slopes)
        rotations = np.ascontiguousarray(rotations)
        call_in_shares(self.library, "element_wrenches", rotations, *arrays, constants=self.constants)
        return wrenches, np.empty((0, 6, 6)) if slopes is None else slopes


def _box(points: Array, normals: Array) -> Array:
    """Middle and three half axes (12,) of a box about points (m, 3) of a surface, flat along their mean normal."""
    normal = normals.sum(axis=0)
    frame = np.linalg.qr(np.column_stack([normal, np.eye(3)[np.abs(normal).argmin()], np.ones(3)]))[0].T
    along = points @ frame.T
    low, high = along.min(axis=0), along.max(axis=0)
    return np.concatenate([0.5 * (low + high) @ frame, (0.5 * (high - low)[:, None] * frame).ravel()])
