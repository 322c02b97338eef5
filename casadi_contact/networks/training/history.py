"""The course of a fit, one entry an iteration."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from casadi_contact.core.conventions import Array


@dataclass
class History:
    """training_rms, validation_rms (NaN without validation rows), Gflop used, and the index of the network's size in
    ``TrainingSettings.sizes``, one entry an iteration."""

    training_rms: list[float] = field(default_factory=list)
    validation_rms: list[float] = field(default_factory=list)
    gflop: list[float] = field(default_factory=list)
    size: list[int] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.gflop)

    def add(self, training_rms: float, validation_rms: float, gflop: float, size: int) -> None:
        """The entry of one more iteration."""
        self.training_rms.append(training_rms)
        self.validation_rms.append(validation_rms)
        self.gflop.append(gflop)
        self.size.append(size)

    def arrays(self, entries: int | None = None) -> dict[str, Array]:
        """The columns as arrays, by name; the first entries only if their number is given."""
        return {
            "training_rms": np.array(self.training_rms[:entries]),
            "validation_rms": np.array(self.validation_rms[:entries]),
            "gflop": np.array(self.gflop[:entries]),
            "size": np.array(self.size[:entries], dtype=int),
        }

    @classmethod
    def from_arrays(cls, arrays: dict[str, Any]) -> History:
        """The course that `arrays` wrote."""
        names = ("training_rms", "validation_rms", "gflop", "size")
        return cls(*([value.item() for value in np.asarray(arrays[name])] for name in names))
