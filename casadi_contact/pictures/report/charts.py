"""All charts of the measured speed-accuracy front, drawn from ``speed_accuracy.csv`` only."""

from __future__ import annotations

from pathlib import Path

from casadi_contact.pictures.report.figure import save
from casadi_contact.pictures.report.scatter import draw_gradient_hessian_time, draw_speed_accuracy
from casadi_contact.pictures.report.series import (
    draw_error_by_domain,
    draw_error_by_samples,
    draw_error_by_training_time,
)
from casadi_contact.workflow.benchmark.front_file import Front

CHARTS = {
    "speed_accuracy": draw_speed_accuracy,
    "gradient_hessian_time": draw_gradient_hessian_time,
    "error_by_domain": draw_error_by_domain,
    "error_by_samples": draw_error_by_samples,
    "error_by_training_time": draw_error_by_training_time,
}


def draw_charts(front: Front, folder: Path) -> list[Path]:
    """Write every chart that the file has numbers for, as .png and .svg, into the folder; return their paths."""
    figures = {name: draw(front) for name, draw in CHARTS.items()}
    return [path for name, figure in figures.items() if figure is not None for path in save(figure, folder, name)]
