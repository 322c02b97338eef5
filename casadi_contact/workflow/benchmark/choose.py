"""No more model than the scene needs: the cheapest measured model that meets a tolerance for the loads asked for."""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from casadi_contact.core.conventions import check_loads
from casadi_contact.core.quantities import FORCE, TORQUE, of_kind, three_digits
from casadi_contact.scenes.tolerance import Tolerance
from casadi_contact.surrogate.load import STRUCTURES, ready_surrogates
from casadi_contact.workflow.benchmark.candidates import (
    EF_FAMILY,
    FE_FAMILY,
    FOUNDATION_FAMILY,
    MX_SUFFIX,
    on_disk,
    own_name,
    refuse_without_elements,
    sized_path,
)
from casadi_contact.workflow.benchmark.front_file import FILE_NAME, Front, read_front, shipped_front
from casadi_contact.workflow.benchmark.measure import measure_project
from casadi_contact.workflow.project import Project

# How a foundation of a resolution is made, by a word in it.
_RESOLUTIONS = {
    "rays": "cc.PolarFoundation({scene}, cc.Rays({numbers}))",
    "cells": "cc.CellFoundation({scene}, cc.Cells({numbers}))",
    "points": "cc.CupFoundation({scene}, {numbers})",
}
_SAME_TIME = 1.03


@dataclass(frozen=True)
class Offer:
    """A model with its time per pose [µs] on the chart's machine and its RMS errors on unseen walking, for the loads
    of interest. force_rms_n or torque_rms_nmm is NaN where no such load is among them."""

    name: str
    time_us: float
    force_rms_n: float
    torque_rms_nmm: float


@dataclass(frozen=True)
class Choice:
    """The cheapest model that meets the tolerance (``model``), the next better one (None if there is none), the loads,
    the file of a surrogate (the name of a shipped one, None for other models), a line of Python that makes the model,
    and where errors and times come from (``measured``)."""

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
    tell: Callable[[str], None] | None = None,
) -> Choice:
    """The cheapest model on the measured front whose RMS error meets the tolerances for these loads; of models whose
    times differ by less than 3 % (the scatter from run to run), the most accurate.

    scene, preset, folder: as in `casadi-contact build` or `chart`, whose ``speed_accuracy.csv`` is read; where nothing
    has been built, the front shipped for this scene; without either, what is at hand is measured now (tell: called with
    what is next). loads: a name or names, all of the scene's if None; times are always those of all loads. Raises
    ValueError for a scene without elements, a wrong tolerance or load, and where nothing meets the tolerance."""
    project = Project.open(scene, preset, folder)
    refuse_without_elements(project)
    path, front = _front(project, tell)
    names = tuple(dict.fromkeys(check_loads(front.loads, loads)))
    tolerance = Tolerance.of_kinds(force_tolerance_n, torque_tolerance_nmm)
    for kind, wanted in ((FORCE, force_tolerance_n), (TORQUE, torque_tolerance_nmm)):
        if wanted is None and of_kind(names, kind):
            raise ValueError(f"no {kind.name} tolerance given, expected one because {kind.name}s are asked for")
    model, better = cheapest(within_tolerance(front, tolerance, names), tolerance)
    file = surrogate_file(project, model.name)
    machine = ", ".join(front.header[key] for key in ("processor", "system") if key in front.header)
    measured = f"measured on {machine or 'an unnamed machine'}, {front.header.get('threads', '?')} thread: {path}"
    python = python_line(project.scene.name if project.surrogate else str(scene), model.name, names, file)
    return Choice(model, better, names, file, python, measured)


def _front(project: Project, tell: Callable[[str], None] | None) -> tuple[Path, Front]:
    """The project's measured front, the shipped one of its scene where nothing has been built, or one measured now."""
    path = project.folder / FILE_NAME
    if not path.is_file():
        if not project.has_results and (shipped := shipped_front(project.scene)) is not None:
            return shipped
        measure_project(project, tell=tell)
    front = read_front(path)
    if front.header["scene_digest"] != project.scene.digest:
        raise ValueError(f"{path} is of another scene or an earlier version: run {project.command('chart')}")
    return path, front


