"""Pages of what the library measures: speed and accuracy, errors by domain, kernels."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

from casadi_contact.core.conventions import load_unit
from casadi_contact.core.files.writing import replacing, writable_folder
from casadi_contact.pictures.report.charts import draw_charts
from casadi_contact.pictures.report.figure import family_name
from casadi_contact.pictures.report.kernel_speed import read_kernel_speed, times_the_limit
from casadi_contact.pictures.report.tables import read_evaluation
from casadi_contact.scenes.ready_files import ready_scenes
from casadi_contact.workflow.benchmark.front_file import SAMPLES, SECONDS, SIZE, TIMES, Front, Point, read_front
from problems.studies.pages.markdown import machine, number, page, table
from problems.studies.pages.stored import damage_told, read_stored
from problems.studies.seeds import KINDS

_OWN_NUMBERS = re.compile(r"\d\.\d|\bof \d")
_CHARTS = {
    "speed_accuracy": "Time per pose against error on unseen poses",
    "gradient_hessian_time": "Time of Jacobian and Hessian against error",
    "error_by_domain": "Error by domain of the cheapest and of the most accurate model of each family",
    "error_by_samples": "Error against the number of samples",
    "error_by_training_time": "Error against training time",
}


def speed_accuracy_page(path: Path, title: str = "Speed and accuracy") -> str:
    """Charts (see `draw_speed_accuracy`) and table of a front; pictures lie in a folder of its file's name."""
    front = read_front(path)
    needs = {"error_by_samples": SAMPLES, "error_by_training_time": SECONDS}
    swept = front.swept(*needs.values())
    sweeps = {SIZE, *(p.sweep for p in swept)}
    by_domain = any(point.domain_force_rms_n for point in front.models)
    shown = [x for x in _CHARTS if needs.get(x, SIZE) in sweeps and (by_domain or x != "error_by_domain")]
    pictures = {x: f"![{_CHARTS[x]}]({path.stem}/{x}.png)" for x in shown}
    header = front.header
    command = f"python -m casadi_contact.workflow.benchmark.shipped {header['scene']}"
    if "command" in header:
        command = header["command"]
    elif "preset" in header:
        ready = header["scene"] in ready_scenes()
        given = header["scene"] if ready else f"problems/implant/{header['scene']}.toml"
        command = f"casadi-contact chart {given} --preset {header['preset']}"
        command += " --peers" if any(point.family == "polynomial" for point in front.points) else ""
    intro = (
        f"Every model of the scene `{header['scene']}` in one run on {header['threads']} thread: RMS errors on "
        f"{header['walking_poses']} poses of its motion that no model has seen, against {header['reference']}; medians "
        f"of the time per pose. `{command}` measures this table."
    )
    compared = front.models
    first = [pictures[x] for x in ("speed_accuracy", "gradient_hessian_time")]
    parts = [intro, machine(header), *first, "## All models", _front_table(compared)]
    if remarks := _remarks(compared):
        parts.append(f"How the models of each family were evaluated, and what they are made of:\n\n{remarks}")
    if swept:
        series = [pictures[x] for x in needs if x in pictures]
        parts += ["## One size with other samples and budgets", _front_table(swept), *_repeats(front), *series]
    failed = [f"- {p.name}: {p.failure}" for p in front.points if p.failure]
    if failed:
        parts += ["## Not measured", "\n".join(failed)]
    if by_domain:
        parts += ["## By domain", pictures["error_by_domain"]]
    return page(title, *parts)


def draw_speed_accuracy(path: Path, out: Path) -> None:
    """Draw the charts of a ``speed_accuracy.csv`` as PNG into the folder of its name."""
    writable_folder(out / path.stem)
    with TemporaryDirectory() as folder:
        for drawn in draw_charts(read_front(path), Path(folder)):
            if drawn.suffix == ".png":
                with replacing(out / path.stem / drawn.name) as beside:
                    beside.write_bytes(drawn.read_bytes())


def _repeats(front: Front) -> list[str]:
    """A line that names the rows left out, if there are any."""
    if not front.repeats:
        return []
    names, earlier = ", ".join(front.repeats), ", ".join(dict.fromkeys(front.repeats.values()))
    return [f"Left out: {names}. Training ended by itself within a smaller budget; these are {earlier} again."]


def _front_table(points: Sequence[Point]) -> str:
    rows = []
    for point in points:
        timings = [getattr(point, what) for what in TIMES[:3]]
        times = ["" if timing is None else number(timing.median_us) for timing in timings]
        trained = [str(point.samples), number(point.training_seconds)] if point.samples else ["", ""]
        rows.append([point.name, *times, number(point.force_rms_n), number(point.torque_rms_nmm), *trained])
    columns = ["value [µs]", "Jacobian [µs]", "Hessian [µs]", "force [N]", "torque [N·mm]", "samples", "training [s]"]
    return table(["model", *columns], rows)


def _remarks(points: Sequence[Point]) -> str:
    """A line for each family with what the file remarks of its models, but for numbers of single models."""
    told: dict[str, dict[str, None]] = {}
    for point in points:
        remarks = [part.strip() for part in point.remark.split(";")]
        general = [remark for remark in remarks if remark and not _OWN_NUMBERS.search(remark)]
        told.setdefault(family_name(point.family), {}).update(dict.fromkeys(general))
    return "\n".join(f"- {family}: {'; '.join(remarks)}" for family, remarks in told.items() if remarks)


