"""A made-up walk with muscles, for problems that are given no files."""

from __future__ import annotations

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.optimisation.knee import COORDINATES
from casadi_contact.optimisation.muscle import MuscleParameters
from casadi_contact.optimisation.muscle_walk import MuscleWalk
from casadi_contact.scenes.walking import reference_cycle

# muscle: greatest force [N], optimal fibre [m], pennation [rad], arms of adduction, rotation and flexion [m], pull
# along x, y and z. Sizes after Arnold et al., Ann Biomed Eng 38 (2010) 269-279, rounded; arms are constant here.
_MUSCLES = {
    "bflh": (700.0, 0.10, 0.20, -0.030, 0.020, -0.035, -0.15, -0.98, -0.13),
    "bfsh": (320.0, 0.11, 0.21, -0.035, 0.015, -0.030, -0.10, -0.99, -0.09),
    "gaslat": (610.0, 0.06, 0.21, -0.020, -0.018, -0.018, 0.62, -0.78, 0.08),
    "gasmed": (1310.0, 0.05, 0.17, 0.020, 0.013, -0.024, 0.52, -0.85, -0.06),
    "grac": (140.0, 0.23, 0.14, 0.035, -0.015, -0.040, -0.15, -0.99, 0.00),
    "recfem": (850.0, 0.08, 0.24, 0.000, 0.000, 0.045, 0.24, -0.97, -0.03),
    "sart": (110.0, 0.40, 0.02, 0.044, 0.008, -0.025, 0.10, -0.98, -0.14),
    "semimem": (1160.0, 0.07, 0.26, 0.020, -0.013, -0.042, -0.15, -0.99, 0.03),
    "semiten": (300.0, 0.19, 0.22, 0.018, -0.012, -0.050, -0.15, -0.99, 0.00),
    "tfl": (160.0, 0.10, 0.05, -0.041, 0.000, 0.008, 0.00, -1.00, 0.03),
    "vasint": (1020.0, 0.10, 0.08, -0.004, 0.000, 0.042, 0.26, -0.97, 0.00),
    "vaslat": (2260.0, 0.10, 0.32, -0.018, -0.001, 0.041, 0.22, -0.97, 0.04),
    "vasmed": (1440.0, 0.10, 0.52, 0.010, 0.000, 0.041, 0.28, -0.96, -0.07),
}


def example_walk(frames: int = 101) -> MuscleWalk:
    """A made-up walk of the usual size, at the rotations of the built-in reference cycle.

    knee_ty is the ground's push (two humps) less the shank's weight in swing; adduction goes with it; flexion extends
    in loading response and flexes at push-off and before heel strike. Lengths follow from the arms,
    length = length0 - arm·rz, velocities from lengths.
    """
    cycle, slack_over_fibre = reference_cycle(frames), 2.0
    share = (cycle.time_s - cycle.time_s[0]) / (cycle.time_s[-1] - cycle.time_s[0])
    stance = 1.0 / (1.0 + np.exp((share - 0.62) / 0.02))
    early, late = _bump(share, 0.17, 0.11), _bump(share, 0.47, 0.11)
    loads = {
        "knee_tx": stance * 60.0 * (early + 2.0 * late) - 30.0,
        "knee_ty": stance * (250.0 + 320.0 * early + 330.0 * late) - 50.0,
        "knee_tz": 40.0 * stance * (early + late),
        "knee_adduction": -stance * (4.0 + 18.0 * early + 13.0 * late),
        "knee_rotation": stance * (1.0 + 6.0 * late),
        "knee_flexion": 20.0 * early - 16.0 * late + 14.0 * _bump(share, 0.61, 0.07) - 20.0 * _bump(share, 0.95, 0.06),
    }
    names, table = tuple(_MUSCLES), np.array(list(_MUSCLES.values()))
    force, fibre, pennation, adduction, rotation, flexion, *pulls = table.T
    arms = dict(zip(COORDINATES, (*pulls, adduction, rotation, flexion), strict=True))
    lengths = (slack_over_fibre + np.cos(pennation)) * fibre - np.outer(cycle.rz - cycle.rz.mean(), flexion)
    return MuscleWalk(
        "built-in walk",
        cycle.time_s,
        cycle.rz,
        cycle.ry,
        loads,
        {name: np.tile(arm, (frames, 1)) for name, arm in arms.items()},
        lengths,
        np.gradient(lengths, cycle.time_s, axis=0),
        MuscleParameters(names, force, fibre, slack_over_fibre * fibre, pennation),
    )


def _bump(share: Array, place: float, width: float) -> Array:
    """A bell of height 1 on the circle of the cycle."""
    away = (share - place + 0.5) % 1.0 - 0.5
    return np.exp(-((away / width) ** 2))
