"""Measure the compiled kernels of a project's surrogates, or of the shipped ones where nothing has been built."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

from casadi_contact.core.files.writing import replacing
from casadi_contact.core.machine import machine_record
from casadi_contact.workflow.benchmark.kernel_speed import kernel_speed
from casadi_contact.workflow.project import Project, available_poses, available_surrogates

SPEED_FILE = "kernel_speed.json"
_POSES = 505


def speed(project: Project) -> Path:
    """Time the kernels of the project's surrogates on poses of its cycles or table; write ``kernel_speed.json``.

    Where nothing has been built: of the scene's shipped surrogates, on poses of the built-in cycles.

    Raises FileNotFoundError without a trained surrogate, CompilerError without a compiler.
    """
    surrogates = available_surrogates(project)
    poses = available_poses(project)[:_POSES]
    measured = {structure: kernel_speed(surrogate, poses) for structure, surrogate in surrogates.items()}
    content = {
        "format": "casadi_contact kernel speed",
        "format_version": 1,
        "machine": machine_record(),
        "surrogates": {
            structure: {
                "microseconds": {what: asdict(timing) for what, timing in found.timings.items()},
                "limit_us": found.limit.us,
                "limit": str(found.limit),
            }
            for structure, found in measured.items()
        },
    }
    path = project.folder / SPEED_FILE
    with replacing(path) as beside:
        beside.write_text(json.dumps(content, indent=1, ensure_ascii=False), "utf-8")
    return path
