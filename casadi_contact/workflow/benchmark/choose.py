"""No more model than the scene needs: the cheapest measured model that meets a tolerance for the loads asked for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from casadi_contact.core.conventions import Update, check_loads
from casadi_contact.core.quantities import FORCE, TORQUE, of_kind, three_digits
from casadi_contact.scenes.tolerance import Tolerance
from casadi_contact.workflow.benchmark.at_hand import make_surrogate, python_line, times_for_loads
from casadi_contact.workflow.benchmark.candidates import refuse_without_elements
from casadi_contact.workflow.benchmark.front_file import FILE_NAME, Front, read_front
from casadi_contact.workflow.benchmark.shipped import shipped_front
from casadi_contact.workflow.project import Project

MEASURED = "measured"
SAME_TIME = 1.03  # times nearer than this factor differ by less than they do from run to run


@dataclass(frozen=True)
class Offer:
    """A model with its time per pose and its RMS errors on unseen walking, for the loads asked for.

    timing says how the time was found: on the chart's machine, or on this one where models were timed again.
    force_rms_n or torque_rms_nmm is NaN where no such load was asked for.
    """

    name: str
    family: str
    time_us: float
    timing: str
    force_rms_n: float
    torque_rms_nmm: float


@dataclass(frozen=True)
class Choice:
    """The cheapest model that meets the tolerance (``model``), the next better one (None if there is none), the loads
    asked for, the file of a surrogate (the name of a shipped one, None for other models), a line of Python that makes
    the model, and where errors and the chart's times come from (``measured``)."""

    model: Offer
    better: Offer | None
    loads: tuple[str, ...]
    path: Path | str | None
    python: str
    measured: str


def choose(
    scene: str | Path,
    *,
    force_tolerance_n: float | None = None,
    torque_tolerance_nmm: float | None = None,
    loads: Sequence[str] | None = None,
    preset: str = "quick",
    folder: Path | None = None,
    update: Update | None = None,
) -> Choice:
    """The cheapest model on the measured front whose RMS error meets the tolerances for just these loads; of models
    that are as cheap, the most accurate.

    scene, preset, folder: as in `casadi-contact chart`, whose ``speed_accuracy.csv`` is read; where nothing has been
    built, the front that comes with the library for this scene, of models that are at hand. loads: a name or names, all
    of the scene's if None. For some loads only, a surrogate's time is that of the networks they need, and times are of
    this machine: timed again, or the chart's scaled to it. A chosen size that is not on disk is trained, with these
    networks only; update is called as in `project.train.train`.

    Raises FileNotFoundError where nothing has been measured; ValueError for a scene without elements, a tolerance that
    is missing or not above 0, an unknown load, a file of another scene, and where nothing meets the tolerance (naming
    the nearest).
    """
    project = Project.open(scene, preset, folder)
    refuse_without_elements(project)
    path, front = _front(project)
    names, tolerance = _asked(front, loads, force_tolerance_n, torque_tolerance_nmm)
    offers = meeting(front, tolerance, names)
    if set(names) != set(front.loads):
        points = [point for point in front.models if point.name in {offer.name for offer in offers}]
        times = times_for_loads(project, points, names)
        offers = [replace(o, time_us=times[o.name][0], timing=times[o.name][1]) for o in offers]
    model, better = cheapest(offers, tolerance)
    file = make_surrogate(project, model.name, None if set(names) == set(front.loads) else names, update)
    machine = ", ".join(front.header[key] for key in ("processor", "system") if key in front.header)
    measured = f"measured on {machine or 'an unnamed machine'}, {front.header.get('threads', '?')} thread: {path}"
    return Choice(
        model,
        better,
        names,
        file,
        python_line(project.scene.name if project.surrogate else str(scene), model.name, names, file),
        measured,
    )


