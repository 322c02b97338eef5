"""A fit's state in one .npz file: what a later run continues from.

A checkpoint that cannot be read is not worth stopping for: the fit starts again, with one logged warning. One that
belongs to other data or settings is refused, because it may be hours of somebody's work that must not be overwritten.
"""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from casadi_contact.conventions import Array
from casadi_contact.files import one_line, read_npz, write_npz
from casadi_contact.network import Network, Regression
from casadi_contact.training.settings import TrainingSettings

FORMAT = 3  # 1 counted seconds, 2 kept preconditioners
# More work or iterations continue a fit; device, chunks, threads and saving do not change what is fitted.
_NOT_IN_DIGEST = ("max_gflop", "max_iterations", "device", "chunk_rows", "checkpoint_every_s", "threads")

Made = TypeVar("Made")
_log = logging.getLogger(__name__)


def digest(regression: Regression, settings: TrainingSettings, start: Network | None = None) -> str:
    """Hex name of the data, the settings that shape the result (not limits and machine) and the start."""
    chosen = {key: value for key, value in asdict(settings).items() if key not in _NOT_IN_DIGEST}
    head = json.dumps([FORMAT, regression.name, float(regression.tolerance), chosen], sort_keys=True)
    name = hashlib.sha256(head.encode())
    for array in _arrays(regression):
        array = np.ascontiguousarray(array)
        name.update(f"{array.dtype.str}{array.shape}".encode())
        name.update(array.data)
    if regression.spots > 1:
        name.update(f"{regression.spots} spots".encode())
    if start is not None:
        for array in (start.input_shift, start.input_scale, *start.weights, *start.biases):
            name.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
        name.update(repr(np.asarray(start.output_scale, dtype=float).tolist()).encode())
    return name.hexdigest()


def _arrays(regression: Regression) -> tuple[Array, ...]:
    r = regression
    return r.inputs, r.targets, r.weights, r.validation, np.asarray(r.false_load, dtype=float)


def write(path: Path, identity: str, content: dict[str, Any]) -> None:
    """Put the arrays and numbers in the place of ``path``."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_npz(path, format=FORMAT, digest=identity, **content)


def go_on(path: Path | None, identity: str, make: Callable[[dict[str, Any] | None], Made]) -> Made:
    """What `make` makes of the checkpoint's content; of None where there is none to go on from (see `read`), or where
    it is not what a fit goes on from: a warning is logged. Raises what `read` and `make(None)` do."""
    saved = read(path, identity) if path else None
    if saved is not None:
        try:
            return make(saved)
        except (KeyError, TypeError, ValueError, IndexError) as error:
            _log.warning("checkpoint %s is damaged (%s); the fit starts again", path, one_line(error))
    return make(None)


def read(path: Path, identity: str) -> dict[str, np.ndarray] | None:
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
    if owner != identity:
        raise ValueError(
            f"checkpoint {path} belongs to other data or settings; delete it or choose another folder to train anew"
        )
    return content
