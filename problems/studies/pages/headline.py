"""The few numbers that the README shows, each from the result file of the command it names."""

from __future__ import annotations

import json
from pathlib import Path

from casadi_contact.benchmark.shipped import shipped_front
from casadi_contact.files import replacing
from casadi_contact.report import read_evaluation, read_kernel_speed
from casadi_contact.scenes import load_scene
from problems.studies.pages.markdown import machine, number, table

BEGIN = "<!-- numbers: written by python -m problems.studies.pages -->"
END = "<!-- end of numbers -->"


def headline(data: Path) -> str:
    """Five numbers of the knee, with the command that measured each and the machine."""
    walking = read_evaluation(data / "evaluation.json")["walking"]
    own = walking["models"]["trunk"]
    speed = read_kernel_speed(data / "kernel_speed.json")
    times = {k: v["low_us"] for k, v in speed["surrogates"]["trunk"]["microseconds"].items()}
    poses = json.loads((data / "pose_estimation" / "reference.json").read_text("utf-8"))
    kernel = ", ".join(number(times[f"{what}, kernel"]) for what in ("value", "Jacobian", "Hessian"))
    solved = f"{poses['converged']} of {poses['frames']} frames, {poses['ipopt_iterations']} iterations"
    grid = f"EF {walking['fine']}"
    evaluate, timed = "`casadi-contact evaluate knee`", "`casadi-contact speed knee`"
    rows = [
        [
            f"RMS error of `knee` on {walking['poses']} unseen poses of walking",
            f"{number(own['converged']['force'])} N, {number(own['converged']['torque'])} N·mm",
            evaluate,
        ],
        ["loads, Jacobian, Hessian of all loads, compiled; lowest of 15 repeats", f"{kernel} µs", timed],
        _fastest_untrained(),
        [
            f"time of {grid} (elements) in multiples of that of `knee`",
            number(times[grid] / times["value, kernel"]),
            timed,
        ],
        ["poses of a walking cycle in one IPOPT problem", solved, "`python -m problems.pose_estimation`"],
    ]
    return f"{table(['what', 'measured', 'command'], rows)}\n\n{machine(speed['machine'])}"


def _fastest_untrained() -> list[str]:
    """The row of what a surrogate must be compared with: the fastest without training that is as accurate."""
    shipped = shipped_front(load_scene("knee"))
    if shipped is None:
        raise ValueError("no front of knee is shipped: run python -m casadi_contact.benchmark.shipped knee first")
    points = [point for point in shipped[1].models if point.value is not None]
    times = {point.name: point.value.median_us for point in points if point.value is not None}
    (knee,) = (point for point in points if point.name == "knee")
    as_accurate = [
        point
        for point in points
        if not point.samples and point.force_rms_n <= knee.force_rms_n and point.torque_rms_nmm <= knee.torque_rms_nmm
    ]
    best = min(as_accurate, key=lambda point: times[point.name])
    what = f"the fastest as accurate without training ({best.name}, {number(best.force_rms_n)} N)"
    command = "`python -m casadi_contact.benchmark.shipped knee`"
    return [f"time of {what}, in multiples of that of `knee`", number(times[best.name] / times[knee.name]), command]


def write_headline(readme: Path, text: str) -> None:
    """Put the numbers between the two marks of the README; ValueError without them."""
    content = readme.read_text("utf-8")
    before, begin, rest = content.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise ValueError(f"{readme} has no lines {BEGIN!r} and {END!r} to put the numbers between")
    with replacing(readme) as beside:
        beside.write_text(f"{before}{begin}\n\n{text}\n\n{end}{after}", "utf-8")