def within_tolerance(front: Front, tolerance: Tolerance, loads: Sequence[str]) -> list[Offer]:
    """Every model of the chart that meets the tolerance for the loads; ValueError, naming the nearest, if none does."""
    offers = []
    for point in front.models:
        if point.value is None or any(load not in point.load_rms for load in loads):
            continue
        force, torque = (point.rms(kind, loads) for kind in (FORCE, TORQUE))
        offers.append(Offer(point.name, point.value.median_us, force, torque))
    if not offers:
        raise ValueError("the front holds no timed model with these loads: chart it again")
    found = [offer for offer in offers if _used(offer, tolerance) <= 1.0]
    if not found:
        nearest = min(offers, key=lambda offer: _used(offer, tolerance))
        rms = {"N": nearest.force_rms_n, "N·mm": nearest.torque_rms_nmm}
        has = " and ".join(f"{three_digits(value)} {unit}" for unit, value in rms.items() if not math.isnan(value))
        cure = "loosen it, or chart a larger preset"
        raise ValueError(f"no measured model is within the tolerance; the nearest, {nearest.name}, has {has}: {cure}")
    return found


def cheapest(offers: Sequence[Offer], tolerance: Tolerance) -> tuple[Offer, Offer | None]:
    """The cheapest of models that all meet the tolerance (of those within 3 % of its time the most accurate), and the
    cheapest of those more accurate than that."""
    offers = sorted(offers, key=lambda offer: offer.time_us)
    as_cheap = [offer for offer in offers if offer.time_us <= _SAME_TIME * offers[0].time_us]
    model = min(as_cheap, key=lambda offer: _used(offer, tolerance))
    better = [offer for offer in offers if _used(offer, tolerance) < _used(model, tolerance)]
    return model, better[0] if better else None


def _used(offer: Offer, tolerance: Tolerance) -> float:
    """Largest share of a tolerance that the errors use; a kind of load that was not asked for uses none."""
    rms = {FORCE.name: offer.force_rms_n, TORQUE.name: offer.torque_rms_nmm}
    return float(tolerance.rms_ratios([np.nan_to_num(rms[name]) for name in tolerance.names]).max(initial=0.0))


def surrogate_file(project: Project, name: str) -> Path | str | None:
    """The file of a surrogate of the chart, its name if it is a shipped one, None for other models."""
    base = name.removesuffix(MX_SUFFIX)
    if base in ready_surrogates():
        return base
    own = {own_name(structure): project.surrogate_path(structure) for structure in STRUCTURES}
    path = own.get(base, sized_path(project, base))
    return path if on_disk(project, path) is not None else None


def python_line(scene: str, name: str, loads: Sequence[str], file: Path | str | None) -> str:
    """How to make the model in Python (after ``import casadi_contact as cc``)."""
    if file is not None:
        compiled = ", compiled=False" if name.endswith(MX_SUFFIX) else ""
        return f"cc.load_surrogate({str(file)!r}).function({list(loads)!r}{compiled})"
    if name.startswith((f"{EF_FAMILY} ", f"{FE_FAMILY} ")):
        kind = "ElasticFoundation" if name.startswith(EF_FAMILY) else "FiniteElements"
        return f"cc.{kind}(cc.load_scene({scene!r}), grid=({name.split()[1].replace('×', ', ')}))"
    if name.startswith(f"{FOUNDATION_FAMILY} "):
        kind = next(kind for kind in _RESOLUTIONS if kind in name)
        numbers = ", ".join(re.findall(r"[\d.]+", name))
        return _RESOLUTIONS[kind].format(scene=f"cc.load_scene({scene!r})", numbers=numbers)
    return f"problems.studies.peers.peer_candidates(samples, {list(loads)!r}), the one named {name!r}"