def solve_time_page(path: Path) -> str:
    """Table of a ``solve_time.csv``, with the picture beside it."""
    front = read_front(path)
    header = front.header
    rows = []
    for point in front.points:
        if point.value is None:
            rows.append([point.name, "", "", "", point.failure])
            continue
        errors = [number(point.force_rms_n), number(point.torque_rms_nmm)]
        rows.append([point.name, number(1e-3 * point.value.median_us), *errors, point.remark])
    intro = (
        f"Pose estimation of the cycle `{header['cycle']}` by every contact model of the scene `{header['scene']}`, "
        "solved whole, start and settling included, several times in turn in one run on one thread: medians. RMS "
        f"errors are of the loads at the poses found, against {header['reference']}. `python -m "
        f"problems.studies.solve_time {header['scene']}` measures this."
    )
    columns = ["model", "time a frame [ms]", "force [N]", "torque [N·mm]", "remark"]
    picture = "![Time of the whole solution against error](solve_time.png)"
    return page("Whole solve time", intro, machine(header), picture, table(columns, rows))


def seeds_page(path: Path) -> str:
    """Table of a ``seeds.json``: median and range of the errors of each size, by domain."""
    content = read_stored(path)
    with damage_told(path):
        return _seeds_page(content)


def _seeds_page(content: Mapping[str, Any]) -> str:
    sizes = content["sizes"]
    rows = [
        [name, domain, *(_spread(of[kind]) if kind in of else "" for kind in KINDS)]
        for name, domains in sizes.items()
        for domain, of in domains.items()
    ]
    columns = ["networks", "domain", *(f"{kind} [{unit}]" for kind, unit in KINDS.items())]
    intro = (
        f"RMS errors of scene `{content['scene']}` on samples that no network has seen, over all forces and over all "
        f"torques of a domain: median of {content['seeds']} random starts of the same training, lowest and highest in "
        f"parentheses. `python -m problems.studies.seeds {content['scene']}` measures this."
    )
    return page("Spread over training seeds", intro, machine(content["machine"]), table(columns, rows))


def _spread(errors: Sequence[float]) -> str:
    low, middle, high = (number(x) for x in (min(errors), median(errors), max(errors)))
    return f"{middle} ({low} to {high})"


def domains_page(path: Path) -> str:
    """Errors of each load by domain, and the walking table, of an ``evaluation.json``."""
    content = read_evaluation(path)
    loads = content["loads"]
    parts = [
        f"RMS errors of scene `{content['scene']}` on held-back samples, against the elastic foundation (EF) of "
        f"{content['teacher']} elements per side; the largest error stands in parentheses. "
        f"`casadi-contact evaluate {content['scene']} --preset PRESET` measures this of what `build` made with the "
        "same preset. The domains are explained in the "
        "[glossary](../glossary.md).",
        machine(content["machine"]),
    ]
    for model, domains in content["domain_errors"].items():
        rows = []
        for domain, errors in domains.items():
            cells = [_rms_and_largest(errors[load]) if load in errors else "" for load in loads]
            rows.append([domain, str(content["test_samples"][domain]), *cells])
        parts += [f"## {model}", table(["domain", "samples", *(f"{x} [{load_unit(x)}]" for x in loads)], rows)]
    if "walking" in content:
        parts += _walking(content["walking"])
    return page("Errors by domain", *parts)


def _rms_and_largest(error: Mapping[str, float]) -> str:
    return f"{number(error['rms'])} ({number(error['max'])})"


def _walking(walking: Mapping[str, Any]) -> list[str]:
    rows = []
    grids = ("converged", "fine")
    for model, row in walking["models"].items():
        cells = [number(row[grid][kind]) if kind in row[grid] else "" for grid in grids for kind in KINDS]
        rows.append([model, *cells])
    columns = [f"{kind} against EF {walking[grid]} [{unit}]" for grid in grids for kind, unit in KINDS.items()]
    return [
        f"## Unseen walking\n\nRMS errors over all forces and over all torques on {walking['poses']} poses; times are "
        "on the page of [kernel speed](kernel-speed.md).",
        table(["model", *columns], rows),
    ]


def kernel_speed_page(path: Path) -> str:
    """Times of graphs, kernels, a batch and the machine's limit of a ``kernel_speed.json``."""
    content = read_kernel_speed(path)
    parts = [
        "Time per pose of all loads on one core: a CasADi graph and the compiled C kernel in single buffered calls as "
        "an optimiser makes them, EF in one batch. The call alone is that of a compiled function that computes "
        "nothing, with the copy of the pose. Medians of repeats taken in turn; where other programs ran "
        "beside it, the lowest is the better guide. The Jacobian here is that of an expression in which the loads are "
        "called, as in IPOPT; charts time the kernel's own Jacobian function, which saves the call around it. "
        "`casadi-contact speed knee` measures this.",
        machine(content["machine"]),
    ]
    for structure, found in content["surrogates"].items():
        times = found["microseconds"]
        rows = []
        for what, timing in times.items():
            kernel = times.get(f"{what.partition(',')[0]}, kernel", times["value, kernel"])["low_us"]
            span = f"{number(timing['low_us'])} to {number(timing['high_us'])}"
            rows.append([what, number(timing["median_us"]), span, number(timing["low_us"] / kernel)])
        columns = ["what", "median [µs]", "lowest to highest [µs]", "lowest, in multiples of the kernel's"]
        limit = f"The machine's limit is {found['limit_us']:.2f} µs: {found['limit'].partition(': ')[2]}. "
        limit += f"The kernel takes {times_the_limit(found, 'low_us')}."
        parts += [f"## {structure}", table(columns, rows), limit]
    return page("Kernel speed", *parts)
