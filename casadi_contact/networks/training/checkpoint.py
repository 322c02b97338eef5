"""A fit's state in one .npz file: what a later run continues from.

A checkpoint that cannot be read is not worth stopping for: the fit starts again, with one logged warning. One that
belongs to other data or settings is refused, because it may be hours of somebody's work that must not be overwritten.
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
from casadi_contact.networks.network import Network
from casadi_contact.networks.training.settings import TrainingSettings

FORMAT = 4  # 1 counted seconds, 2 kept preconditioners, 3 told data apart by their last bit
# More work or iterations continue a fit; chunks, threads and saving do not change what is fitted.
_NOT_IN_DIGEST = ("max_gflop", "max_iterations", "chunk_rows", "checkpoint_every_s", "threads")
_ROUNDING = 1e-9  # of an array's sum of magnitudes: more than processors differ by, less than other data
_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)

Made = TypeVar("Made")
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Identity:
    """What a fit is of. digest: hex name of its settings, and of all data that are the same on every machine; sums
    (2·arrays,) of the others, which processors and numbers of threads round each in its own way: Σ|a| of each array,
    and Σw·a with irregular weights |w| ≤ 1/2."""

    digest: str
    sums: Array

    def is_of(self, digest: str, sums: Array) -> bool:
        """Whether these are of the same fit, but for rounding."""
        if digest != self.digest or (sums.shape, sums.dtype) != (self.sums.shape, self.sums.dtype):
            return False
        return bool(np.all(np.abs(sums - self.sums) <= _ROUNDING * np.repeat(self.sums[::2], 2)))


def identity(
    settings: TrainingSettings, names: Sequence[Any], arrays: Sequence[Any], start: Sequence[Network] = ()
) -> Identity:
    """That of a fit by its settings (but for limits and the machine), whatever else names it (as JSON), its data and
    the networks that it starts from, whose scales come of data too."""
    chosen = {key: value for key, value in asdict(settings).items() if key not in _NOT_IN_DIGEST}
    digest = hashlib.sha256(json.dumps([FORMAT, *names, chosen], sort_keys=True).encode())
    sums: list[float] = []
    of_start = (
        array
        for one in start
        for array in (one.input_shift, one.input_scale, np.asarray(one.output_scale), *one.weights, *one.biases)
    )
    for array in map(np.ascontiguousarray, (*arrays, *of_start)):
        digest.update(f"{array.dtype.str}{array.shape}".encode())
        if array.dtype.kind == "f":
            sums += _sums(array.ravel())
        else:
            digest.update(array.data)
    return Identity(digest.hexdigest(), np.array(sums))


def _sums(numbers: Array) -> tuple[float, float]:
    weights = np.arange(len(numbers)) * _GOLDEN % 1.0 - 0.5
    return float(np.abs(numbers).sum()), float(numbers @ weights)


def write(path: Path, of: Identity, content: dict[str, Any]) -> None:
    """Put the arrays and numbers in the place of ``path``."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_npz(path, format=FORMAT, digest=of.digest, sums=of.sums, **content)


def go_on(path: Path | None, of: Identity, make: Callable[[dict[str, Any] | None], Made]) -> Made:
    """What `make` makes of the checkpoint's content; of None where there is none to go on from (see `read`), or where
    it is not what a fit goes on from: a warning is logged. Raises what `read` and `make(None)` do."""
    saved = read(path, of) if path else None
    if saved is not None:
        try:
            return make(saved)
        except (KeyError, TypeError, ValueError, IndexError) as error:
            _log.warning("checkpoint %s is damaged (%s); the fit starts again", path, one_line(error))
    return make(None)


def read(path: Path, of: Identity) -> dict[str, np.ndarray] | None:
    """The content, or None where there is none to go on from (absent, or damaged: a warning is logged).

    Raises ValueError for a checkpoint of another format, or of other data or settings.
    """
    if not path.exists():
        return None
    try:
        content = read_npz(path)
    except (OSError, ValueError) as error:
        _log.warning("checkpoint %s; the fit starts again", error)
        return None
    if not {"format", "digest"} <= content.keys() or content["format"].dtype.kind != "i" or content["format"].size != 1:
        raise ValueError(f"{path} is not a checkpoint of a fit; choose another file, so that it is not overwritten")
    version, owner = int(content.pop("format")), str(content.pop("digest"))
    if version > FORMAT:
        raise ValueError(f"checkpoint {path} has format {version}, expected at most {FORMAT}: update casadi_contact")
    if version < FORMAT:
        raise ValueError(
            f"checkpoint {path} has format {version}, expected {FORMAT}, of a later version; delete it or "
            "choose another folder to train anew"
        )
    if not of.is_of(owner, content.pop("sums", np.empty(0))):
        raise ValueError(
            f"checkpoint {path} belongs to other data or settings; delete it or choose another folder to train anew"
        )
    return content
