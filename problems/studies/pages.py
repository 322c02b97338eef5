"""Write the pages of results from result files: ``python -m problems.studies.pages``.

The folder of result files holds, as far as measured: speed_accuracy.csv of the knee (``casadi-contact speed``),
chart-SCENE.csv (``python -m problems.studies.peers`` or ``casadi-contact speed``), what other studies write, and
summaries of the problems in pose_estimation/ and muscle_contact/. Every number of a page stands in one of these files,
or in the records of the shipped surrogates. paper.json holds the numbers of [EF15]; the page beside them, ../paper.md,
is written by hand but for its numbers, as the README is.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from casadi_contact.core.files.writing import replacing, writable_folder
from casadi_contact.core.terminal import run_program
from casadi_contact.optimisation.knee import SIDES
from casadi_contact.pictures.charts import draw_speed_accuracy
from casadi_contact.pictures.page import save_page
from casadi_contact.scenes.loading import ready_scenes
from casadi_contact.workflow.benchmark.front_file import TIMES, Point, read_front
from problems.studies import solve_time
from problems.studies.numbers import (
    FRONT,
    headline,
    machine,
    number,
    page_text,
    paper_numbers,
    read,
    table,
    with_numbers,
)
from problems.studies.stability import FAILURES, Line

_INTRO = (
    "Written from result files (`docs/results/data`) by a command, as are [charts](charts.md) of other joints and the "
    "[stability](stability.md) of methods. Errors are reproducible. Compare times within one table only."
)
_CHARTS = (
    "A chart holds all models of a scene, measured in one run on one thread: elements (EF), the foundation, networks "
    "of several sizes, and peers, methods of others fitted to the same samples, or (D1) to those near the motion. "
    "Tables list the models that no other one beats in both time and error, and the most accurate one of every family. "
    "Errors are RMS on unseen poses of the scene's motion, times medians of the CPU time per pose. Complete tables: "
    "`docs/results/data/chart-*.csv`."
)
_PER_STEP = "IPOPT, a frame and iteration [µs]"
_ROWS = {
    1: [
        "Starts 0.5 to 20 mm out of contact, or 0.5 to 5 mm too deep, settle under the loads the method has there. "
        "Root loads lead back into contact, a surrogate's as far as its networks have learned; loads that are clamped "
        "at zero (`two_stage`, peers) do not."
    ],
    2: ["The first pose is raised until its lateral side carries nothing: load and derivatives on both sides of that."],
    3: ["Poses to three times the learned range: pulling, and contact where surfaces are 3 mm apart."],
}


def pages(data: Path) -> dict[str, str]:
    """Text of every page by file name, of the result files that are in the folder."""
    sections: list[str] = []
    written = {"speed_accuracy.csv": _shipped_section, "casadi_forms.json": _forms_section}
    written |= {"solve_time.csv": _solve_time_section, "optimisers.json": _optimisers_section}
    for name, write in written.items():
        if (data / name).is_file():
            sections += write(data / name)
    for name, write_all in (("pose_estimation", _pose_section), ("muscle_contact", _muscle_section)):
        if summaries := sorted((data / name).glob("*.json")):
            sections += write_all([read(path) for path in summaries])
    found = {"results.md": page_text("Results", _INTRO, *sections)} if sections else {}
    if charts := sorted(data.glob("chart-*.csv")):
        found["charts.md"] = page_text("Charts", _CHARTS, *(part for path in charts for part in _chart_section(path)))
    if studies := sorted(data.glob("stability*.json")):
        parts = [part for path in studies for part in _stability_section(read(path))]
        found["stability.md"] = page_text("Stability of methods", *parts)
    if (page := data.parent / "paper.md").is_file():
        found["paper.md"] = with_numbers(page, paper_numbers(data))
    return found


def _shipped_section(path: Path) -> list[str]:
    front = read_front(path)
    header = front.header
    intro = (
        f"All models of the scene `{header['scene']}` without training, and the shipped surrogates: RMS errors on "
        f"{header['walking_poses']} unseen poses of walking, against {header['reference']}; medians of the time per "
        f"pose on {header['threads']} thread. EF n×m: elastic foundation on n×m elements a side. Command: `{FRONT}`."
    )
    picture = f"![Time per pose against error on unseen poses]({path.stem}.png)"
    return ["## Speed and accuracy of the knee", intro, machine(header), picture, _front_table(front.models)]


def _chart_section(path: Path) -> list[str]:
    front = read_front(path)
    header = front.header
    scene = header["scene"]
    given = scene if scene in ready_scenes() else f"problems/scenes/{scene}.toml"
    names = "; ".join(point.name for point in front.points)
    measured = "casadi-contact chart" if "; patch " in names else "casadi-contact speed"
    program = "python -m problems.studies.peers" if "polynomial" in names else measured
    command = f"{program} {given} --preset {header['preset']}"
    intro = (
        f"{len(front.models)} models, {header['walking_poses']} unseen poses, against {header['reference']}, on "
        f"{header['processor']} ({header['instruction_set']}): `{command}`."
    )
    picture = f"![Time per pose against error: {scene}]({path.stem}.png)"
    return [f"## {scene}", intro, picture, _front_table(_best(front.models))]


def _best(points: Sequence[Point]) -> list[Point]:
    """Models that no other one beats in both time and force error, and of every family the most accurate one."""
    timed = [(p.value.median_us, p) for p in points if p.value is not None and "CasADi MX" not in p.name]
    accurate = {p.family: p for _, p in sorted(timed, key=lambda each: (-each[1].force_rms_n, -each[0]))}
    return [
        point
        for us, point in timed
        if point is accurate[point.family]
        or not any(less < us and other.force_rms_n <= point.force_rms_n for less, other in timed)
    ]


def _front_table(points: Sequence[Point]) -> str:
    rows = []
    for point in points:
        timings = [getattr(point, what) for what in TIMES[:3]]
        times = ["" if timing is None else number(timing.median_us) for timing in timings]
        trained = [str(point.samples), number(point.training_seconds)] if point.samples else ["", ""]
        rows.append([point.name, *times, number(point.force_rms_n), number(point.torque_rms_nmm), *trained])
    columns = ["value [µs]", "Jacobian [µs]", "Hessian [µs]", "force [N]", "torque [N·mm]", "samples", "training [s]"]
    return table(["model", *columns], rows)


def _forms_section(path: Path) -> list[str]:
    content = read(path)
    parts = [
        "## What a CasADi user would write instead",
        "The networks of our compiled kernel as C that CasADi generates (same compiler and flags), as its graph in MX "
        "and in SX, and through Python by PyTorch in double precision. All are exact, so that IPOPT takes the same "
        "steps. Times: lowest of 7 of a call with one pose; IPOPT's pose estimation of the built-in walk from the same "
        "settled start, compiled before. Command: `python -m problems.studies.casadi_forms`.",
        machine(content["machine"]),
    ]
    columns = [*("form", "value [µs]", "Jacobian [µs]", "Hessian [µs]", "frames solved", "iterations"), _PER_STEP]
    for name, forms in content["surrogates"].items():
        rows = []
        for form, found in forms.items():
            if reason := found.get("missing"):
                rows.append([f"{form}: {reason}", *[""] * 6])
                continue
            times = [number(found[f"{what}_us"]) for what in ("value", "Jacobian", "Hessian")]
            solved = f"{found['solved']} of {found['frames']}"
            step = number(1e6 * found["seconds"] / found["frames"] / max(1, found["iterations"]))
            rows.append([form, *times, solved, str(found["iterations"]), step])
        parts += [f"### {name} in other forms", table(columns, rows)]
    return parts


def _solve_time_section(path: Path) -> list[str]:
    front = read_front(path)
    header, rows = front.header, []
    for point in front.points:
        if point.value is None:
            rows.append([point.name, "", "", "", point.failure])
            continue
        errors = [number(point.force_rms_n), number(point.torque_rms_nmm)]
        rows.append([point.name, number(1e-3 * point.value.median_us), *errors, point.remark])
    intro = (
        f"Pose estimation of the cycle `{header['cycle']}` by every contact model of the scene `{header['scene']}`, "
        "start and settling included: medians on one thread. RMS errors are of the loads at the poses found, against "
        f"{header['reference']}. Command: `python -m problems.studies.solve_time {header['scene']}`."
    )
    columns = ["model", "time a frame [ms]", "force [N]", "torque [N·mm]", "remark"]
    picture = "![Time of the whole solution against error](solve_time.png)"
    return ["## Time of a whole solution", intro, machine(header), picture, table(columns, rows)]


def _optimisers_section(path: Path) -> list[str]:
    found = read(path)
    intro = (
        f"The root load of the knee's medial side, {found['rows']} samples in contact, a network of "
        f"{found['network']}, the same start, {number(found['cpu_s'])} CPU seconds on one thread for each method: RMS "
        "errors. Command: `python -m problems.studies.optimisers samples.h5`."
    )
    rows = [[name, number(trained), number(held_back)] for name, (trained, held_back) in found["rms_n"].items()]
    columns = ["method", "rows for training [N]", "rows held back [N]"]
    return ["## Training methods", intro, machine(found["machine"]), table(columns, rows)]


def _pose_section(summaries: Sequence[Mapping[str, Any]]) -> list[str]:
    intro = (
        f"[`python -m problems.pose_estimation`](../problems.md#pose-estimation) on the foundation of "
        f"`{summaries[0]['scene']}`. Forces are re-evaluated on elements (EF) at the solved poses: RMS (largest). "
        "og1_loads to og4_loads are the measured cycles that the built-in walking derives from, no part of the "
        "repository."
    )
    return ["## Pose estimation", intro, *_solved_cycles(summaries, "cycle", {})]


def _muscle_section(summaries: Sequence[Mapping[str, Any]]) -> list[str]:
    off = [[summary["predicted_minus_measured"][side] for summary in summaries] for side in SIDES]
    measured = [[f"{number(each['rms'])} ({each['mean']:+.0f})" for each in of_side] for of_side in off]
    columns = dict(zip(("medial RMS error (mean) [N]", "lateral RMS error (mean) [N]"), measured, strict=True))
    intro = (
        "Contact forces predicted by [`python -m problems.muscle_contact`](../problems.md#muscle-and-contact-forces) "
        "against those that the implant measured, which enter nowhere. Last column: elements (EF) at the solved poses."
    )
    return ["## Muscle and contact forces", intro, *_solved_cycles(summaries, "walk", columns)]


def _solved_cycles(
    summaries: Sequence[Mapping[str, Any]], name: str, columns: Mapping[str, Sequence[str]]
) -> tuple[str, str]:
    """The machine, and a table of cycles by a name, with further columns and RMS and largest difference of elements."""
    rows = []
    for k, found in enumerate(summaries):
        off = ", ".join(f"{rms:.2f} ({largest:.1f})" for rms, largest in (found["elements_off"][s] for s in SIDES))
        row = [found[name], f"{found['solved']} of {found['frames']}", str(found["ipopt_iterations"])]
        rows.append([*row, f"{found['seconds']:.2f}", *(cells[k] for cells in columns.values()), off])
    of_elements = f"{summaries[0]['elements']} − foundation, medial, lateral [N]"
    heads = ["cycle", "frames solved", "IPOPT iterations", "time [s]", *columns, of_elements]
    return machine(summaries[0]["machine"]), table(heads, rows)


def _stability_section(content: Mapping[str, Any]) -> list[str]:
    scene, lines = content["settings"]["scene"], [Line(**line) for line in content["lines"]]
    methods = list(dict.fromkeys(method for line in lines for method in line.values))
    quick = " --quick" if content["settings"].get("quick") == "yes" else ""
    parts = [
        "Shipped surrogates, the foundation, elements (EF), and two peers fitted to 400 poses of the motion, on the "
        "same hard cases. A dash: the quantity makes no sense for the method. Command: "
        f"`python -m problems.studies.stability {scene}{quick}`.",
        machine(content["machine"]),
    ]
    for row in sorted({line.row for line in lines}):
        mine = [line for line in lines if line.row == row]
        cells = [[f"{x.case}: {x.quantity}", *(x.cell(method).replace(" / ", "/") for method in methods)] for x in mine]
        parts += [f"## {row}. {FAILURES[row]}", *_ROWS.get(row, ()), table(["case: quantity", *methods], cells)]
    return parts


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
        save_page(draw_speed_accuracy(read_front(path)), out / f"{path.stem}.png")
    if (data / "solve_time.csv").is_file():
        save_page(solve_time.draw(read_front(data / "solve_time.csv")), out / f"{solve_time.NAME}.png")
    if readme is not None:
        written = with_numbers(readme, headline(data))
        with replacing(readme) as beside:
            beside.write_text(written, "utf-8")
    print(f"written {len(found)} pages to {out}")


if __name__ == "__main__":
    run_program(run)
