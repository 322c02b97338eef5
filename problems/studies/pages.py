"""Write the pages of results from result files: ``python -m problems.studies.pages``.

The folder of result files holds, as far as measured: speed_accuracy.csv (``python -m
problems.studies.shipped_front``), chart-SCENE.csv (``casadi-contact chart``), kernel_speed.json
(``casadi-contact speed``), solve_time.csv and stability.json (``python -m problems.studies.solve_time`` and
``.stability``), and summaries of the problems in pose_estimation/ and muscle_contact/. Every number of a page stands in
one of these files, or in the records of the shipped surrogates. paper.json holds the numbers of [EF15]; the page beside
them, ../paper.md, is written by hand but for its numbers, as the README is.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import typer

from casadi_contact.cli.tables import read_result
from casadi_contact.contact.elements.foundation import grid_text
from casadi_contact.core.files.writing import replacing, writable_folder
from casadi_contact.core.terminal import run_program
from casadi_contact.optimisation.knee import SIDES
from casadi_contact.pictures.charts import draw_charts
from casadi_contact.pictures.page import save_page
from casadi_contact.scenes.loading import load_scene, ready_scenes
from casadi_contact.surrogate.load import load_surrogate
from casadi_contact.workflow.benchmark.front_file import TIMES, Front, Point, read_front, shipped_front
from problems.studies import solve_time
from problems.studies.stability.methods import FAILURES, Line

BEGIN = "<!-- numbers: written by python -m problems.studies.pages -->"
END = "<!-- end of numbers -->"
_FRONT = "python -m problems.studies.shipped_front"
_PACKAGES = ("casadi_contact", "casadi", "numpy", "scipy", "numba", "torch")
_INTRO = (
    "This page is written from result files (`docs/results/data`) by a command, as are [charts](charts.md) of other "
    "joints and other methods, and the [stability](stability.md) of methods. Errors are reproducible. Times are not: "
    "machines differ. Compare times within one table only."
)
_CHARTS = (
    "A chart holds all models of a scene, measured in one run on one thread: elements (EF), the foundation, networks "
    "of several sizes, and peers, methods of others fitted to the same samples. Tables list the models that no "
    "other one beats in both time and error, and the most accurate one of every family. (D1): fitted to samples near "
    "the motion alone. Errors are RMS over forces and over torques on unseen poses of the scene's motion; times are "
    "medians per pose. Complete tables: `docs/results/data/chart-*.csv`."
)
_ROWS = {
    1: [
        "Starts 0.5 to 20 mm out of contact, or 0.5 to 5 mm too deep, settle under the loads the method has there. "
        "Root loads lead back into contact; loads that are clamped at zero (`two_stage`, peers) do not."
    ],
    2: ["A moment lifts one side off and lands it again: jumps of pose and derivatives."],
    3: ["Poses to three times the learned range: pulling, and contact where surfaces are 3 mm apart."],
    4: ["Central differences against the method's own Jacobian, and that against the true one."],
    5: ["The largest stable time step under growing load."],
    6: ["Curl of the force field (zero where contact conserves energy) and contact stiffness."],
}


def pages(data: Path) -> dict[str, str]:
    """Text of every page by file name, of the result files that are in the folder."""
    sections: list[str] = []
    for name, write in (
        ("speed_accuracy.csv", _shipped_section),
        ("kernel_speed.json", _kernel_speed_section),
        ("solve_time.csv", _solve_time_section),
    ):
        if (data / name).is_file():
            sections += write(data / name)
    for name, write_all in (("pose_estimation", _pose_section), ("muscle_contact", _muscle_section)):
        if summaries := sorted((data / name).glob("*.json")):
            sections += write_all([_read(path) for path in summaries])
    found = {"results.md": _page("Results", _INTRO, *sections)} if sections else {}
    if charts := sorted(data.glob("chart-*.csv")):
        found["charts.md"] = _page("Charts", _CHARTS, *(part for path in charts for part in _chart_section(path)))
    if studies := sorted(data.glob("stability*.json")):
        parts = [part for path in studies for part in _stability_section(_read(path))]
        found["stability.md"] = _page("Stability of methods", *parts)
    if (page := data.parent / "paper.md").is_file():
        found["paper.md"] = _with_numbers(page, _paper_numbers(data))
    return found


def headline(data: Path) -> str:
    """Numbers of the knee for the README, with the command that measured each, and the machine."""
    speed = read_result(data / "kernel_speed.json", "kernel speed")
    times = {k: v["low_us"] for k, v in speed["surrogates"]["patch"]["microseconds"].items()}
    solutions = read_front(data / "solve_time.csv").models
    whole = {point.name: 1e-3 * point.value.median_us for point in solutions if point.value is not None}
    kernel = ", ".join(_number(times[f"{what}, kernel"]) for what in ("value", "Jacobian", "Hessian"))
    scene = load_scene("knee")
    shipped = shipped_front(scene)
    if shipped is None:
        raise ValueError(f"no front of knee is shipped: run {_FRONT} first")
    front, grid = shipped[1], f"EF {grid_text(scene.grids['fine'])}"
    (knee,) = (point for point in front.models if point.name == "knee")
    quickest = min((name for name in whole if name.startswith("foundation")), key=lambda name: whole[name])
    rows = [
        [
            f"whole pose estimation of a walking cycle, a frame: {quickest}; `knee`; {grid}",
            "; ".join(_number(whole[name]) for name in (quickest, "knee", grid)) + " ms",
            "`python -m problems.studies.solve_time`",
        ],
        [
            f"RMS error of `knee` on {front.header['walking_poses']} unseen poses of walking",
            f"{_number(knee.force_rms_n)} N, {_number(knee.torque_rms_nmm)} N·mm",
            f"`{_FRONT}`",
        ],
        [
            "time per pose of loads, Jacobian, Hessian of `knee`, compiled (lowest of 15)",
            f"{kernel} µs",
            "`casadi-contact speed knee`",
        ],
        _fastest_untrained(front, knee),
        [
            f"time per pose of {grid} (elastic foundation, that many elements a side), divided by that of `knee`",
            _number(times[grid] / times["value, kernel"]),
            "`casadi-contact speed knee`",
        ],
    ]
    numbers = _table(["what", "measured", "command"], rows, texts=["command"])
    return f"{numbers}\n\n{_machine(speed['machine'])}"


def _fastest_untrained(front: Front, knee: Point) -> list[str]:
    """The fastest model without training that is as accurate as the surrogate: what it must be compared with."""
    times = {point.name: point.value.median_us for point in front.models if point.value is not None}
    as_accurate = [
        p
        for p in front.models
        if p.name in times
        and not p.samples
        and p.force_rms_n <= knee.force_rms_n
        and p.torque_rms_nmm <= knee.torque_rms_nmm
    ]
    best = min(as_accurate, key=lambda point: times[point.name])
    which = best.name.replace("foundation", "the foundation with")
    what = (
        f"time per pose of the fastest model without training that is as accurate ({which}, RMS "
        f"{_number(best.force_rms_n)} N), divided by that of `knee`"
    )
    return [what, _number(times[best.name] / times[knee.name]), f"`{_FRONT}`"]


def _with_numbers(page: Path, numbers: str) -> str:
    """The text of a page with the numbers between its two marks; ValueError without them."""
    before, begin, rest = page.read_text("utf-8").partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise ValueError(f"{page} has no lines {BEGIN!r} and {END!r}, expected both")
    return f"{before}{begin}\n\n{numbers}\n\n{end}{after}"


def _paper_numbers(data: Path) -> str:
    """Tables 4, 2 and 3 of [EF15] beside ours: walking, then RMS and largest errors of held-back samples."""
    paper, front = _read(data / "paper.json"), read_front(data / "speed_accuracy.csv")
    names, models = ("knee_two_stage", "knee"), {point.name: point for point in front.models}
    heads, rows = ["paper", *(f"`{name}`" for name in names)], []
    for k, (what, unit) in enumerate((("time", "µs"), ("force error", "N"), ("torque error", "N·mm"))):
        values = {model: [theirs.get(unit)] for model, theirs in paper["walking"].items()}
        for model, cells in values.items():
            for point in (models[name if model == "surrogate" else model] for name in names):
                time = None if point.value is None else point.value.median_us
                cells.append((time, point.force_rms_n, point.torque_rms_nmm)[k])
            rows.append([f"{what} of {model} [{unit}]", *("-" if x is None else _number(x) for x in cells)])
        *grids, surrogate = values
        for grid in grids:
            ratios = (ef and ef / own for ef, own in zip(values[grid], values[surrogate], strict=True))
            rows.append([f"{what}, {grid} / surrogate", *("-" if x is None else _number(x) for x in ratios)])
    parts = ["## Table 4: walking", _machine(front.header), _table(["", *heads], rows)]
    records = [paper["test_errors"], *(load_surrogate(name).record["test_errors"] for name in names)]
    for error, title in (("rms", "Table 2: RMS errors"), ("max", "Table 3: largest errors")):
        loads = list(records[0]["D1"])
        rows = [
            [domain, *("/".join(_number(record[domain][load][error]) for record in records) for load in loads)]
            for domain in records[0]
        ]
        parts += [f"## {title} [N, N·mm]", f"Each cell: {' / '.join(heads)}.", _table(["domain", *loads], rows)]
    return "\n\n".join(parts)


def _shipped_section(path: Path) -> list[str]:
    front = read_front(path)
    header = front.header
    intro = (
        f"All models of the scene `{header['scene']}` without training, and the shipped surrogates: RMS errors on "
        f"{header['walking_poses']} poses of walking that no model has seen, against {header['reference']}; medians of "
        f"the time per pose on {header['threads']} thread, compiled kernels. EF n×m is the elastic foundation on n×m "
        f"elements a side. Command: `{_FRONT}`."
    )
    points = [point for point in front.models if "CasADi MX" not in point.name]
    picture = f"![Time per pose against error on unseen poses]({path.stem}.png)"
    return ["## Speed and accuracy of the knee", intro, _machine(header), picture, _front_table(points)]


def _chart_section(path: Path) -> list[str]:
    front = read_front(path)
    header = front.header
    scene = header["scene"]
    given = scene if scene in ready_scenes() else f"problems/scenes/{scene}.toml"
    peers = any(point.family == "polynomial" for point in front.points)
    program = "python -m problems.studies.peers" if peers else "casadi-contact chart"
    command = f"{program} {given} --preset {header['preset']}"
    intro = (
        f"{len(front.models)} models, {header['walking_poses']} unseen poses, against {header['reference']}, on "
        f"{header['processor']} ({header.get('instruction_set', 'instruction set not recorded')}): `{command}`."
    )
    picture = f"![Time per pose against error: {scene}]({path.stem}.png)"
    return [f"## {scene}", intro, picture, _front_table(_best(front.models))]


def _best(points: Sequence[Point]) -> list[Point]:
    """Models that no other one beats in both time and force error, and of every family the most accurate one."""
    timed = [point for point in points if point.value is not None and "CasADi MX" not in point.name]
    accurate: dict[str, Point] = {}
    for point in timed:
        best = accurate.setdefault(point.family, point)
        accurate[point.family] = min(best, point, key=lambda p: p.force_rms_n)

    def us(point: Point) -> float:
        return math.inf if point.value is None else point.value.median_us

    def beaten(point: Point) -> bool:
        return any(us(other) < us(point) and other.force_rms_n <= point.force_rms_n for other in timed)

    return [point for point in timed if point in accurate.values() or not beaten(point)]


def _front_table(points: Sequence[Point]) -> str:
    rows = []
    for point in points:
        timings = [getattr(point, what) for what in TIMES[:3]]
        times = ["" if timing is None else _number(timing.median_us) for timing in timings]
        trained = [str(point.samples), _number(point.training_seconds)] if point.samples else ["", ""]
        rows.append([point.name, *times, _number(point.force_rms_n), _number(point.torque_rms_nmm), *trained])
    columns = ["value [µs]", "Jacobian [µs]", "Hessian [µs]", "force [N]", "torque [N·mm]", "samples", "training [s]"]
    return _table(["model", *columns], rows)


def _solve_time_section(path: Path) -> list[str]:
    front = read_front(path)
    header, rows = front.header, []
    for point in front.points:
        if point.value is None:
            rows.append([point.name, "", "", "", point.failure])
            continue
        errors = [_number(point.force_rms_n), _number(point.torque_rms_nmm)]
        rows.append([point.name, _number(1e-3 * point.value.median_us), *errors, point.remark])
    intro = (
        f"Pose estimation of the cycle `{header['cycle']}` by every contact model of the scene `{header['scene']}`, "
        "solved whole, start and settling included, several times in turn in one run on one thread: medians. RMS "
        f"errors are of the loads at the poses found, against {header['reference']}. `python -m "
        f"problems.studies.solve_time {header['scene']}` measures this."
    )
    columns = ["model", "time a frame [ms]", "force [N]", "torque [N·mm]", "remark"]
    picture = "![Time of the whole solution against error](solve_time.png)"
    return ["## Time of a whole solution", intro, _machine(header), picture, _table(columns, rows)]


def _kernel_speed_section(path: Path) -> list[str]:
    content = read_result(path, "kernel speed")
    parts = [
        "## Kernel speed",
        "Time per pose of all loads on one core: the CasADi graph and the compiled C kernel in single buffered calls, "
        "as an optimiser makes them. *Call alone* is a compiled function that computes nothing. Command: "
        "`casadi-contact speed knee`.",
        _machine(content["machine"]),
    ]
    for structure, found in content["surrogates"].items():
        times, rows = found["microseconds"], []
        for what, timing in times.items():
            kernel = times.get(f"{what.partition(',')[0]}, kernel", times["value, kernel"])["low_us"]
            rows.append([what, _number(timing["median_us"]), _number(timing["low_us"] / kernel)])
        columns = ["what", "median [µs]", "lowest, in multiples of the kernel's"]
        parts += [f"### {structure}", _table(columns, rows)]
    return parts


def _pose_section(summaries: Sequence[Mapping[str, Any]]) -> list[str]:
    first, rows = summaries[0], []
    for summary in summaries:
        row = [summary["cycle"], f"{summary['solved']} of {summary['frames']}", str(summary["ipopt_iterations"])]
        rows.append([*row, f"{summary['seconds']:.2f}", _of_sides(summary["elements_off"])])
    columns = [
        *("cycle", "frames solved", "IPOPT iterations", "time [s]"),
        f"{first['elements']} − foundation, medial, lateral [N]",
    ]
    intro = (
        f"All frames of a cycle in one IPOPT problem on the foundation of `{first['scene']}`, with "
        "[`python -m problems.pose_estimation`](../problems.md#pose-estimation). Forces "
        "are re-evaluated on the elastic foundation (EF) at the solved poses: RMS (largest). Cycles og1_loads to "
        "og4_loads are the measured ones that the built-in walking derives from; they are not part of the repository."
    )
    return ["## Pose estimation", intro, _machine(first["machine"]), _table(columns, rows)]


def _muscle_section(summaries: Sequence[Mapping[str, Any]]) -> list[str]:
    first, rows = summaries[0], []
    for summary in summaries:
        off = summary["predicted_minus_measured"]
        measured = [f"{_number(off[s]['rms'])} ({off[s]['mean']:+.0f})" for s in SIDES]
        row = [summary["walk"], f"{summary['solved']} of {summary['frames']}", str(summary["ipopt_iterations"])]
        rows.append([*row, f"{summary['seconds']:.2f}", *measured, _of_sides(summary["elements_off"])])
    columns = [
        *("cycle", "frames solved", "IPOPT iterations", "time [s]"),
        *("medial RMS error (mean) [N]", "lateral RMS error (mean) [N]"),
        f"{first['elements']} − foundation, medial, lateral [N]",
    ]
    intro = (
        "Contact forces predicted by [`python -m problems.muscle_contact`](../problems.md#muscle-and-contact-forces) "
        "against those that the instrumented implant measured. These enter the prediction nowhere. The last column is "
        "the elastic foundation (EF) at the solved poses: RMS (largest)."
    )
    return ["## Muscle and contact forces", intro, _machine(first["machine"]), _table(columns, rows)]


def _of_sides(off: Mapping[str, Any]) -> str:
    """RMS and largest difference of both sides."""
    return ", ".join(f"{off[side][0]:.2f} ({off[side][1]:.1f})" for side in SIDES)


def _stability_section(content: Mapping[str, Any]) -> list[str]:
    scene, lines = content["settings"]["scene"], [Line(**line) for line in content["lines"]]
    methods = list(dict.fromkeys(method for line in lines for method in line.values))
    quick = " --quick" if content["settings"].get("quick") == "yes" else ""
    parts = [
        "Each method is tried on the same hard cases: shipped surrogates, the foundation, elements (EF) with Jacobians "
        "by differences and with the analytic one, and three peers that are fitted to 400 poses of the motion. A dash: "
        f"the quantity makes no sense for the method. Command: `python -m problems.studies.stability {scene}{quick}`.",
        _machine(content["machine"]),
    ]
    for row in sorted({line.row for line in lines}):
        mine = [line for line in lines if line.row == row]
        cells = [[f"{x.case}: {x.quantity}", *(x.cell(method).replace(" / ", "/") for method in methods)] for x in mine]
        parts += [f"## {row}. {FAILURES[row]}", *_ROWS.get(row, ()), _table(["case: quantity", *methods], cells)]
    return parts


def _read(path: Path) -> dict[str, Any]:
    return dict(json.loads(path.read_text("utf-8")))


def _page(title: str, *parts: str) -> str:
    """A page that says below its title that it is not to be edited: sites take a page's name from its first line."""
    return "\n\n".join((f"# {title}", "<!-- written by python -m problems.studies.pages -->", *parts)) + "\n"


