"""Results as files: columns named with their units, and summaries."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.core.conventions import POSE_NAMES, Array
from casadi_contact.core.files.writing import replacing
from casadi_contact.core.machine import machine_record
from casadi_contact.core.quantities import Kind, quantity, two_digits

DIGITS = 9  # of numbers in result tables


def pose_columns(poses: Array) -> dict[str, Array]:
    """tx_mm to rz_rad, each (n,), of poses (n, 6)."""
    return {quantity(name).column: column for name, column in zip(POSE_NAMES, poses.T, strict=True)}


def load_columns(names: Sequence[str], loads: Array, what: str = "") -> dict[str, Array]:
    """Fy_med_N, Tx_Nmm and so on, or Fy_med_what_N, each (n,), of loads (n, L)."""
    middle = f"_{what}_" if what else "_"
    return {
        f"{name}{middle}{quantity(name).kind.plain_unit}": column for name, column in zip(names, loads.T, strict=True)
    }


def assembly_columns(kinds: Mapping[str, Kind], loads: Array) -> dict[str, Array]:
    """patellofemoral_Fy_N, patellofemoral_Tx_Nmm, patellar_tendon_N, each (n,), of an assembly's loads (n, L); kinds:
    its ``load_kinds``."""
    return {f"{name}_{kind.plain_unit}": column for (name, kind), column in zip(kinds.items(), loads.T, strict=True)}


def rms_and_largest(errors: Array) -> dict[str, float | None]:
    """Root mean square and largest size of errors (n,), of those that are numbers: a centre of pressure is none without
    contact. "values" tells how many they are where that is not all; None where there are none."""
    known = errors[~np.isnan(errors)]
    found: dict[str, float | None] = {"rms": None, "max": None}
    if len(known):
        found = {"rms": float(np.sqrt(np.mean(known**2))), "max": float(np.abs(known).max())}
    return found if len(known) == len(errors) else {**found, "values": len(known)}


def rms_and_largest_words(found: Mapping[str, float | None]) -> str:
    """A cell of a table: "0.12 / 0.56", "-" where there are no values."""
    rms, largest = found["rms"], found["max"]
    return "-" if rms is None or largest is None else f"{two_digits(rms)} / {two_digits(largest)}"


def write_summary(path: Path, content: Mapping[str, Any]) -> None:
    """A JSON file, whole or not at all, with the machine that made it; null for a number that is not finite."""
    whole = _without_nan({**content, "machine": machine_record()})
    with replacing(path) as beside:
        beside.write_text(json.dumps(whole, indent=1, ensure_ascii=False, default=str, allow_nan=False), "utf-8")


def add_to_summary(path: Path, content: Mapping[str, Any]) -> None:
    """More entries of a summary that is written: of random starts, which take long, after what they start from."""
    write_summary(path, {**json.loads(path.read_text("utf-8")), **content})


def _without_nan(value: Any) -> Any:
    """The same with None for NaN and infinity, which JSON has not."""
    if isinstance(value, Mapping):
        return {key: _without_nan(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
