"""A muscle walk as the CSV files that it is read from."""

import csv
from dataclasses import fields

import numpy as np

from casadi_contact.optimisation.knee import coordinate_unit
from casadi_contact.optimisation.muscle_walk import PARAMETER_COLUMNS


def write_walk(folder, walk):
    """Write the files into a folder; their paths as the arguments of `read_walk`."""
    muscles = walk.muscles
    table = np.column_stack([getattr(muscles, field.name) for field in fields(muscles) if field.name != "names"])
    geometry = [
        [k, name, walk.lengths_m[k, m], walk.velocities_m_per_s[k, m], *(walk.arms[c][k, m] for c in walk.arms)]
        for k in range(len(walk))
        for m, name in enumerate(muscles.names)
    ]
    return {
        "rotations": _write_csv(
            folder / "rotations.csv",
            ["time_s", "flexion_rz_rad", "rotation_ry_rad"],
            zip(walk.time_s, walk.rz, walk.ry, strict=True),
        ),
        "inverse_dynamics": _write_csv(
            folder / "walk_inverse_dynamics.csv",
            ["time_s", *(f"{name}_{coordinate_unit(name)}" for name in walk.loads)],
            np.column_stack([walk.time_s, *walk.loads.values()]).tolist(),
        ),
        "muscles": _write_csv(
            folder / "muscles.csv",
            ["frame", "muscle", "length_m", "velocity_m_per_s", *(f"arm_{name}" for name in walk.arms)],
            geometry,
        ),
        "parameters": _write_csv(
            folder / "parameters.csv",
            ["muscle", *PARAMETER_COLUMNS],
            [[name, *row] for name, row in zip(muscles.names, table.tolist(), strict=True)],
        ),
    }


def _write_csv(path, header, rows):
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([header, *rows])
    return path
