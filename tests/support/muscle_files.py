"""A muscle walk as the CSV files that it is read from."""

import numpy as np

from casadi_contact.optimisation.knee import coordinate_unit
from casadi_contact.scenes.columns import write_columns
from problems.walks import PARAMETER_COLUMNS


def write_walk(folder, walk):
    """Write the files into a folder; their paths as the arguments of `read_walk`."""
    muscles, frames = walk.muscles, len(walk)
    sizes = (getattr(muscles, name.replace("_N", "_n")) for name in PARAMETER_COLUMNS)
    tables = {
        "rotations": {"time_s": walk.time_s, "flexion_rz_rad": walk.rz, "rotation_ry_rad": walk.ry},
        "walk_inverse_dynamics": {
            "time_s": walk.time_s,
            **{f"{name}_{coordinate_unit(name)}": curve for name, curve in walk.loads.items()},
        },
        "muscles": {
            "frame": np.repeat(np.arange(frames), len(muscles.names)),
            "muscle": frames * list(muscles.names),
            "length_m": walk.lengths_m.ravel(),
            "velocity_m_per_s": walk.velocities_m_per_s.ravel(),
            **{f"arm_{name}": table.ravel() for name, table in walk.arms.items()},
        },
        "parameters": {"muscle": list(muscles.names), **dict(zip(PARAMETER_COLUMNS, sizes, strict=True))},
    }
    paths = {name: folder / f"{name}.csv" for name in tables}
    for name, columns in tables.items():
        write_columns(paths[name], columns)
    return {name.removeprefix("walk_"): path for name, path in paths.items()}
