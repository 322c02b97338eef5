"""All charts of the measured speed-accuracy front, drawn from ``speed_accuracy.csv`` only."""

from __future__ import annotations

from pathlib import Path

from casadi_contact.pictures.report.figure import save
from casadi_contact.pictures.report.scatter import draw_gradient_hessian_time, draw_speed_accuracy
from casadi_contact.workflow.benchmark.front_file import Front

CHARTS = {
    "speed_accuracy": draw_speed_accuracy,
    "gradient_hessian_time": draw_gradient_hessian_time,
}


def draw_charts(front: Front, folder: Path) -> list[Path]:
    """Write every chart as .png and .svg into the folder; return their paths."""
    return [path for name, draw in CHARTS.items() for path in save(draw(front), folder, name)]
