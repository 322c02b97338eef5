"""Numbers of result files as text and tables, and those that stand between two marks in a page written by hand."""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from casadi_contact.contact.elements.foundation import grid_text
from casadi_contact.scenes.loading import load_scene
from casadi_contact.surrogate.load import load_surrogate
from casadi_contact.workflow.benchmark.front_file import TIMES, Front, Point, read_front, shipped_front

BEGIN = "<!-- numbers: written by python -m problems.studies.pages -->"
END = "<!-- end of numbers -->"
FRONT = "casadi-contact speed knee --out results/front"  # a folder where nothing was built
_PACKAGES = ("casadi_contact", "casadi", "numpy", "scipy", "numba", "torch")


def headline(data: Path) -> str:
    """Numbers of the knee for the README, with the command that measured each, and the machines.

    Times of calls, and their ratios, are ranges over the machines whose fronts are in the folder ``machines``."""
    solutions = read_front(data / "solve_time.csv").models
    whole = {point.name: 1e-3 * point.value.median_us for point in solutions if point.value is not None}
    scene = load_scene("knee")
    shipped = shipped_front(scene)
    if shipped is None:
        raise ValueError(f"no front of knee is shipped: put that of {FRONT} into workflow/benchmark/ready")
    front, grid = shipped[1], f"EF {grid_text(scene.grids['fine'])}"
    (knee,) = (point for point in front.models if point.name == "knee")
    others = [read_front(path) for path in sorted((data / "machines").glob("*.csv"))]
    machines = [{point.name: point for point in each.models} for each in (front, *others)]
    of_kernel = [[getattr(models["knee"], what).low_us for models in machines] for what in TIMES[:3]]
    kernel = ", ".join(map(spread, of_kernel))
    quickest = min((name for name in whole if name.startswith("foundation")), key=lambda name: whole[name])
    times = "; ".join(number(whole[name]) for name in (quickest, "knee", grid)) + " ms"
    errors = f"{number(knee.force_rms_n)} N, {number(knee.torque_rms_nmm)} N·mm"
    what = f"whole pose estimation of a walking cycle, a frame: {quickest}; `knee`; {grid}"
    rows = [
        [what, times, "`python -m problems.studies.solve_time`"],
        [f"RMS error of `knee` on {front.header['walking_poses']} unseen poses of walking", errors, f"`{FRONT}`"],
        ["time per pose of loads, Jacobian, Hessian of `knee`, compiled (lowest of 7)", f"{kernel} µs", f"`{FRONT}`"],
        _fastest_untrained(front, knee, machines),
    ]
    if (forms := data / "casadi_forms.json").is_file():
        rows.append(_other_forms(read(forms)["surrogates"]["knee"]))
    numbers = table(["what", "measured", "command"], rows, texts=["command"])
    also = ", ".join(f"{each.header['processor']} ({each.header['instruction_set']})" for each in others)
    ranges = f"\n\nRanges of times and ratios include those measured on: {also}." if also else ""
    return f"{numbers}\n\n{machine(front.header)}{ranges}"


