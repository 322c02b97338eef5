"""A fit's state in one .npz file: what a later run continues from.

A damaged checkpoint is not worth stopping for: the fit starts again, with one logged warning. One that belongs to
other data or settings is refused, because it may be hours of somebody's work that must not be overwritten.
"""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.core.files.containers import read_npz, write_npz
from casadi_contact.core.files.reading import one_line
from casadi_contact.networks.training.settings import TrainingSettings

T = TypeVar("T")
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Identity:
    """What a fit is of. digest: SHA-256 of its settings, name and all data but floating-point numbers; sums (2·arrays,)
    of these, which processors round differently: Σ|a| of each array, and Σw·a with irregular weights |w| ≤ 1/2."""

    digest: str
    sums: Array

    @classmethod
    def of(cls, settings: TrainingSettings, name: str, arrays: Sequence[Any]) -> Identity:
        """More work or iterations continue a fit; chunks, threads and saving do not change what is fitted."""
        chosen = asdict(settings)
        for key in ("max_gflop", "max_iterations", "chunk_rows", "checkpoint_every_s", "threads"):
            del chosen[key]
        digest = hashlib.sha256(json.dumps([name, chosen], sort_keys=True).encode())
        sums: list[float] = []
        for array in map(np.ascontiguousarray, arrays):
            digest.update(f"{array.dtype.str}{array.shape}".encode())
            if array.dtype.kind == "f":
                weights = np.arange(array.size) * (0.5 * (np.sqrt(5.0) - 1.0)) % 1.0 - 0.5
                sums += float(np.abs(array).sum()), float(array.ravel() @ weights)
            else:
                digest.update(array.data)
        return cls(digest.hexdigest(), np.array(sums))

    def equals(self, digest: str, sums: Array, rounding: float = 1e-9) -> bool:
        """True if these are of the same fit, up to rounding as a share of each array's sum of magnitudes."""
        if digest != self.digest or (sums.shape, sums.dtype) != (self.sums.shape, self.sums.dtype):
            return False
        return bool(np.all(np.abs(sums - self.sums) <= rounding * np.repeat(self.sums[::2], 2)))


def write(path: Path, identity: Identity, content: dict[str, Any]) -> None:
    """Replace the file by these arrays and numbers."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_npz(path, digest=identity.digest, sums=identity.sums, **content)


def resume(path: Path | None, identity: Identity, make: Callable[[dict[str, Any] | None], T]) -> T:
    """make(content of the checkpoint), or make(None) where there is none or it is damaged (a warning is logged).

    Raises ValueError for a checkpoint of other data or settings, and what `make(None)` raises.
    """
    if path is None or not path.exists():
        return make(None)
    try:
        content = read_npz(path)
    except (OSError, ValueError) as error:
        _log.warning("checkpoint %s; the fit starts again", error)
        return make(None)
    if not identity.equals(str(content.pop("digest", "")), content.pop("sums", np.empty(0))):
        raise ValueError(
            f"checkpoint {path} belongs to other data or settings; delete it or choose another folder to train anew"
        )
    try:
        return make(content)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        _log.warning("checkpoint %s is damaged (%s); the fit starts again", path, one_line(error))
        return make(None)
