"""Measure the compiled kernels of a project's surrogates."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

from casadi_contact.benchmark.kernel_speed import kernel_speed
from casadi_contact.files import replacing
from casadi_contact.machine import machine_record
from casadi_contact.project import Project, project_surrogates, read_motion

SPEED_FILE = "kernel_speed.json"
_POSES = 505


def speed(project: Project) -> Path:
    """Time the kernels of the project's surrogates on poses of its reference cycles; write ``kernel_speed.json``.

    Raises FileNotFoundError without a trained surrogate, CompilerError without a compiler.
    """
    poses = read_motion(project)[0].poses.reshape(-1, 6)[:_POSES]
    measured = {
        structure: kernel_speed(surrogate, poses) for structure, surrogate in project_surrogates(project).items()
    }
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