def _other_forms(forms: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """The same networks in CasADi's own forms, by the time of our kernel."""
    own, *others = ((name, found) for name, found in forms.items() if "missing" not in found)

    def times(found: Mapping[str, Any], what: str) -> str:
        return number(found[f"{what}_us"] / own[1][f"{what}_us"])

    what = f"time per pose of loads / Hessian of `knee` by {', '.join(name for name, _ in others)}, divided by ours"
    cells = [f"{times(found, 'value')} / {times(found, 'Hessian')}" for _, found in others]
    return [what, "; ".join(cells), "`python -m problems.studies.casadi_forms`"]


def _ratio(machines: Sequence[Mapping[str, Point]], name: str, by: str) -> str:
    """The range over machines of the time of one model divided by that of another."""
    found = [models for models in machines if name in models]
    return spread(models[name].value.median_us / models[by].value.median_us for models in found)  # type: ignore[union-attr]


def _fastest_untrained(front: Front, knee: Point, machines: Sequence[Mapping[str, Point]]) -> list[str]:
    """The fastest model without training that is as accurate as the surrogate: what it must be compared with."""
    times = {point.name: point.value.median_us for point in front.models if point.value is not None}
    untrained = [p for p in front.models if p.name in times and not p.samples and p.force_rms_n <= knee.force_rms_n]
    as_accurate = [p for p in untrained if p.torque_rms_nmm <= knee.torque_rms_nmm]
    best = min(as_accurate, key=lambda point: times[point.name])
    which = best.name.replace("foundation", "the foundation with")
    what = (
        f"time per pose of the fastest model without training that is as accurate ({which}, RMS "
        f"{number(best.force_rms_n)} N), divided by that of `knee`"
    )
    return [what, _ratio(machines, best.name, knee.name), f"`{FRONT}`"]


def with_numbers(page: Path, numbers: str) -> str:
    """The text of a page with the numbers between its two marks; ValueError without them."""
    before, begin, rest = page.read_text("utf-8").partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise ValueError(f"{page} has no lines {BEGIN!r} and {END!r}, expected both")
    return f"{before}{begin}\n\n{numbers}\n\n{end}{after}"


def paper_numbers(data: Path) -> str:
    """Tables 4, 2 and 3 of [EF15] beside ours: walking, then RMS and largest errors of held-back samples."""
    paper, front = read(data / "paper.json"), read_front(data / "speed_accuracy.csv")
    names, models = ("knee_two_stage", "knee"), {point.name: point for point in front.models}
    heads, rows = ["paper", *(f"`{name}`" for name in names)], []
    for k, (what, unit) in enumerate((("time", "µs"), ("force error", "N"), ("torque error", "N·mm"))):
        values = {model: [theirs.get(unit)] for model, theirs in paper["walking"].items()}
        for model, cells in values.items():
            for point in (models[name if model == "surrogate" else model] for name in names):
                time = None if point.value is None else point.value.median_us
                cells.append((time, point.force_rms_n, point.torque_rms_nmm)[k])
            rows.append([f"{what} of {model} [{unit}]", *("-" if x is None else number(x) for x in cells)])
        *grids, surrogate = values
        for grid in grids:
            ratios = (ef and ef / own for ef, own in zip(values[grid], values[surrogate], strict=True))
            rows.append([f"{what}, {grid} / surrogate", *("-" if x is None else number(x) for x in ratios)])
    parts = ["## Table 4: walking", machine(front.header), table(["", *heads], rows)]
    records = [paper["test_errors"], *(load_surrogate(name).record["test_errors"] for name in names)]
    for error, title in (("rms", "Table 2: RMS errors"), ("max", "Table 3: largest errors")):
        loads = list(records[0]["D1"])
        rows = [
            [domain, *("/".join(number(record[domain][load][error]) for record in records) for load in loads)]
            for domain in records[0]
        ]
        parts += [f"## {title} [N, N·mm]", f"Each cell: {' / '.join(heads)}.", table(["domain", *loads], rows)]
    return "\n\n".join(parts)


def read(path: Path) -> dict[str, Any]:
    """The object in a JSON file."""
    return dict(json.loads(path.read_text("utf-8")))


def page_text(title: str, *parts: str) -> str:
    """A page that says below its title that it is not to be edited: sites take a page's name from its first line."""
    return "\n\n".join((f"# {title}", "<!-- written by python -m problems.studies.pages -->", *parts)) + "\n"


def table(columns: Sequence[str], rows: Sequence[Sequence[str]], *, texts: Sequence[str] = ()) -> str:
    """A table; all columns but the first, and those named texts, hold numbers and are aligned right."""
    marks = ("---" if column in (columns[0], *texts) else "---:" for column in columns)
    head = [" | ".join(columns), " | ".join(marks)]
    return "\n".join(f"| {line} |" for line in (*head, *(" | ".join(row) for row in rows)))


def machine(record: Mapping[str, Any]) -> str:
    """Processor, instruction set, system and versions, as a sentence."""
    flags = f", kernels compiled with `{record['kernel_flags']}`" if "kernel_flags" in record else ""
    versions = ", ".join(f"{name} {record[name]}" for name in _PACKAGES if name in record)
    return (
        f"Measured on: {record['processor']} ({record['instruction_set']}{flags}), {record['cores']} cores, "
        f"{record['system']}; Python {record['python']}, {versions}."
    )


def spread(values: Iterable[float]) -> str:
    """The range of values, two digits each where they differ: 4.5 to 7."""
    found = sorted(values)
    return number(found[0]) if len(found) == 1 else f"{found[0]:.2g} to {found[-1]:.2g}"


def number(value: float) -> str:
    """Three digits, without an exponent where that is short."""
    return f"{value:.0f}" if 100.0 <= abs(value) < 1e6 else f"{value:.3g}"
