"""What is known of an assembly over a cycle: measured pose parameters, loads of a contact, tensions, applied forces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from casadi_contact.core.conventions import POSE_NAMES, Array
from casadi_contact.core.quantities import quantity
from casadi_contact.optimisation.assembly.assembly import Assembly
from casadi_contact.scenes.checks import check_radians, check_rising
from casadi_contact.scenes.columns import TextColumns
from casadi_contact.scenes.load_cycle import OverTime

FORCES = ("Fx", "Fy", "Fz")
_TWOFOLD = "twofold"  # what a column tells that has two meanings
CENTRES = ("cop_ap", "cop_ml", "cop_x", "cop_y", "cop_z")


@dataclass(frozen=True)
class AssemblyCycle(OverTime):
    """Curves (n,) over time_s [s], by name.

    pose: measured pose parameters [mm, rad] by body; contact, loads: the contact whose loads [N, N·mm] and centres of
    pressure [mm] were measured ("" and none where none were); tensions [N] by pull; applied: forces Fx, Fy, Fz [N] on
    a body, at its origin, along the ground's axes.
    """

    name: str
    time_s: Array
    pose: Mapping[str, Mapping[str, Array]] = field(default_factory=dict)
    contact: str = ""
    loads: Mapping[str, Array] = field(default_factory=dict)
    tensions: Mapping[str, Array] = field(default_factory=dict)
    applied: Mapping[str, Mapping[str, Array]] = field(default_factory=dict)

    def frames(self, rows: np.ndarray) -> AssemblyCycle:
        """The same of these frames alone."""

        def taken(curves: Mapping[str, Array]) -> dict[str, Array]:
            return {name: curve[rows] for name, curve in curves.items()}

        return AssemblyCycle(
            self.name,
            self.time_s[rows],
            {body: taken(curves) for body, curves in self.pose.items()},
            self.contact,
            taken(self.loads),
            taken(self.tensions),
            {body: taken(curves) for body, curves in self.applied.items()},
        )


def two_or_more(rows: np.ndarray, count: int) -> np.ndarray:
    """These of `count` frames, and beside a single one its neighbour: a cycle has two frames at least."""
    if len(rows) != 1:
        return rows
    return np.array([rows[0], rows[0] + 1]) if rows[0] + 1 < count else np.array([rows[0] - 1, rows[0]])


def read_assembly_cycle(path: str | Path, assembly: Assembly) -> AssemblyCycle:
    """Read a cycle from a CSV file with time_s and whatever was measured of the assembly.

    femur_rz_rad: a pose parameter of a body; femur_Fy_N: a force applied to it; tibiofemoral_Fy_med_N,
    tibiofemoral_cop_ap_mm: a load or centre of pressure of a contact; quadriceps_N: the tension of a pull. Others are
    refused. Raises FileNotFoundError, and ValueError naming file, line and column.
    """
    table = TextColumns.read(path, "cycle file")
    table.require("time_s")
    known = _columns(assembly)
    unknown = set(table.header) - {"time_s", *known}
    if unknown:
        raise ValueError(
            f"{path}: unknown columns {', '.join(sorted(unknown))}; of assembly {assembly.name} a cycle may tell "
            f"{', '.join(known)}"
        )
    twofold = [column for column in table.header if known.get(column, ("",))[0] == _TWOFOLD]
    if twofold:
        raise ValueError(
            f"{path}: {', '.join(twofold)} may tell of a body or of the contact of the same name in assembly "
            f"{assembly.name}, expected names that differ: give the contact another name"
        )
    curves = {column: np.asarray(table.numbers(column)) for column in table.header}
    time_s = curves.pop("time_s")
    check_rising(str(path), time_s)
    found: dict[str, dict[str, dict[str, Array]]] = {"pose": {}, "loads": {}, "applied": {}, "tensions": {}}
    for column, curve in curves.items():
        what, owner, name = known[column]
        if column.endswith("_rad"):
            check_radians(str(path), column, curve)
        found[what].setdefault(owner, {})[name] = curve
    if len(found["loads"]) > 1:
        raise ValueError(f"{path} has loads of the contacts {', '.join(found['loads'])}, expected those of one")
    contact, loads = next(iter(found["loads"].items()), ("", {}))
    tensions = {owner: named[""] for owner, named in found["tensions"].items()}
    return AssemblyCycle(table.path.stem, time_s, found["pose"], contact, loads, tensions, found["applied"])


def _columns(assembly: Assembly) -> dict[str, tuple[str, str, str]]:
    """Column -> what it tells, of which part, and its name there."""
    columns: dict[str, tuple[str, str, str]] = {}
    for body in assembly.bodies:
        columns |= {f"{body}_{quantity(name).column}": ("pose", body, name) for name in POSE_NAMES}
        columns |= {f"{body}_{name}_N": ("applied", body, name) for name in FORCES}
    for contact in assembly.contacts:
        names = (*contact.model.load_names, *CENTRES)
        told = {f"{contact.name}_{quantity(name).column}": ("loads", contact.name, name) for name in names}
        columns |= {column: (_TWOFOLD, "", "") if column in columns else what for column, what in told.items()}
    return columns | {f"{pull.name}_N": ("tensions", pull.name, "") for pull in assembly.pulls}