def _front(project: Project) -> tuple[Path, Front]:
    """The project's measured front, or the shipped one of its scene where nothing has been built."""
    path = project.folder / FILE_NAME
    if path.is_file():
        front = read_front(path)
        if front.header["scene_digest"] != project.scene.digest:
            raise ValueError(
                f"{path} was measured on another scene than {project.scene.name} as it is now, or by an earlier "
                f"version: run {project.command('chart')}"
            )
        return path, front
    shipped = None if project.has_results else shipped_front(project.scene)
    if shipped is None:
        command = project.command("chart")
        raise FileNotFoundError(f"{path} does not exist, so nothing has been measured: run {command} first")
    return shipped


def _asked(
    front: Front, loads: Sequence[str] | None, force_n: float | None, torque_nmm: float | None
) -> tuple[tuple[str, ...], Tolerance]:
    """Loads and tolerance, checked against each other."""
    names = tuple(dict.fromkeys(check_loads(front.loads, loads)))
    tolerance = Tolerance.of_kinds(force_n, torque_nmm)
    for kind, wanted in ((FORCE, force_n), (TORQUE, torque_nmm)):
        if wanted is None and of_kind(names, kind):
            raise ValueError(f"no {kind.name} tolerance given, expected one because {kind.name}s are asked for")
    others = [name for name in names if name not in (*of_kind(names, FORCE), *of_kind(names, TORQUE))]
    if others:
        raise ValueError(f"no tolerance can be given for {', '.join(others)}, expected forces and torques only")
    return names, tolerance


def meeting(front: Front, tolerance: Tolerance, loads: Sequence[str]) -> list[Offer]:
    """Every model of the chart that meets the tolerance for the loads, with its time for all loads.

    Raises ValueError, naming the nearest, if none does.
    """
    offers = []
    for point in front.models:
        if point.value is None or any(load not in point.load_rms for load in loads):
            continue
        force, torque = (point.rms(kind, loads) for kind in (FORCE, TORQUE))
        offers.append(Offer(point.name, point.family, point.value.median_us, MEASURED, force, torque))
    if not offers:
        raise ValueError("the front holds no timed model with these loads: chart it again")
    found = [offer for offer in offers if _used(offer, tolerance) <= 1.0]
    if not found:
        nearest = min(offers, key=lambda offer: _used(offer, tolerance))
        wanted = dict(zip(tolerance.names, tolerance.allowed.tolist(), strict=True))
        raise ValueError(
            f"no measured model meets {_errors_text(wanted.get(FORCE.name), wanted.get(TORQUE.name))}; the nearest, "
            f"{nearest.name}, has {_errors_text(nearest.force_rms_n, nearest.torque_rms_nmm)}: "
            "loosen the tolerance, or chart a larger preset"
        )
    return found


def cheapest(offers: Sequence[Offer], tolerance: Tolerance) -> tuple[Offer, Offer | None]:
    """The cheapest of models that all meet the tolerance, the most accurate one of those that are as cheap
    (`SAME_TIME`), and the cheapest of those more accurate than that."""
    offers = sorted(offers, key=lambda offer: offer.time_us)
    as_cheap = [offer for offer in offers if offer.time_us <= SAME_TIME * offers[0].time_us]
    model = min(as_cheap, key=lambda offer: _used(offer, tolerance))
    better = [offer for offer in offers if _used(offer, tolerance) < _used(model, tolerance)]
    return model, better[0] if better else None


def _used(offer: Offer, tolerance: Tolerance) -> float:
    """Largest share of a tolerance that the errors use; a kind of load that was not asked for uses none."""
    rms = {FORCE.name: offer.force_rms_n, TORQUE.name: offer.torque_rms_nmm}
    return float(tolerance.rms_ratios([np.nan_to_num(rms[name]) for name in tolerance.names]).max(initial=0.0))


def _errors_text(force_n: float | None, torque_nmm: float | None) -> str:
    pairs = ((force_n, "N"), (torque_nmm, "N·mm"))
    return " and ".join(
        f"{three_digits(value)} {unit}" for value, unit in pairs if value is not None and not math.isnan(value)
    )
