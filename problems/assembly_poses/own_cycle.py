"""The cycles of the assemblies that come with the library."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

import casadi_contact as cc
from casadi_contact.optimisation.assembly.assembly import Assembly
from casadi_contact.optimisation.muscle_contact import MuscleContact
from casadi_contact.optimisation.muscle_walk import example_walk
from casadi_contact.scenes.walking import reference_cycle
from problems.assembly_poses.cycle import AssemblyCycle

QUADRICEPS = ("recfem", "vasint", "vaslat", "vasmed")


def own_cycle(assembly: Assembly) -> AssemblyCycle:
    """The cycle of an assembly that has one; ValueError for another."""
    if assembly.name not in _CYCLES:
        raise ValueError(f"assembly {assembly.name} has no cycle of its own, expected a cycle file (--cycle)")
    return _CYCLES[assembly.name]()


def _walk() -> AssemblyCycle:
    """Walking: rotations and tibiofemoral loads of the mean reference cycle, and the quadriceps' tension that muscle
    and contact forces of the built-in walk find."""
    cycle, walk = reference_cycle(), example_walk()
    solved = MuscleContact(cc.load_surrogate("knee"), walk).solve()
    tension = solved.muscle_forces_n[:, [walk.muscles.names.index(name) for name in QUADRICEPS]].sum(axis=1)
    loads = {"Fy_med": cycle.fy_med, "Fy_lat": cycle.fy_lat, "cop_ap": cycle.cop_ap_mm, "cop_ml": cycle.cop_ml_mm}
    pose = {"femur": {"ry": cycle.ry, "rz": cycle.rz}}
    return AssemblyCycle("walking", cycle.time_s, pose, "tibiofemoral", loads, {"quadriceps": tension})


def _bending() -> AssemblyCycle:
    """The knee bends from 0 to 75 degrees in two seconds, pressed by 300 N along the tibia: ligaments hold the rest."""
    share = np.linspace(0.0, 1.0, 51)
    bent = {"femur": {"rz": -np.radians(75.0) * share}}
    return AssemblyCycle("bending", 2.0 * share, bent, applied={"femur": {"Fy": np.full(51, -300.0)}})


_CYCLES: dict[str, Callable[[], AssemblyCycle]] = {"knee_with_patella": _walk, "natural_knee": _bending}
