"""Rows of a part in blocks, as the C of `parts_compiled` walks through them (``c/parts.h``)."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from casadi_contact.conventions import Array
from casadi_contact.network import Network

GROUP_ROWS = 512  # of which all that JᵀJ·v reads stays in the cache
_CACHE_LINE = 16  # numbers in single precision


class Shape(ctypes.Structure):
    """Sizes of a network, as C reads them."""

    _fields_ = (
        *((name, ctypes.c_int) for name in ("layers", "parameters", "vectors")),
        *((name, ctypes.c_void_p) for name in ("neurons", "widths")),
    )


class Piece(ctypes.Structure):
    """`Blocks`, as C reads them."""

    _fields_ = (
        ("shape", Shape),
        ("part", ctypes.c_int),
        *((name, ctypes.c_void_p) for name in ("first", "row", "inputs", "factors")),
    )


@dataclass(frozen=True)
class Part:
    """One network: sizes of its layers, its inputs (n, k) scaled, and how many rows a block holds (lanes)."""

    number: int
    like: Network
    shapes: tuple[tuple[int, int], ...]
    inputs: Array
    lanes: int

    @cached_property
    def neurons(self) -> np.ndarray:
        """Of each layer, the output counted as one."""
        return np.array([neurons for neurons, _ in self.shapes], np.int32)

    @cached_property
    def widths(self) -> np.ndarray:
        """Inputs of each layer, the constant one counted."""
        return np.array([width for _, width in self.shapes], np.int32)

    @property
    def parameters(self) -> int:
        """Number of weights and biases."""
        return int(self.neurons @ self.widths)

    @property
    def vectors(self) -> int:
        """Vectors of so many numbers as there are lanes, in a block."""
        return int(self.neurons.sum() + self.widths.sum())


class Blocks:
    """Some rows of one part, group after group in blocks."""

    def __init__(self, part: Part, rows: np.ndarray) -> None:
        self.part, self.rows = part, rows
        groups = -(-len(part.inputs) // GROUP_ROWS)
        group = rows // GROUP_ROWS
        counts = np.bincount(group, minlength=groups)
        self._first = np.concatenate([[0], np.cumsum(-(-counts // part.lanes))])
        before = np.cumsum(counts) - counts
        self.place = self._first[group] * part.lanes + np.arange(len(rows)) - before[group]
        self._row = np.full(self.count * part.lanes, -1, np.int32)
        self._row[self.place] = rows - group * GROUP_ROWS
        laid = self.laid_out(part.inputs[rows])
        self._inputs = laid.reshape(2 * self.count, part.lanes // 2, laid.shape[1]).transpose(0, 2, 1).copy()
        self.factors: np.ndarray = np.empty((0, part.vectors, part.lanes), np.float32)

    @property
    def count(self) -> int:
        """Number of blocks."""
        return int(self._first[-1])

    def laid_out(self, values: Array) -> Array:
        """Values (rows, ...) at their rows' places, zeros where there is none."""
        laid = np.zeros((self.count * self.part.lanes, *values.shape[1:]))
        laid[self.place] = values
        return laid

    def with_factors(self) -> None:
        """Make room for them."""
        if len(self.factors) != self.count:
            self.factors = _aligned((self.count, self.part.vectors, self.part.lanes))

    def jacobian(self, places: np.ndarray) -> np.ndarray:
        """∂output/∂parameters (len(places), parameters) at the rows of these places, in single precision."""
        factors, start, column = self.factors[places // self.part.lanes, :, places % self.part.lanes], 0, 0
        jacobian = np.empty((len(places), self.part.parameters), np.float32)
        for neurons, width in self.part.shapes:
            inputs, derivatives = np.split(factors[:, start : start + width + neurons], [width], axis=1)
            layer = jacobian[:, column : column + neurons * width].reshape(len(places), neurons, width)
            np.multiply(derivatives[:, :, None], inputs[:, None, :], out=layer)
            start, column = start + width + neurons, column + neurons * width
        return jacobian

    def struct(self) -> Piece:
        """As C reads it; valid as long as this object."""
        of = self.part
        shape = Shape(len(of.shapes), of.parameters, of.vectors, of.neurons.ctypes.data, of.widths.ctypes.data)
        arrays = (self._first, self._row, self._inputs, self.factors)
        return Piece(shape, of.number, *(array.ctypes.data for array in arrays))


def by_lanes(values: Array, lanes: int) -> np.ndarray:
    """Values (rows, ...) in single precision as (rows / lanes, ..., lanes), zeros behind the last row."""
    padded = np.zeros((-(-len(values) // lanes), lanes, *values.shape[1:]), np.float32)
    padded.reshape(-1, *values.shape[1:])[: len(values)] = values
    return np.ascontiguousarray(np.moveaxis(padded, 1, -1))


def _aligned(shape: tuple[int, ...]) -> np.ndarray:
    """Numbers of any value in single precision, from the start of a line of the cache."""
    size = int(np.prod(shape))
    raw = np.empty(size + _CACHE_LINE, np.float32)
    start = -(raw.ctypes.data // raw.itemsize) % _CACHE_LINE
    return raw[start : start + size].reshape(shape)
