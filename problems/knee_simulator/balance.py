"""Is a simulated cycle sound? Its energy balance, and what the elastic foundation leaves unbalanced."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.contact.model import ContactModel
from casadi_contact.conventions import Array
from casadi_contact.optimisation import total_selection
from problems.knee_simulator.problem import POWERS, KneeSimulator
from problems.knee_simulator.solve import Simulation

_PANELS_PER_MM = 40
_MOST_MM = 32  # to lift by: no layer is pressed as deep


@dataclass(frozen=True)
class EnergyBalance:
    """Each (n,) since the start [N·mm]: what came in (applied loads, flexion drive), what became of it (kinetic,
    springs, dissipation, work against contact), and the change of the contact's stored energy, for comparison.

    error = in - out is the integrator's; unstored = work against contact - stored is the contact model's: an elastic
    foundation's forces derive from an energy only nearly, a surrogate's as nearly as it has learned them.
    """

    applied: Array
    drive: Array
    kinetic: Array
    springs: Array
    dissipation: Array
    contact: Array
    stored: Array

    @property
    def error(self) -> Array:
        """What the integrator lost or made, (n,) [N·mm]."""
        return self.applied + self.drive - self.kinetic - self.springs - self.dissipation - self.contact

    @property
    def unstored(self) -> Array:
        """Work against contact that its energy does not hold, (n,) [N·mm]."""
        return self.contact - self.stored

    @classmethod
    def of(cls, simulator: KneeSimulator, simulation: Simulation) -> EnergyBalance:
        """Raises ValueError where the simulation was run without ``energies=True``."""
        if len(simulation.work) != len(simulation.time_s):
            raise ValueError("the simulation holds no work, expected one solved with energies=True")
        work = {name: simulation.work[:, column] for column, name in enumerate(POWERS)}
        q, v = np.split(simulation.states, 2, axis=1)
        kinetic = 0.5 * v**2 @ simulator.rig.inertia
        springs = 0.5 * (q - np.array(simulator.rig.rest_mm_rad)) ** 2 @ simulator.rig.stiffness
        stored = lifting_energy(simulator.model, simulation.poses)
        return cls(**work, kinetic=kinetic - kinetic[0], springs=springs - springs[0], stored=stored - stored[0])


def lifting_energy(model: ContactModel, poses: Array) -> Array:
    """Energy (n,) [N·mm] that contact gives back when the body is lifted straight off: U = ∫ N(ty + h) dh from h = 0 to
    the first gap."""
    total = total_selection(model.load_names, model.patch_names)[1]
    nodes, weights = np.polynomial.legendre.leggauss(3)
    width = 1.0 / _PANELS_PER_MM
    heights = (width * (np.arange(_PANELS_PER_MM)[:, None] + 0.5 * (nodes + 1.0))).ravel()
    energy, touching, begun_mm = np.zeros(len(poses)), np.arange(len(poses)), 0
    while len(touching) and begun_mm < _MOST_MM:
        lifted = np.repeat(poses[touching], len(heights), axis=0)
        lifted[:, 1] += begun_mm + np.tile(heights, len(touching))
        downward = -(model(lifted) @ total).reshape(len(touching), -1)
        still = np.cumprod(downward > 0.0, axis=1)  # what a surrogate bears beyond the first gap is false
        energy[touching] += (downward * still) @ np.tile(0.5 * width * weights, _PANELS_PER_MM)
        touching, begun_mm = touching[still[:, -1] > 0], begun_mm + 1
    return energy


def unbalanced(simulation: Simulation, other: ContactModel) -> Array:
    """Wrench (n, 6) [N, N·mm] left over when another model's contact takes the place of the simulation's."""
    return np.asarray(
        other(simulation.poses) @ total_selection(other.load_names, other.patch_names).T - simulation.wrenches
    )
