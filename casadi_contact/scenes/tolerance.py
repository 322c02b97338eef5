"""When errors of loads are small enough: the one rule of the library."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from casadi_contact.core.conventions import Array
from casadi_contact.core.quantities import FORCE, TORQUE
from casadi_contact.scenes.scene import Scene


@dataclass(frozen=True)
class Tolerance:
    """Errors (n, L) of named loads are within tolerance if the RMS of each load is at most its `allowed` [N, N·mm] and
    no single error exceeds `single` times it. Three standard deviations of a normal distribution hold 99.7 % of it.

    >>> tolerance = Tolerance(("Fy", "Tx"), np.array([2.0, 50.0]))
    >>> tolerance.ratio(np.array([[1.0, 100.0], [-1.0, -100.0]]))
    2.0
    """

    names: tuple[str, ...]
    allowed: Array
    single: float = 3.0

    @classmethod
    def of(cls, scene: Scene, names: Sequence[str] | None = None) -> Tolerance:
        """The scene's tolerances of some of its loads, all if left out."""
        names = tuple(scene.load_names if names is None else names)
        return cls(names, scene.tolerances_of(names))

    @classmethod
    def of_kinds(cls, force_n: float | None, torque_nmm: float | None) -> Tolerance:
        """Tolerances of all forces [N], "force", and all torques [N·mm], "torque", finite, above 0; None: any."""
        given = {FORCE: force_n, TORQUE: torque_nmm}
        allowed = {kind.name: value for kind, value in given.items() if value is not None}
        for kind, value in given.items():
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"{kind.name} tolerance is {value!r}, expected {kind.unit} above 0")
        return cls(tuple(allowed), np.array(list(allowed.values()), dtype=float))

    def rms_ratios(self, rms: ArrayLike) -> Array:
        """RMS errors (..., L) over what is allowed; infinite where an error is not a number."""
        return np.nan_to_num(np.asarray(rms, dtype=float) / self.allowed, nan=np.inf)

    def single_ratios(self, errors: ArrayLike) -> Array:
        """Single errors (..., L) over what a single one may be; infinite where an error is not a number."""
        return self.rms_ratios(np.abs(errors)) / self.single

    def ratio(self, errors: ArrayLike) -> float:
        """Worst of the RMS and of the single errors (n, L), over what is allowed; 0 for no errors at all."""
        errors = np.asarray(errors, dtype=float)
        if not errors.size:
            return 0.0
        rms = self.rms_ratios(np.sqrt(np.mean(errors**2, axis=0)))
        return float(max(rms.max(), self.single_ratios(errors).max()))

    def met(self, errors: ArrayLike) -> bool:
        """Whether errors (n, L) are within tolerance."""
        return self.ratio(errors) <= 1.0