def _table(columns: Sequence[str], rows: Sequence[Sequence[str]], *, texts: Sequence[str] = ()) -> str:
    """A table; all columns but the first, and those named texts, hold numbers and are aligned right."""
    marks = ("---" if column in (columns[0], *texts) else "---:" for column in columns)
    head = [" | ".join(columns), " | ".join(marks)]
    return "\n".join(f"| {line} |" for line in (*head, *(" | ".join(row) for row in rows)))


def _machine(record: Mapping[str, Any]) -> str:
    """Processor, instruction set, system and versions, as a sentence."""
    instructions = record.get("instruction_set", "instruction set not recorded")
    flags = f", kernels compiled with `{record['kernel_flags']}`" if "kernel_flags" in record else ""
    versions = ", ".join(f"{name} {record[name]}" for name in _PACKAGES if name in record)
    return (
        f"Measured on: {record['processor']} ({instructions}{flags}), {record['cores']} cores, {record['system']}; "
        f"Python {record['python']}, {versions}."
    )


def _number(value: float) -> str:
    """Three digits, without an exponent where that is short."""
    return f"{value:.0f}" if 100.0 <= abs(value) < 1e6 else f"{value:.3g}"


def run(
    data: Annotated[Path, typer.Argument(help="folder of result files")] = Path("docs/results/data"),
    out: Annotated[Path, typer.Option(help="folder of the pages")] = Path("docs/results"),
    readme: Annotated[Path | None, typer.Option(help="put the headline numbers into this README too")] = None,
) -> None:
    """Write the pages of results; no number of theirs is typed by hand."""
    writable_folder(out)
    found = pages(data)
    if not found:
        raise ValueError(f"no result file in {data}, expected speed_accuracy.csv or others")
    for name, text in found.items():
        with replacing(out / name) as beside:
            beside.write_text(text, "utf-8")
    for path in (*data.glob("speed_accuracy.csv"), *sorted(data.glob("chart-*.csv"))):
        with TemporaryDirectory() as folder:
            for drawn in draw_charts(read_front(path), Path(folder)):
                if drawn.name == "speed_accuracy.png":
                    with replacing(out / f"{path.stem}.png") as beside:
                        beside.write_bytes(drawn.read_bytes())
    if (data / "solve_time.csv").is_file():
        save_page(solve_time.draw(read_front(data / "solve_time.csv")), out / f"{solve_time.NAME}.png")
    if readme is not None:
        written = _with_numbers(readme, headline(data))
        with replacing(readme) as beside:
            beside.write_text(written, "utf-8")
    print(f"written {len(found)} pages to {out}")


if __name__ == "__main__":
    run_program(run)
