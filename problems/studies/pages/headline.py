"""The few numbers that the README shows, each from the result file of the command it names."""

from __future__ import annotations

import json
from pathlib import Path

from casadi_contact.core.files.writing import replacing
from casadi_contact.pictures.report.kernel_speed import read_kernel_speed
from casadi_contact.pictures.report.tables import read_evaluation
from casadi_contact.scenes.loading import load_scene
from casadi_contact.workflow.benchmark.front_file import Front
from casadi_contact.workflow.benchmark.shipped import shipped_front
from problems.studies.pages.markdown import machine, number, table

BEGIN = "<!-- numbers: written by python -m problems.studies.pages -->"
END = "<!-- end of numbers -->"
_FRONT = "python -m casadi_contact.workflow.benchmark.shipped knee"


def headline(data: Path) -> str:
    """Five numbers of the knee, with the command that measured each and the machine."""
    grid = f"EF {read_evaluation(data / 'evaluation.json')['walking']['fine']}"
    speed = read_kernel_speed(data / "kernel_speed.json")
    times = {k: v["low_us"] for k, v in speed["surrogates"]["patch"]["microseconds"].items()}
    poses = json.loads((data / "pose_estimation" / "reference.json").read_text("utf-8"))
    kernel = ", ".join(number(times[f"{what}, kernel"]) for what in ("value", "Jacobian", "Hessian"))
    solved = f"{poses['converged']} of {poses['frames']} frames, {poses['ipopt_iterations']} iterations"
    timed = "`casadi-contact speed knee`"
    front = _front_of_the_knee()
    rows = [
        _error_of_the_knee(front),
        ["time per pose of loads, Jacobian, Hessian of `knee`, compiled (lowest of 15)", f"{kernel} µs", timed],
        _fastest_untrained(front),
        [
            f"time per pose of {grid} (elastic foundation, that many elements a side), divided by that of `knee`",
            number(times[grid] / times["value, kernel"]),
            timed,
        ],
        ["poses of a walking cycle in one IPOPT problem", solved, "`python -m problems.pose_estimation`"],
    ]
    numbers = table(["what", "measured", "command"], rows, texts=["command"])
    return f"{numbers}\n\n{machine(speed['machine'])}"


def _front_of_the_knee() -> Front:
    """The measured front that comes with the package; ValueError without it."""
    shipped = shipped_front(load_scene("knee"))
    if shipped is None:
        raise ValueError(f"no front of knee is shipped: run {_FRONT} first")
    return shipped[1]


def _error_of_the_knee(front: Front) -> list[str]:
    (knee,) = (point for point in front.models if point.name == "knee")
    what = f"RMS error of `knee` on {front.header['walking_poses']} unseen poses of walking"
    return [what, f"{number(knee.force_rms_n)} N, {number(knee.torque_rms_nmm)} N·mm", f"`{_FRONT}`"]


def _fastest_untrained(front: Front) -> list[str]:
    """The row of what a surrogate must be compared with: the fastest without training that is as accurate."""
    points = [point for point in front.models if point.value is not None]
    times = {point.name: point.value.median_us for point in points if point.value is not None}
    (knee,) = (point for point in points if point.name == "knee")
    as_accurate = [
        point
        for point in points
        if not point.samples and point.force_rms_n <= knee.force_rms_n and point.torque_rms_nmm <= knee.torque_rms_nmm
    ]
    best = min(as_accurate, key=lambda point: times[point.name])
    which = best.name.replace("foundation", "the foundation with")
    what = (
        f"time per pose of the fastest model without training that is as accurate ({which}, RMS "
        f"{number(best.force_rms_n)} N), divided by that of `knee`"
    )
    return [what, number(times[best.name] / times[knee.name]), f"`{_FRONT}`"]


def write_headline(readme: Path, text: str) -> None:
    """Put the numbers between the two marks of the README; ValueError without them."""
    content = readme.read_text("utf-8")
    before, begin, rest = content.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise ValueError(f"{readme} has no lines {BEGIN!r} and {END!r} to put the numbers between")
    with replacing(readme) as beside:
        beside.write_text(f"{before}{begin}\n\n{text}\n\n{end}{after}", "utf-8")
