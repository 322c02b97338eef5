"""Networks of a patch's parts in training, in C (``c/parts_products.h``): a step takes half as long as in NumPy."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from scipy.linalg.blas import dsyrk

from casadi_contact.conventions import Array
from casadi_contact.network import Network, PartsRegression
from casadi_contact.training.parts_blocks import GROUP_ROWS, Blocks, Part, Piece, by_lanes
from casadi_contact.training.weights import layer_shapes
from casadi_contact.transcription.kernel.compiler import CompilerError, loaded, shared_library, warn_once
from casadi_contact.transcription.kernel.network_functions import activation_loops
from casadi_contact.transcription.kernel.source import c_text

MOST_LAYERS, MOST_RESIDUALS, MOST_BLOCKS = 8, 8, 16
_C_FOLDER = f"{__package__}.c"


def parts_library(activation: str) -> Path:
    """The compiled functions for networks of an activation; raises CompilerError where they cannot be compiled."""
    sizes = {"MOST_LAYERS": MOST_LAYERS, "MOST_RESIDUALS": MOST_RESIDUALS, "MOST_BLOCKS": MOST_BLOCKS}
    lines = [f"#define {name} {value}" for name, value in sizes.items()]
    lines += ["#define WIDEST WIDTH", f"#define SIGMOIDS {activation}_1"]
    lines += [c_text("parts.h", _C_FOLDER), c_text("core.h"), activation_loops(activation)]
    for number, rows in (("float", "LANES"), ("double", "HALF")):
        lines += [f"#define NUMBER {number}", f"#define WORKED_ON {rows}"]
        lines.append(c_text("layer_sums.h", _C_FOLDER))
    return shared_library(
        "\n".join([*lines, c_text("parts_products.h", _C_FOLDER)]), "the training of parts, about 2 s"
    )


def compiled_parts(networks: Sequence[Network], regression: PartsRegression) -> CompiledParts | None:
    """The networks in training, None without a C compiler and where the C has no room for them."""
    activations, residuals = {network.activation for network in networks}, regression.wanted.shape[1]
    if residuals > MOST_RESIDUALS or len(activations) > 1 or max(len(n.hidden) for n in networks) >= MOST_LAYERS:
        return None
    try:
        return CompiledParts(networks, regression, parts_library(activations.pop()))
    except CompilerError as error:
        warn_once(f"{error}; parts are trained in NumPy, twice as long")
        return None


class CompiledParts:
    """The parts' networks on the rows of a patch. Weighted are root loads that have a residual of their own."""

    def __init__(self, networks: Sequence[Network], regression: PartsRegression, library: Path) -> None:
        self._library, weighted = loaded(library), regression.weights != 0.0
        self._lanes = int(self._library.lanes_of_a_block())
        self._parts = []
        for k, (network, x) in enumerate(zip(networks, regression.inputs, strict=True)):
            shapes = layer_shapes(x.shape[1], network.hidden)
            scaled = (x - network.input_shift) / network.input_scale
            self._parts.append(Part(k, network, shapes, scaled, self._lanes))
        pairs = list(zip(self._parts, weighted.T, strict=True))
        self._weighted = [Blocks(part, np.flatnonzero(chosen)) for part, chosen in pairs]
        self._others = [Blocks(part, np.flatnonzero(~chosen)) for part, chosen in pairs]
        self._is_weighted = weighted
        self._current: list[Blocks] = []
        widest = max(part.vectors for part in self._parts)
        self._room = np.empty(MOST_BLOCKS * widest * self._lanes // 2)
        self._scales = np.array([float(part.like.output_scale) for part in self._parts])
        self._largest_share = float(np.abs(regression.shares).max(initial=0.0)) or 1.0
        self._rows, self._shares = len(weighted), by_lanes(regression.shares / self._largest_share, self._lanes)
        self._weights = self._scales * regression.weights

    def roots(self, parameters: Sequence[Array]) -> Array:
        """Root loads (n, K) at the parameters of each part."""
        found = np.empty(self._is_weighted.shape)
        for blocks in (*self._weighted, *self._others):
            k, outputs = blocks.part.number, np.empty(blocks.count * self._lanes)
            self._call(self._library.outputs_of, blocks, np.ascontiguousarray(parameters[k]), outputs)
            found[blocks.rows, k] = self._scales[k] * outputs[blocks.place]
        return found

    def move(self, parameters: Sequence[Array], matters: np.ndarray, slopes: Array, changes: Array) -> list[Array]:
        """Make parameters current; returns Jᵀ·changes of each part, of the changes (n, K) of root loads.

        matters (n, K): whether a root load has an effect, true where it is weighted. slopes (n, K) of the normal loads
        N_k/N0 by the root loads.
        """
        besides = matters & ~self._is_weighted
        extra = [Blocks(part, np.flatnonzero(besides[:, part.number])) for part in self._parts]
        self._current = [*self._weighted, *(blocks for blocks in extra if blocks.count)]
        gradients = [np.zeros(part.parameters) for part in self._parts]
        for blocks in self._current:
            k, lanes = blocks.part.number, np.zeros((blocks.part.parameters, self._lanes // 2))
            blocks.with_factors()
            effects = blocks.laid_out(self._scales[k] * changes[blocks.rows, k])
            self._call(self._library.move_to, blocks, np.ascontiguousarray(parameters[k]), effects, lanes)
            gradients[k] += lanes.sum(axis=1)
        slopes = self._largest_share * self._scales * slopes
        unit = max(float(np.abs(slopes).max(initial=0.0)), float(np.abs(self._weights).max(initial=0.0))) or 1.0
        self._unit = unit  # numbers in single precision are near 1
        self._effects = tuple(by_lanes(array, self._lanes) for array in (slopes / unit, (self._weights / unit) ** 2))
        return gradients

    def _call(self, function: Callable[..., None], blocks: Blocks, *arrays: Array) -> None:
        pointers = map(_pointer, (*arrays, self._room))
        function(ctypes.byref(blocks.struct()), ctypes.c_int64(blocks.count), *pointers)

    def gram_product(self, directions: Sequence[Array]) -> list[Array]:
        """JᵀJ·v of each part, in single precision."""
        size = max(float(np.abs(direction).max()) for direction in directions) or 1.0
        given = [(direction / size).astype(np.float32) for direction in directions]
        totals = [np.zeros((part.parameters, self._lanes), np.float32) for part in self._parts]
        room = np.empty((GROUP_ROWS, len(self._parts)), np.float32)
        count, numbers = len(self._current), [blocks.part.number for blocks in self._current]
        self._library.gram_product(
            count,
            (Piece * count)(*(blocks.struct() for blocks in self._current)),
            ctypes.c_int64(self._rows),
            *(GROUP_ROWS, len(self._parts), self._shares.shape[2]),
            *map(_pointer, (self._shares, *self._effects)),
            *((ctypes.c_void_p * count)(*(arrays[k].ctypes.data for k in numbers)) for arrays in (given, totals)),
            _pointer(room),
        )
        ones = np.ones(self._lanes)  # a product sums short rows in an eighth of `sum`'s time
        return [size * self._unit**2 * (total.astype(np.float64) @ ones) for total in totals]

    def gram(self, number: int, rows: np.ndarray, scales: Array) -> Array:
        """JᵀJ (upper triangle) of a part's root load on these ascending rows, which matter, each times its scale."""
        part = self._parts[number]
        jacobian = np.empty((len(rows), part.parameters))
        for blocks in self._current:
            if blocks.part is part:
                own = np.isin(rows, blocks.rows, assume_unique=True)
                places = blocks.place[np.searchsorted(blocks.rows, rows[own])]
                jacobian[own] = self._scales[number] * scales[own, None] * blocks.jacobian(places)
        return np.asarray(dsyrk(1.0, jacobian.T))


def _pointer(array: np.ndarray) -> ctypes.c_void_p:
    """To the first number of an array whose numbers lie in the order that C reads them in."""
    if not array.flags.c_contiguous:
        raise AssertionError(f"an array {array.shape} for C has strides {array.strides}, expected it contiguous")
    return ctypes.c_void_p(array.ctypes.data)
