"""The summary that a problem writes beside its table: JSON, with the machine that made it."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from casadi_contact.core.files.writing import write_text
from casadi_contact.core.machine import machine_record


def write_summary(path: Path, content: Mapping[str, Any]) -> None:
    """A JSON file with the machine that made it, whole or not at all; null for a number that is not finite."""
    whole = _without_nan({**content, "machine": machine_record()})
    write_text(path, json.dumps(whole, indent=1, ensure_ascii=False, default=str, allow_nan=False))


def _without_nan(value: Any) -> Any:
    """The same with None for NaN and infinity, which JSON has not."""
    if isinstance(value, Mapping):
        return {key: _without_nan(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
