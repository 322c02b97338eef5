"""Write the pages of results from result files: ``python -m problems.studies.pages``.

The folder of result files holds, as far as measured: speed_accuracy.csv (``python -m
casadi_contact.workflow.benchmark.shipped knee``), chart-SCENE.csv (``casadi-contact chart``), kernel_speed.json
(``casadi-contact speed``), solve_time.csv and stability.json (``python -m problems.studies.solve_time`` and
``.stability``), and summaries of the problems in pose_estimation/ and muscle_contact/. Every number of a page stands in
one of these files.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import typer

from casadi_contact.contact.elements.foundation import grid_text
from casadi_contact.core.files.writing import replacing, writable_folder
from casadi_contact.core.terminal import run_program
from casadi_contact.optimisation.knee import SIDES
from casadi_contact.pictures.page import save_page
from casadi_contact.pictures.report.charts import draw_charts, family_name
from casadi_contact.pictures.report.tables import read_kernel_speed, times_the_limit
from casadi_contact.scenes.loading import load_scene, ready_scenes
from casadi_contact.workflow.benchmark.front_file import TIMES, Front, Point, read_front
from casadi_contact.workflow.benchmark.shipped import shipped_front
from problems.studies import solve_time
from problems.studies.stability.methods import FAILURES, Line

BEGIN = "<!-- numbers: written by python -m problems.studies.pages -->"
END = "<!-- end of numbers -->"
_FRONT = "python -m casadi_contact.workflow.benchmark.shipped knee"
_PACKAGES = ("casadi_contact", "casadi", "numpy", "scipy", "numba", "torch")
_OWN_NUMBERS = re.compile(r"\d\.\d|\bof \d")  # in remarks that hold for a single model
_CHARTS = {
    "speed_accuracy": "Time per pose against error on unseen poses",
    "gradient_hessian_time": "Time of Jacobian and Hessian against error",
}


def pages(data: Path) -> dict[str, str]:
    """Text of every page by file name, of the result files that are in the folder."""
    found: dict[str, str] = {}
    for path, (name, title) in _fronts(data).items():
        found[f"{name}.md"] = _front_page(path, title)
    for name, write in (("solve_time.csv", _solve_time_page), ("kernel_speed.json", _kernel_speed_page)):
        if (data / name).is_file():
            found[f"{(data / name).stem.replace('_', '-')}.md"] = write(data / name)
    for name, write_all in (("pose_estimation", _pose_page), ("muscle_contact", _muscle_page)):
        if summaries := sorted((data / name).glob("*.json")):
            found[f"{name.replace('_', '-')}.md"] = write_all([_read(path) for path in summaries])
    return found | {f"{path.stem}.md": _stability_page(_read(path)) for path in sorted(data.glob("stability*.json"))}


def headline(data: Path) -> str:
    """Five numbers of the knee for the README, with the command that measured each, and the machine."""
    speed = read_kernel_speed(data / "kernel_speed.json")
    times = {k: v["low_us"] for k, v in speed["surrogates"]["patch"]["microseconds"].items()}
    poses = _read(data / "pose_estimation" / "reference.json")
    kernel = ", ".join(_number(times[f"{what}, kernel"]) for what in ("value", "Jacobian", "Hessian"))
    solved = f"{poses['solved']} of {poses['frames']} frames, {poses['ipopt_iterations']} iterations"
    scene = load_scene("knee")
    shipped = shipped_front(scene)
    if shipped is None:
        raise ValueError(f"no front of knee is shipped: run {_FRONT} first")
    front, grid = shipped[1], f"EF {grid_text(scene.grids['fine'])}"
    (knee,) = (point for point in front.models if point.name == "knee")
    rows = [
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
        ["poses of a walking cycle in one IPOPT problem", solved, "`python -m problems.pose_estimation`"],
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


def write_headline(readme: Path, text: str) -> None:
    """Put the numbers between the two marks of the README; ValueError without them."""
    before, begin, rest = readme.read_text("utf-8").partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise ValueError(f"{readme} has no lines {BEGIN!r} and {END!r}, expected both")
    with replacing(readme) as beside:
        beside.write_text(f"{before}{begin}\n\n{text}\n\n{end}{after}", "utf-8")


def _fronts(data: Path) -> dict[Path, tuple[str, str]]:
    """Measured fronts of the folder, with the name and the title of their page."""
    shipped = dict.fromkeys(data.glob("speed_accuracy.csv"), ("speed-accuracy", "Speed and accuracy"))
    charts = sorted(data.glob("chart-*.csv"))
    return shipped | {path: (path.stem, f"Speed and accuracy: {path.stem.partition('-')[2]}") for path in charts}


def _front_page(path: Path, title: str) -> str:
    front = read_front(path)
    header = front.header
    command = f"python -m casadi_contact.workflow.benchmark.shipped {header['scene']}"
    if "preset" in header:
        ready = header["scene"] in ready_scenes()
        given = header["scene"] if ready else f"problems/scenes/{header['scene']}.toml"
        command = f"casadi-contact chart {given} --preset {header['preset']}"
        command += " --peers" if any(point.family == "polynomial" for point in front.points) else ""
    intro = (
        f"Every model of the scene `{header['scene']}` in one run on {header['threads']} thread: RMS errors on "
        f"{header['walking_poses']} poses of its motion that no model has seen, against {header['reference']}; medians "
        f"of the time per pose. `{command}` measures this table."
    )
    pictures = [f"![{text}]({path.stem}/{name}.png)" for name, text in _CHARTS.items()]
    rows = []
    for point in front.models:
        timings = [getattr(point, what) for what in TIMES[:3]]
        times = ["" if timing is None else _number(timing.median_us) for timing in timings]
        trained = [str(point.samples), _number(point.training_seconds)] if point.samples else ["", ""]
        rows.append([point.name, *times, _number(point.force_rms_n), _number(point.torque_rms_nmm), *trained])
    columns = ["value [µs]", "Jacobian [µs]", "Hessian [µs]", "force [N]", "torque [N·mm]", "samples", "training [s]"]
    parts = [intro, _machine(header), *pictures, "## All models", _table(["model", *columns], rows)]
    if remarks := _remarks(front.models):
        parts.append(f"How the models of each family were evaluated, and what they are made of:\n\n{remarks}")
    if failed := [f"- {p.name}: {p.failure}" for p in front.points if p.failure]:
        parts += ["## Not measured", "\n".join(failed)]
    return _page(title, *parts)


def _remarks(points: Sequence[Point]) -> str:
    """A line for each family with the remarks on its models, without numbers of single models."""
    remarks: dict[str, dict[str, None]] = {}
    for point in points:
        general = [r for r in map(str.strip, point.remark.split(";")) if r and not _OWN_NUMBERS.search(r)]
        remarks.setdefault(family_name(point.family), {}).update(dict.fromkeys(general))
    return "\n".join(f"- {family}: {'; '.join(texts)}" for family, texts in remarks.items() if texts)


def _solve_time_page(path: Path) -> str:
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
    return _page("Whole solve time", intro, _machine(header), picture, _table(columns, rows))


def _kernel_speed_page(path: Path) -> str:
    content = read_kernel_speed(path)
    parts = [
        "Time per pose of all loads on one core: a CasADi graph and the compiled C kernel in single buffered calls as "
        "an optimiser makes them, EF in one batch. The call alone is that of a compiled function that computes "
        "nothing, with the copy of the pose. Medians of repeats taken in turn; where other programs ran "
        "beside it, the lowest is the better guide. The Jacobian here is that of an expression in which the loads are "
        "called, as in IPOPT; charts time the kernel's own Jacobian function, which saves the call around it. "
        "`casadi-contact speed knee` measures this.",
        _machine(content["machine"]),
    ]
    for structure, found in content["surrogates"].items():
        times, rows = found["microseconds"], []
        for what, timing in times.items():
            kernel = times.get(f"{what.partition(',')[0]}, kernel", times["value, kernel"])["low_us"]
            span = f"{_number(timing['low_us'])} to {_number(timing['high_us'])}"
            rows.append([what, _number(timing["median_us"]), span, _number(timing["low_us"] / kernel)])
        columns = ["what", "median [µs]", "lowest to highest [µs]", "lowest, in multiples of the kernel's"]
        limit = f"The machine's limit is {found['limit_us']:.2f} µs: {found['limit'].partition(': ')[2]}. "
        limit += f"The kernel takes {times_the_limit(found, 'low_us')}."
        parts += [f"## {structure}", _table(columns, rows), limit]
    return _page("Kernel speed", *parts)


def _pose_page(summaries: Sequence[Mapping[str, Any]]) -> str:
    first, rows = summaries[0], []
    for summary in summaries:
        row = [summary["cycle"], f"{summary['solved']} of {summary['frames']}", str(summary["ipopt_iterations"])]
        rows.append([*row, f"{summary['seconds']:.2f}", _of_sides(summary["elements_off"])])
    columns = [
        *("cycle", "frames solved", "IPOPT iterations", "time [s]"),
        f"{first['elements']} − surrogate, medial, lateral [N]",
    ]
    intro = (
        f"All frames of a cycle in one IPOPT problem on the surrogate `{first['scene']}`, with "
        "[`python -m problems.pose_estimation`](../problems/pose-estimation.md). Forces "
        "are re-evaluated on the elastic foundation (EF) at the solved poses: RMS (largest). Cycles og1_loads to "
        "og4_loads are the measured ones that the built-in walking derives from; they are not part of the repository."
    )
    return _page("Pose estimation", intro, _machine(first["machine"]), _table(columns, rows))


def _muscle_page(summaries: Sequence[Mapping[str, Any]]) -> str:
    first, rows = summaries[0], []
    for summary in summaries:
        off = summary["predicted_minus_measured"]
        measured = [f"{_number(off[s]['rms'])} ({off[s]['mean']:+.0f})" for s in SIDES]
        row = [summary["walk"], f"{summary['solved']} of {summary['frames']}", str(summary["ipopt_iterations"])]
        rows.append([*row, f"{summary['seconds']:.2f}", *measured, _of_sides(summary["elements_off"])])
    columns = [
        *("cycle", "frames solved", "IPOPT iterations", "time [s]"),
        *("medial RMS error (mean) [N]", "lateral RMS error (mean) [N]"),
        f"{first['elements']} − surrogate, medial, lateral [N]",
    ]
    intro = (
        "Contact forces predicted by [`python -m problems.muscle_contact`](../problems/muscle-contact.md) against "
        "those that the instrumented implant measured, which enter the prediction nowhere. The last column is the "
        "elastic foundation (EF) at the solved poses: RMS (largest)."
    )
    return _page("Muscle and contact forces", intro, _machine(first["machine"]), _table(columns, rows))


def _of_sides(off: Mapping[str, Any]) -> str:
    """RMS and largest difference of both sides."""
    return ", ".join(f"{off[side][0]:.2f} ({off[side][1]:.1f})" for side in SIDES)


def _stability_page(content: Mapping[str, Any]) -> str:
    scene, lines = content["settings"]["scene"], [Line(**line) for line in content["lines"]]
    methods = list(dict.fromkeys(method for line in lines for method in line.values))
    settings = "; ".join(f"{name.replace('_', ' ')}: {value}" for name, value in content["settings"].items())
    parts = [
        "Every method is tried on the same hard cases by `python -m problems.studies.stability`; the page of that "
        "[study](../problems/stability.md) says what each row does. A dash says that the quantity makes no sense for "
        "the method.",
        f"Settings of this run: {settings}.",
        _machine(content["machine"]),
    ]
    for row in sorted({line.row for line in lines}):
        mine = [line for line in lines if line.row == row]
        cells = [[f"{x.case}: {x.quantity}", *(x.cell(method) for method in methods)] for x in mine]
        parts += [f"## {row}. {FAILURES[row]}", _table(["case: quantity", *methods], cells)]
    return _page(
        "Stability where methods fail" if scene == "knee" else f"Stability where methods fail: {scene}", *parts
    )


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
    for path in _fronts(data):
        writable_folder(out / path.stem)
        with TemporaryDirectory() as folder:
            for drawn in draw_charts(read_front(path), Path(folder)):
                if drawn.suffix == ".png":
                    with replacing(out / path.stem / drawn.name) as beside:
                        beside.write_bytes(drawn.read_bytes())
    if (data / "solve_time.csv").is_file():
        save_page(solve_time.draw(read_front(data / "solve_time.csv")), out / f"{solve_time.NAME}.png")
    if readme is not None:
        write_headline(readme, headline(data))
    print(f"written {len(found)} pages to {out}")


if __name__ == "__main__":
    run_program(run)
