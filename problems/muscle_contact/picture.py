"""The picture of muscle and contact: both sides, activations, the strongest muscles, and what holds the patella."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.optimisation.joint_mechanics import total_selection
from casadi_contact.optimisation.knee import SIDES
from casadi_contact.optimisation.verification.verdict import Verdict
from casadi_contact.pictures.page import (
    COLOURS,
    FAILED,
    FOUNDATION,
    SURROGATE,
    WANTED,
    Panel,
    frame,
    new_page,
    panels,
    save_page,
)
from problems.muscle_contact.compared import Compared
from problems.muscle_contact.extensor import PATELLA, quadriceps
from problems.muscle_contact.problem import MuscleContact
from problems.muscle_contact.solve import MuscleContactResult

_MUSCLES = {
    "bflh": "biceps femoris, long head",
    "bfsh": "biceps femoris, short head",
    "gaslat": "gastrocnemius, lateral head",
    "gasmed": "gastrocnemius, medial head",
    "grac": "gracilis",
    "recfem": "rectus femoris",
    "sart": "sartorius",
    "semimem": "semimembranosus",
    "semiten": "semitendinosus",
    "tfl": "tensor fasciae latae",
    "vasint": "vastus intermedius",
    "vaslat": "vastus lateralis",
    "vasmed": "vastus medialis",
}


_DRAWN_MUSCLES = 6


def draw(
    problem: MuscleContact,
    result: MuscleContactResult,
    compared: Compared,
    path: Path,
    patellar: Verdict | None = None,
) -> None:
    """Forces of both sides (predicted, EF, measured), activations and the greatest muscle forces, and where the verdict
    on a patella is given what holds it, as a PNG."""
    walk, errors = problem.walk, compared.errors()
    rows = 2 if patellar is None else 3
    page = new_page(13.0, 4.25 * rows)
    parts = panels(page, rows, 2, {(2, 1)} if compared.teacher is None else {(0, 0), (0, 1), (2, 1)})
    failed = ~result.converged | result.overloaded
    for column, (name, side) in enumerate(zip(SIDES, ("medial", "lateral"), strict=True)):
        panel, axis = parts[0, column], parts[0, column].curves
        title = f"{side} side"
        if compared.measured is not None:
            axis.plot(walk.percent, -compared.measured[:, column], label="measured", **WANTED)
            title += f": RMS error {errors[name]['prediction']['rms']:.0f} N"
        axis.plot(walk.percent, -compared.got[:, column], label="predicted", **SURROGATE)
        if compared.teacher is not None:
            axis.plot(walk.percent, -compared.teacher[:, column], label="EF, same poses", **FOUNDATION)
        if failed.any():
            axis.plot(walk.percent[failed], -compared.got[failed, column], label="not solved", **FAILED)
        axis.set(title=title, ylabel="compression [N]")
        axis.legend(fontsize=8)
        if compared.teacher is not None:
            off = compared.got[:, column] - compared.teacher[:, column]  # of compressions, which have the other sign
            panel.difference(walk.percent, off, "EF - predicted", **FOUNDATION)
            panel.differences.set_ylabel("EF - predicted [N]", fontsize=7)
    forces = [parts[0, column].curves for column in range(2)]
    top = max(axis.get_ylim()[1] for axis in forces)
    for axis in forces:
        axis.set_ylim(-0.03 * top, top)
    names = [_MUSCLES.get(name, name) for name in walk.muscles.names]
    activation, strongest_forces = parts[1, 0].curves, parts[1, 1].curves
    image = activation.pcolormesh(
        walk.percent, np.arange(len(names)), result.activations.T, shading="nearest", cmap="viridis", vmin=0.0
    )
    activation.set_yticks(np.arange(len(names)), names, fontsize=8)
    page.colorbar(image, ax=activation, label="activation [-]")
    strongest = np.argsort(result.muscle_forces_n.max(axis=0))[::-1][:_DRAWN_MUSCLES]
    colours = [COLOURS[name] for name in ("blue", "vermillion", "green", "purple", "orange", "sky blue")]
    for muscle, color in zip(strongest, colours, strict=True):
        strongest_forces.plot(walk.percent, result.muscle_forces_n[:, muscle], color=color, label=names[muscle])
    strongest_forces.set(title="strongest muscles", ylabel="force [N]")
    strongest_forces.legend(fontsize=8)
    if patellar is not None:
        _draw_patella(parts[2, 0].curves, parts[2, 1], problem, result, patellar)
    frame((panel.lowest for panel in parts.values()), "cycle [%]")
    for panel in parts.values():
        panel.curves.set_xlim(0.0, 100.0)
    activation.grid(visible=False)
    converged = f"{int(result.converged.sum())} of {len(walk)} frames converged"
    converged += f", {int(result.overloaded.sum())} overloaded" if result.overloaded.any() else ""
    page.suptitle(f"Muscle and contact forces from inverse dynamics, {walk.name}: {converged}")
    save_page(page, path, dots_per_inch=110)


def _draw_patella(
    forces: Any, facets: Panel, problem: MuscleContact, result: MuscleContactResult, patellar: Verdict
) -> None:
    """Quadriceps, tendon and the resultant of the groove, which balance, and the compression of each facet with what
    the elastic foundation adds to it at the same poses."""
    assert problem.extensor is not None
    assert result.patella is not None
    walk, groove = problem.walk, problem.extensor.contact
    loads = groove.model(result.patella.contact_poses, patellar.load_names)
    selection = total_selection(patellar.load_names, groove.model.patch_names)[:3]
    resultant = loads @ selection.T
    held = {
        "quadriceps": result.muscle_forces_n[:, quadriceps(walk.muscles.names)].sum(axis=1),
        "groove contact": np.linalg.norm(resultant, axis=1),
    }
    lines = [line.name for line in problem.extensor.assembly.ligaments if PATELLA in line.bodies]
    held |= {name.replace("_", " "): result.patella.loads[name] for name in lines}
    for (label, curve), color in zip(held.items(), COLOURS.values(), strict=False):
        forces.plot(walk.percent, curve, color=color, label=label)
    forces.set(title="what holds the patella", ylabel="force [N]")
    for name, color in zip(groove.model.scene.sensitive_loads, COLOURS.values(), strict=False):
        column = patellar.load_names.index(name)
        compression = np.abs(loads[:, column])
        facets.curves.plot(walk.percent, compression, color=color, label=name)
        on_ef = np.abs(loads[:, column] - patellar.errors[:, column])
        facets.difference(walk.percent, on_ef - compression, name, color=color)
    facets.curves.set(title="facets of the patella", ylabel="compression [N]")
    facets.differences.set_ylabel("EF - predicted [N]", fontsize=7)
    for axis in (forces, facets.curves):
        axis.legend(fontsize=8)
