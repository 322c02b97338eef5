"""The measured models that can be made or read again by their names on the chart: timed, trained, loaded."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from statistics import median

from casadi_contact.core.conventions import Update
from casadi_contact.surrogate.load import STRUCTURES, load_surrogate, ready_surrogates
from casadi_contact.workflow.benchmark.candidate import Candidate
from casadi_contact.workflow.benchmark.candidates import (
    EF_FAMILY,
    FOUNDATION_FAMILY,
    MX_SUFFIX,
    own_name,
    surrogate_candidates,
    untrained_candidates,
)
from casadi_contact.workflow.benchmark.front_file import Point
from casadi_contact.workflow.benchmark.sizes import Sized, chart_surrogates, on_disk, sized_path, train_sizes
from casadi_contact.workflow.benchmark.timing import compare, one_thread
from casadi_contact.workflow.project import Project, available_motion
from casadi_contact.workflow.train import train

TIMED_AGAIN = "timed again for these loads"
SHARE = "estimated by the share of networks"
ALL_LOADS = "of all loads"
SCALED = "scaled to this machine"  # follows either where others were timed again
_TIMES_THE_CHEAPEST = 3.0  # machines differ, and so does what a network more or less costs

# How a foundation of a resolution is made, by a word in it.
_RESOLUTIONS = {
    "rays": "cc.PolarFoundation({scene}, cc.contact.Rays({numbers}))",
    "cells": "cc.CellFoundation({scene}, cc.contact.Cells({numbers}))",
    "points": "cc.CupFoundation({scene}, {numbers})",
}


def times_for_loads(project: Project, points: Sequence[Point], loads: Sequence[str]) -> dict[str, tuple[float, str]]:
    """Microseconds per pose of each model for some loads only, and how they were found.

    A surrogate is estimated by the share of its networks that the loads need, any other model by its measured time for
    all loads. Those at hand that may be the cheapest by this (`_TIMES_THE_CHEAPEST`) are timed again on a reference
    cycle, in one run on one thread, surrogates with just these networks; the others would cost a compilation each.
    Their estimates, of the machine that the chart was measured on, are multiplied by the median of timed / estimated
    (`SCALED`), so that all times are of this machine. Where nothing is timed again, all are of the chart's.
    """
    times = {point.name: _estimate(project, point, loads) for point in points}
    most = _TIMES_THE_CHEAPEST * min(point.value.median_us for point in points if point.value is not None)
    names = {name for name, (time_us, _) in times.items() if time_us <= most}
    poses = available_motion(project).poses[0]
    stopwatches = {c.name: c.time_value for c in _candidates(project, names, loads) if c.time_value is not None}
    with one_thread():
        timings = compare({name: partial(stopwatch, poses) for name, stopwatch in stopwatches.items()})
    again = {name: (timing.median_us, TIMED_AGAIN) for name, timing in timings.items()}
    if not again:
        return times
    slower = median(time_us / times[name][0] for name, (time_us, _) in again.items())
    return {name: (slower * time_us, f"{how}, {SCALED}") for name, (time_us, how) in times.items()} | again


def _estimate(project: Project, point: Point, loads: Sequence[str]) -> tuple[float, str]:
    """Microseconds per pose on the chart's machine for these loads, from those for all, and how they were found."""
    assert point.value is not None
    structure = point.family.removesuffix(MX_SUFFIX)
    if structure not in STRUCTURES:
        return point.value.median_us, ALL_LOADS
    needed, all_ = (
        len(STRUCTURES[structure].networks_for(project.scene, names)) for names in (loads, project.scene.load_names)
    )
    return needed / all_ * point.value.median_us, SHARE


def make_surrogate(
    project: Project, name: str, loads: Sequence[str] | None, update: Update | None
) -> Path | str | None:
    """The file of a surrogate, trained (for these loads) if it is not on disk, or its name if it is a shipped one; None
    for other models."""
    found = surrogate_file(project, name, loads)
    if found is not None:
        return found
    base = name.removesuffix(MX_SUFFIX)
    if base in _sized(project):
        return train_sizes(project, [_sized(project)[base]], update, loads=loads)[0]
    if base in (own_name(project, structure) for structure in project.preset.efforts):
        train(project, update)
        return surrogate_file(project, name, loads)
    return None


def surrogate_file(project: Project, name: str, loads: Sequence[str] | None) -> Path | str | None:
    """The file of a surrogate with all networks (its name if shipped), or with those for these loads; None if neither
    can be read."""
    base = name.removesuffix(MX_SUFFIX)
    paths: list[Path | str] = [ready for ready in ready_surrogates() if ready == base]
    paths += [project.surrogate_path(s) for s in STRUCTURES if own_name(project, s) == base]
    if base in _sized(project):
        sized = _sized(project)[base]
        paths += [sized_path(project, sized), *([sized_path(project, sized, loads)] if loads else [])]
    return next((path for path in paths if on_disk(project, path) is not None), None)


def python_line(scene: str, name: str, loads: Sequence[str], file: Path | str | None) -> str:
    """How to make the model in Python (after ``import casadi_contact as cc``)."""
    if file is not None:
        compiled = "" if name.endswith(MX_SUFFIX) else ", compiled=True"
        return f"cc.load_surrogate({str(file)!r}).function({list(loads)!r}{compiled})"
    if name.startswith(f"{EF_FAMILY} "):
        return f"cc.ElasticFoundation(cc.load_scene({scene!r}), grid=({name.split()[1].replace('×', ', ')}))"
    if name.startswith(f"{FOUNDATION_FAMILY} "):
        kind = next(kind for kind in _RESOLUTIONS if kind in name)
        numbers = ", ".join(re.findall(r"[\d.]+", name))
        return _RESOLUTIONS[kind].format(scene=f"cc.load_scene({scene!r})", numbers=numbers)
    maker = (
        f"casadi_contact.workflow.benchmark.peers.candidates.peer_candidates(samples, gflop=..., names={list(loads)!r})"
    )
    return f"{maker}, the one named {name!r}"


def _candidates(project: Project, names: set[str], loads: Sequence[str]) -> Iterator[Candidate]:
    """The named models that are at hand, surrogates reduced to the loads."""
    yield from untrained_candidates(project.scene, loads, names)
    for name in names:
        path = surrogate_file(project, name, loads)
        if path is not None:
            graph = name.endswith(MX_SUFFIX)
            variants = surrogate_candidates(name.removesuffix(MX_SUFFIX), load_surrogate(path), loads, graph=graph)
            yield from (candidate for candidate in variants if candidate.name == name)


def _sized(project: Project) -> dict[str, Sized]:
    return {sized.name: sized for sized in chart_surrogates(project.preset.chart, project.scene)}
