"""Error against domain, number of samples and training time."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from casadi_contact.pictures.report.figure import errors_of, families, legend_beside, log_scale, panels
from casadi_contact.pictures.report.style import family_styles
from casadi_contact.samples.samples import DOMAINS
from casadi_contact.workflow.benchmark.front_file import SAMPLES, SECONDS, Front, Point

UNSEEN = "unseen motion"
ROUNDING = 1e-6  # N or N·mm


def draw_error_by_domain(front: Front) -> Any | None:
    """RMS error per domain, against the samples' contact model, of the cheapest and the most accurate model of each
    family; None where no model has one."""
    if not any(point.domain_force_rms_n or point.domain_torque_rms_nmm for point in front.models):
        return None
    note = "Dashed: cheapest of its family, solid: most accurate. An error of zero (D5) is not on a log axis."
    errors = errors_of(front)
    by_domain = [getattr(point, f"domain_{error}") for point in front.models for _, error in errors]
    domains = [domain for domain in DOMAINS if any(domain in found for found in by_domain)]
    figure, axes = panels(
        front, len(errors), "error per domain", "test samples, errors against their own contact model", note
    )
    styles = family_styles(families(front.points))
    for axis, (kind, error) in zip(axes, errors, strict=True):
        for family, style in styles.items():
            for point, dash in _extremes([p for p in front.models if p.family == family], error):
                found = getattr(point, f"domain_{error}")
                rms = [off if (off := found.get(domain, 0.0)) > ROUNDING else math.nan for domain in domains]
                axis.plot(range(len(domains)), rms, ls=dash, lw=1.0, ms=5, label=point.name, **style.keywords)
        log_scale(axis, "y")
        axis.set(xlabel="domain", ylabel=f"RMS {kind.name} error [{kind.unit}]")
        axis.set_xticks(range(len(domains)), domains)
    legend_beside(figure, axes)
    return figure


def draw_error_by_samples(front: Front) -> Any | None:
    """RMS error of one size against the number of samples it learned from."""
    return _swept(front, SAMPLES, lambda point: float(point.samples), "samples learned from")


def draw_error_by_training_time(front: Front) -> Any | None:
    """RMS error of one size against its training time."""
    return _swept(front, SECONDS, lambda point: point.training_seconds, "training time of all networks [s of one core]")


def _extremes(points: Sequence[Point], error: str) -> list[tuple[Point, str]]:
    """The cheapest and the most accurate point with their line styles, of those with an error in some domain; the EF
    that made the samples has none but rounding."""
    wrong = [p for p in points if max(getattr(p, f"domain_{error}").values(), default=0.0) > ROUNDING]
    timed = [(p, p.value.median_us) for p in wrong if p.value]
    if not timed:
        return []
    cheapest = min(timed, key=lambda pair: pair[1])[0]
    best = min((p for p, _ in timed), key=lambda p: getattr(p, error))
    return [(best, "-")] if cheapest is best else [(cheapest, "--"), (best, "-")]


def _domains(points: Sequence[Point], error: str) -> list[str]:
    """Of D1, D3 and D4 those that the scene has: a joint of one patch has no D4."""
    return [domain for domain in ("D1", "D3", "D4") if all(domain in getattr(p, f"domain_{error}") for p in points)]


def _swept(front: Front, sweep: str, cost: Callable[[Point], float], label: str) -> Any | None:
    """The swept points with the model they vary, on unseen poses and up to three domains; None if the file has none."""
    points = list(front.swept(sweep))
    if not points:
        return None
    model = points[0].name.partition(" (")[0]
    points = sorted([*points, *(p for p in front.models if p.name == model)], key=cost)
    errors = errors_of(front)
    figure, axes = panels(front, len(errors), f"error of {model} against {label.partition(' [')[0]}")
    for axis, (kind, error) in zip(axes, errors, strict=True):
        for where, style in family_styles([UNSEEN, *_domains(points, error)]).items():
            rms = [getattr(p, error) if where == UNSEEN else getattr(p, f"domain_{error}")[where] for p in points]
            legend = where if where == UNSEEN else f"test samples of {where}, against their own contact model"
            axis.plot([cost(p) for p in points], rms, ms=5, lw=1.0, label=legend, **style.keywords)
        log_scale(axis)
        axis.set(xlabel=label, ylabel=f"RMS {kind.name} error [{kind.unit}]")
    axes[0].legend(fontsize=8)
    return figure
