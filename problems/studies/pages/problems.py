"""Pages of what problems measure: pose estimation, muscle and contact together, stability."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from casadi_contact.optimisation.knee import SIDES
from problems.studies.muscle_settings import error_cell
from problems.studies.pages.markdown import machine, number, page, table
from problems.studies.pages.stored import damage_told, read_stored
from problems.studies.stability.table import FAILURES, Line


def pose_estimation_page(paths: Sequence[Path]) -> str:
    """One line per ``summary.json`` of ``python -m problems.pose_estimation``."""
    found = {path: read_stored(path) for path in paths}
    any_starts = any(summary.get("random_starts") for summary in found.values())
    rows = []
    for path, summary in found.items():
        with damage_told(path):
            rows.append(_pose_row(summary, any_starts))
    with damage_told(paths[0]):
        return _pose_page(found[paths[0]], rows, any_starts)


def _pose_row(summary: Mapping[str, Any], any_starts: bool) -> list[str]:
    errors = summary["errors"]
    forces = [", ".join(_rms_and_largest(errors[side][key]) for side in SIDES) for key in ("fine_ef", "teacher_ef")]
    starts = summary.get("random_starts")
    row = [summary["cycle"], f"{summary['converged']} of {summary['frames']}", str(summary["ipopt_iterations"])]
    row += [f"{summary['seconds']:.2f}", *forces]
    if any_starts:
        row.append(f"{starts['reached']} of {starts['count']}" if starts else "")
    return row


def _pose_page(first: Mapping[str, Any], rows: Sequence[Sequence[str]], any_starts: bool) -> str:
    grids = first["ef_grids"]
    columns = [
        *("cycle", "frames solved", "IPOPT iterations", "time [s]"),
        *(f"EF {grids[key]} − surrogate, medial, lateral [N]" for key in ("fine", "teacher")),
        *(["random starts that end at the same poses"] if any_starts else []),
    ]
    return page(
        "Pose estimation",
        f"All frames of a cycle in one IPOPT problem on the `{first['structure']}` surrogate of scene "
        f"`{first['scene']}`, with [`python -m problems.pose_estimation`](../problems/pose-estimation.md). Forces "
        "are re-evaluated on the elastic foundation (EF) at the solved poses: RMS (largest). Cycles og1_loads to "
        "og4_loads are the measured ones that the built-in walking derives from; they are not part of the repository.",
        machine(first["machine"]),
        table(columns, rows),
    )


def muscle_contact_page(paths: Sequence[Path], settings: Path | None = None) -> str:
    """One line per ``summary.json`` of ``python -m problems.muscle_contact`` with measured forces; settings: the
    result file of ``python -m problems.studies.muscle_settings``, a line for each that was tried."""
    found, rows = {path: read_stored(path) for path in paths}, []
    for path, summary in found.items():
        with damage_told(path):
            rows.append(_muscle_row(summary))
    with damage_told(paths[0]):
        parts = _muscle_parts(found[paths[0]], rows)
    if settings is not None:
        tried = read_stored(settings)
        with damage_told(settings):
            parts += _settings(tried)
    return page("Muscle and contact forces", *parts)


def _muscle_row(summary: Mapping[str, Any]) -> list[str]:
    errors = summary["errors_n"]
    measured = [f"{number(errors[s]['prediction']['rms'])} ({errors[s]['prediction']['mean']:+.0f})" for s in SIDES]
    teacher = ", ".join(_rms_and_largest(errors[side]["teacher_ef"]) for side in SIDES)
    solved = f"{summary['converged']} of {summary['frames']}"
    return [summary["walk"], solved, str(summary["ipopt_iterations"]), f"{summary['seconds']:.2f}", *measured, teacher]


def _muscle_parts(first: Mapping[str, Any], rows: Sequence[Sequence[str]]) -> list[str]:
    columns = [
        *("cycle", "frames solved", "IPOPT iterations", "time [s]"),
        *("medial RMS error (mean) [N]", "lateral RMS error (mean) [N]"),
        f"EF {first['ef_grids']['teacher']} − surrogate, medial, lateral [N]",
    ]
    return [
        "Contact forces predicted by [`python -m problems.muscle_contact`](../problems/muscle-contact.md) against "
        "those that the instrumented implant measured, which enter the prediction nowhere. The last column is the "
        "elastic foundation (EF) at the solved poses: RMS (largest).",
        machine(first["machine"]),
        table(columns, rows),
    ]


def _settings(lines: dict[str, Any]) -> list[str]:
    cycles = list(next(iter(lines.values())))
    return [
        "## All settings that were tried",
        "RMS error (mean) of the medial and the lateral side [N], by `python -m problems.studies.muscle_settings`.",
        table(["setting", *cycles], [[name, *map(error_cell, line.values())] for name, line in lines.items()]),
    ]


def stability_page(path: Path) -> str:
    """The table of a ``stability.json``, method by failure."""
    content = read_stored(path)
    with damage_told(path):
        return _stability_page(content)


def _stability_page(content: Mapping[str, Any]) -> str:
    scene = content["settings"].get("scene", "knee")
    lines = [Line(**line) for line in content["lines"]]
    methods = list(dict.fromkeys(method for line in lines for method in line.values))
    settings = "; ".join(f"{name.replace('_', ' ')}: {_setting(value)}" for name, value in content["settings"].items())
    parts = [
        "Every method is tried on the same hard cases by `python -m problems.studies.stability`; the page of that "
        "[study](../problems/stability.md) says what each row does. A dash says that the quantity makes no sense for "
        "the method.",
        f"Settings of this run: {settings}.",
        machine(content["machine"]),
    ]
    for row in sorted({line.row for line in lines}):
        mine = [line for line in lines if line.row == row]
        cells = [[f"{x.case}: {x.quantity}", *(x.cell(method) for method in methods)] for x in mine]
        parts += [f"## {row}. {FAILURES[row]}", table(["case: quantity", *methods], cells)]
        if reasons := _reasons(mine, methods):
            parts.append(f"Where there is no entry, or only a part of one:\n\n{reasons}")
    return page("Stability where methods fail" if scene == "knee" else f"Stability where methods fail: {scene}", *parts)


def _setting(value: Any) -> str:
    """A setting in words: grids as 80×40, yes or no."""
    if isinstance(value, dict):
        return ", ".join(f"{name} {'×'.join(map(str, grid))}" for name, grid in value.items())
    return ("yes" if value else "no") if isinstance(value, bool) else str(value)


def _reasons(lines: Sequence[Line], methods: Sequence[str]) -> str:
    """A line for each reason, with the methods of the page that it holds for."""
    found: dict[str, dict[str, None]] = {}
    for line in lines:
        for method, why in line.reasons.items():
            if method in methods:
                found.setdefault(why, {})[method] = None
    return "\n".join(f"- {'; '.join(of)}: {why}" for why, of in found.items())


def _rms_and_largest(error: dict[str, float]) -> str:
    return f"{error['rms']:.2f} ({error['max']:.1f})"
