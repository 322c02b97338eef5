"""The few numbers that the README shows, each from the result file of the command it names."""

from __future__ import annotations

import json
from pathlib import Path

from casadi_contact.files import replacing
from casadi_contact.report import read_evaluation, read_kernel_speed
from problems.studies.pages.markdown import machine, number, table

BEGIN = "<!-- numbers: written by python -m problems.studies.pages -->"
END = "<!-- end of numbers -->"


def headline(data: Path) -> str:
    """Five numbers of the knee, with the command that measured each and the machine."""
    walking = read_evaluation(data / "evaluation.json")["walking"]
    own, fine = walking["models"]["trunk"], walking["models"][f"EF {walking['fine']}"]
    speed = read_kernel_speed(data / "kernel_speed.json")
    times = {k: v["low_us"] for k, v in speed["surrogates"]["trunk"]["microseconds"].items()}
    poses = json.loads((data / "pose_estimation" / "reference.json").read_text("utf-8"))
    kernel = ", ".join(number(times[f"{what}, kernel"]) for what in ("value", "Jacobian", "Hessian"))
    ratios = [fine["converged"][kind] / own["converged"][kind] for kind in ("force", "torque")]
    solved = f"{poses['converged']} of {poses['frames']} frames, {poses['ipopt_iterations']} iterations"
    grid = f"EF {walking['fine']}"
    evaluate, timed = "`casadi-contact evaluate knee`", "`casadi-contact speed knee`"
    rows = [
        [
            f"RMS error of `knee` on {walking['poses']} unseen poses of walking",
            f"{number(own['converged']['force'])} N, {number(own['converged']['torque'])} N·mm",
            evaluate,
        ],
        [
            f"error of {grid} (an elastic foundation), in multiples of that",
            f"{ratios[0]:.1f}, {ratios[1]:.1f}",
            evaluate,
        ],
        ["loads, Jacobian, Hessian of all loads, compiled; lowest of 15 repeats", f"{kernel} µs", timed],
        [f"time of {grid} in multiples of that of the loads", number(times[grid] / times["value, kernel"]), timed],
        ["poses of a walking cycle in one IPOPT problem", solved, "`python -m problems.pose_estimation`"],
    ]
    return f"{table(['what', 'measured', 'command'], rows)}\n\n{machine(speed['machine'])}"


def write_headline(readme: Path, text: str) -> None:
    """Put the numbers between the two marks of the README; ValueError without them."""
    content = readme.read_text("utf-8")
    before, begin, rest = content.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise ValueError(f"{readme} has no lines {BEGIN!r} and {END!r} to put the numbers between")
    with replacing(readme) as beside:
        beside.write_text(f"{before}{begin}\n\n{text}\n\n{end}{after}", "utf-8")
