"""The summary that a problem writes beside its table: JSON, with the machine that made it."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from casadi_contact.core.files.writing import write_text
from casadi_contact.core.machine import machine_record
from casadi_contact.optimisation.verification import Verification


def write_summary(path: Path, content: Mapping[str, Any]) -> None:
    """A JSON file with the machine that made it, whole or not at all; null for a number that is not finite."""
    text = json.dumps({**content, "machine": machine_record()}, default=str)
    finite = json.loads(text, parse_constant=lambda _: None)
    write_text(path, json.dumps(finite, indent=1, ensure_ascii=False))


def tell(result: Any, verdict: Verification, what: str = "frames solved") -> dict[str, Any]:
    """Print how a problem of many frames ended, and what elements say of it; the same for its summary."""
    solved, frames = int(result.solved.sum()), len(result.poses)
    print(verdict.line)
    print(f"{solved} of {frames} {what}; {result.ipopt}, {result.seconds:.2f} s")
    ended = {"ipopt_status": result.ipopt.status, "ipopt_iterations": result.ipopt.iterations}
    counts = {"verdict": verdict.line, "frames": frames, "solved": solved, "elements": verdict.model}
    return {**counts, **ended, "seconds": result.seconds}
