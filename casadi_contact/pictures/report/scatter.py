"""Time against error: one point per model, one colour and marker per family, the Pareto front."""

from __future__ import annotations

from typing import Any

from casadi_contact.pictures.report.figure import errors_of, families, family_name, legend_beside, log_scale, panels
from casadi_contact.pictures.report.labels import place_labels
from casadi_contact.pictures.report.style import family_styles
from casadi_contact.workflow.benchmark.front_file import Front, Point, pareto
from casadi_contact.workflow.benchmark.timing import Timing

Measured = tuple[Point, Timing, float]


def draw_speed_accuracy(front: Front, title: str = "time per pose against error", measured: str | None = None) -> Any:
    """Time per pose against RMS error, for forces and for torques, as far as the scene has them; measured: on what
    (unseen poses of the scene's motion if left out)."""
    errors = errors_of(front)
    figure, axes = panels(front, len(errors), title, measured)
    shown = []
    for axis, (kind, error) in zip(axes, errors, strict=True):
        shown.append(_scatter(axis, front, "value", error))
        axis.set(xlabel="time per pose [µs]", ylabel=f"RMS {kind.name} error [{kind.unit}]")
    return _labelled(figure, axes, shown, front)


def draw_gradient_hessian_time(front: Front) -> Any:
    """Time of the Jacobian and of the Lagrangian Hessian against the RMS error of the forces, of a scene without these
    of the torques, on unseen poses of its motion."""
    kind, error = errors_of(front)[0]
    figure, axes = panels(front, 2, "time of derivatives of all loads against error")
    shown = []
    for axis, (what, label) in zip(axes, (("jacobian", "Jacobian"), ("hessian", "Lagrangian Hessian")), strict=True):
        shown.append(_scatter(axis, front, what, error))
        axis.set(xlabel=f"time per {label} [µs]", ylabel=f"RMS {kind.name} error [{kind.unit}]")
    return _labelled(figure, axes, shown, front)


def _scatter(axis: Any, front: Front, what: str, error: str) -> list[Measured]:
    """Draw the points (model, timing, error) that have both numbers, with the spread of their times."""
    shown: list[Measured] = []
    for family, style in family_styles(families(front.points)).items():
        mine = [(p, getattr(p, what), getattr(p, error)) for p in front.models if p.family == family]
        mine = [(point, timing, rms) for point, timing, rms in mine if timing is not None and rms > 0.0]
        if not mine:
            continue
        times, errors = [timing.median_us for _, timing, _ in mine], [rms for *_, rms in mine]
        spread = [[t.median_us - t.low_us for _, t, _ in mine], [t.high_us - t.median_us for _, t, _ in mine]]
        keywords = {"ls": "none", "ms": 6, "elinewidth": 0.8, "label": family_name(family), **style.keywords}
        axis.errorbar(times, errors, xerr=spread, **keywords)
        shown += mine
    best = [shown[i] for i in pareto([(timing.median_us, rms) for _, timing, rms in shown])]
    line = {"color": "0.6", "lw": 4.0, "alpha": 0.5, "zorder": 0, "label": "Pareto front"}
    axis.plot([timing.median_us for _, timing, _ in best], [rms for *_, rms in best], **line)
    log_scale(axis)
    axis.margins(0.08)
    return shown


def _labelled(figure: Any, axes: Any, shown: list[list[Measured]], front: Front) -> Any:
    """Legend, then the labels, when nothing moves any more."""
    legend_beside(figure, axes)
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    styles = family_styles(families(front.points))
    for axis, points in zip(axes, shown, strict=True):
        labels = [
            (timing.median_us, rms, point.name.removeprefix(f"{point.family} "), styles[point.family].text_colour)
            for point, timing, rms in points
        ]
        place_labels(axis, labels, [(timing.low_us, timing.high_us, rms) for _, timing, rms in points])
    return figure
