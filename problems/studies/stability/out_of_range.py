"""Row 3: poses to three times the learned range: numbers, pulling forces, contact where there is none, and validity."""

from __future__ import annotations

from typing import Any

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.conventions import POSE_NAMES, Array
from casadi_contact.optimisation.starts import pose_bounds
from casadi_contact.surrogate.base import Surrogate
from problems.studies.stability.methods import BY_DIFFERENCES, Bench
from problems.studies.stability.normals import normal_of
from problems.studies.stability.table import Line

TIMES = 3.0
FALSE_GAP_MM = 3.0
VALID = 0.5
QUANTITY = "not finite / pulling / false contact / of it called valid"
_CHUNK = 5000


def along(surrogate: Surrogate, pose: Array, name: str, count: int) -> Array:
    """Poses (count, 6) that differ from a pose in one parameter, over three times its learned range."""
    low, high = pose_bounds(surrogate)
    column = POSE_NAMES.index(name)
    poses = np.tile(pose, (count, 1))
    middle, half = 0.5 * (low + high)[column], 0.5 * (high - low)[column]
    poses[:, column] = np.linspace(middle - TIMES * half, middle + TIMES * half, count)
    return poses


def everywhere(surrogate: Surrogate, count: int) -> Array:
    """Random poses (count, 6) over three times the learned range of every parameter at once."""
    low, high = pose_bounds(surrogate)
    unit = np.random.default_rng(0).uniform(-1.0, 1.0, (count, 6))
    return 0.5 * (low + high) + TIMES * 0.5 * (high - low) * unit


def count_failures(model: Any, poses: Array, gaps_of: ElasticFoundation) -> tuple[int, int, int, int | None]:
    """Poses with a load that is not finite, with a pulling side, with contact where the surfaces of that side are more
    than 3 mm apart, and how many of all these have a validity above 1/2 (None for a model without validity). Contact
    without a direction cannot pull."""
    totals, valid = np.zeros(3, dtype=int), 0
    for begin in range(0, len(poses), _CHUNK):
        chunk = poses[begin : begin + _CHUNK]
        loads = model(chunk)
        broken = ~np.isfinite(loads).all(axis=1)
        pressed = normal_of(model, loads)
        pulling, touching = (pressed < 0.0).any(axis=1), (pressed > 0.0).any(axis=1)
        apart = np.zeros(len(chunk), dtype=bool)
        if touching.any():
            far = gaps_of.gaps(chunk[touching]) > FALSE_GAP_MM
            apart[touching] = (far & (pressed[touching] > 0.0)).any(axis=1)
        totals += [broken.sum(), pulling.sum(), apart.sum()]
        wrong = broken | pulling | apart
        if isinstance(model, Surrogate) and wrong.any():
            valid += int((model.validity(chunk[wrong]) > VALID).sum())
    return int(totals[0]), int(totals[1]), int(totals[2]), valid if isinstance(model, Surrogate) else None


def measure(bench: Bench, count: int = 100_000, per_parameter: int = 600) -> tuple[list[Line], None]:
    """Lines of row 3: each parameter alone, then all at once."""
    gaps_of = ElasticFoundation(bench.scene, bench.scene.grids["fine"])
    learned = bench.learned
    pose = bench.poses[len(bench.poses) // 3]
    cases = {f"{name}, {per_parameter} poses": along(learned, pose, name, per_parameter) for name in POSE_NAMES}
    cases[f"all at random, {count:,} poses"] = everywhere(learned, count)
    silent = [m for m, model in bench.models.items() if not isinstance(model, Surrogate)]
    why = {**bench.missing, **dict.fromkeys(silent, "says nothing about validity: last number")}
    lines = []
    for case, poses in cases.items():
        cells: dict[str, float | str] = {}
        for method, model in bench.models.items():
            if method in BY_DIFFERENCES and len(poses) > per_parameter:
                continue
            *numbers, valid = count_failures(model, poses, gaps_of)
            cells[method] = " / ".join([*(f"{n}" for n in numbers), "-" if valid is None else f"{valid}"])
        skipped = {
            m: "its values are those of the EF; counted on the fine grid"
            for m in BY_DIFFERENCES
            if m in bench.models and m not in cells
        }
        lines.append(Line(3, case, QUANTITY, cells, {**why, **skipped}))
    return lines, None
