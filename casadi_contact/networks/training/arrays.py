"""Linear algebra of training: JᵀJ and its Cholesky factor."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg
from scipy.linalg.blas import dsyrk


class NumpyArrays:
    """float64 arrays of NumPy, linear algebra of SciPy."""

    xp: Any = np

    def array(self, values: Any) -> Any:
        """A contiguous float64 array on the device."""
        return np.ascontiguousarray(values, dtype=np.float64)

    def empty(self, *shape: int) -> Any:
        """Numbers of any value."""
        return np.empty(shape)

    def zeros(self, *shape: int) -> Any:
        """Zeros of a shape."""
        return np.zeros(shape)

    def single(self, array: Any) -> Any:
        """The array in single precision."""
        return array.astype(np.float32)

    def numpy(self, array: Any) -> Any:
        """The array in the computer's memory."""
        return array

    def new_gram(self, size: int) -> Any:
        """Zeros (size, size) for `add_gram`; only the upper triangle is ever filled or read."""
        return np.zeros((size, size), order="F")

    def add_gram(self, gram: Any, rows: Any) -> Any:
        """gram + rowsᵀ·rows in place: rowsᵀ is a view in Fortran order, which dsyrk reads without a copy."""
        return dsyrk(1.0, rows.T, beta=1.0, c=gram, overwrite_c=1)

    def diagonal(self, gram: Any) -> Any:
        """The diagonal of gram."""
        return np.diagonal(gram)

    def factor(self, gram: Any, shift: float) -> Any | None:
        """Cholesky factor of gram + shift·I, None where that is not positive definite."""
        shifted = gram.copy(order="F")
        shifted[np.diag_indices(len(gram))] += shift
        try:
            return scipy.linalg.cho_factor(shifted, lower=False, overwrite_a=True, check_finite=False)
        except scipy.linalg.LinAlgError:
            return None

    def solve(self, factor: Any, right: Any) -> Any:
        """(gram + shift·I)⁻¹·right from the factor."""
        return scipy.linalg.cho_solve(factor, right, check_finite=False)
