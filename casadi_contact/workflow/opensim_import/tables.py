"""An assembly's tables (mm, rad, N, kg) from what the wheel says of a model (m, rad, N, kg): see `assembly.file`."""

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from casadi_contact.core.conventions import Array
from casadi_contact.optimisation.assembly.paths import MuscleCurves

Table = dict[str, Any]


def pose_mm(transform: Any) -> list[float]:
    """Pose [mm, rad] of a transform (3, 4) [m]."""
    X = np.asarray(transform)
    return [*(1e3 * X[:, 3]).tolist(), *Rotation.from_matrix(X[:, :3]).as_euler("XYZ").tolist()]


def assembly_tables(model: Mapping[str, Any]) -> tuple[Table, dict[str, MuscleCurves]]:
    """All but contacts and wraps, and the muscles' curves by name: millard, millard_2 ... where they differ."""
    curves: dict[str, MuscleCurves] = {}
    scales = {name: 1e3 if c["kind"] == "translation" else 1.0 for name, c in model["coordinates"].items()}
    tables = {
        "format": 1,
        "name": re.sub(r"^(?![A-Za-z])", "model_", re.sub(r"[^A-Za-z0-9_]", "_", model["name"]))[:64],
        "ground": "ground",
        "gravity_m_s2": model["gravity"],
        "paths": "paths.h5",
        "coordinates": {name: _coordinate(c, scales[name]) for name, c in model["coordinates"].items()},
        "bodies": {
            name: {
                "mass_kg": body["mass"],
                "centre_mm": _mm(body["mass_center"]),
                "inertia_kgmm2": [1e6 * value for value in body["inertia"]],
            }
            for name, body in model["bodies"].items()
        },
        "joints": {name: _joint(joint, scales) for name, joint in model["joints"].items()},
        "ligaments": {
            name: {
                **_path(ligament),
                "stiffness_n": ligament["linear_stiffness"],
                "slack_length_mm": 1e3 * ligament["slack_length"],
                "toe_strain": 0.5 * ligament["transition_strain"],
                "damping_s": ligament["damping_coefficient"],
            }
            for name, ligament in model["ligaments"].items()
            if ligament["applied"]
        },
        "muscles": {
            name: _muscle(muscle, curves, model["curve_samples"])
            for name, muscle in model["muscles"].items()
            if muscle["applied"] and "active" in muscle
        },
        "coordinate_springs": {
            name: {
                "of": spring["of"],
                "stiffness": spring["stiffness"],
                "rest": spring["rest_length"],
                "viscosity": spring["viscosity"],
            }
            for name, spring in model["springs"].items()
        },
    }
    return tables, curves


def lost_parts(model: Mapping[str, Any]) -> list[str]:
    """What of the model the tables do not hold, by name."""
    lost = [f"{name}: {kind}" for name, kind in model["others"]]
    lost += [f"{name}: a constraint, which no longer holds" for name in model["constraints"]]
    for kind in ("ligaments", "muscles"):
        lost += [
            f"{name}: appliesForce is false, so it is left out" for name, p in model[kind].items() if not p["applied"]
        ]
        lost += [
            f"{name}: its {', '.join(set(path['moving']))} stands still, but for what the fit of its length makes good"
            for name, path in model[kind].items()
            if path["moving"]
        ]
    return lost + [
        f"{name}: {muscle['kind']} has other curves, expected Millard2012EquilibriumMuscle: its force"
        for name, muscle in model["muscles"].items()
        if "active" not in muscle
    ]


def _mm(values: Any) -> list[Any]:
    found: list[Any] = (1e3 * np.asarray(values, dtype=float)).tolist()
    return found


def _coordinate(c: Mapping[str, Any], scale: float) -> Table:
    low, high = (scale * value for value in c["range"])
    return {"kind": c["kind"], "default": scale * c["default"], "low": low, "high": high}


def _joint(joint: Mapping[str, Any], scales: Mapping[str, float]) -> Table:
    table = {key: joint[key] for key in ("parent", "child")}
    table |= {key: pose_mm(joint[key]) for key in ("parent_frame", "child_frame")}
    for group, unit in (("rotations", 1.0), ("translations", 1e3)):
        table[group] = [_axis(axis, unit, scales) for axis in joint[group] if axis["of"] or axis["offset"]]
    return table


def _axis(axis: Mapping[str, Any], unit: float, scales: Mapping[str, float]) -> Table:
    """unit: of its value in m or rad; the coordinate's own is scales[of]."""
    of, per = axis["of"], scales.get(axis["of"], 1.0)
    if "knots" in axis:
        knots: Array = np.array(axis["knots"]) * [per, unit, unit / per]
        return {"axis": axis["axis"], "of": of, "knots": knots.ravel().tolist()}
    return {"axis": axis["axis"], "of": of, "offset": unit * axis["offset"], "slope": unit / per * axis["slope"]}


def _path(path: Mapping[str, Any]) -> Table:
    return {"bodies": path["bodies"], "points_mm": _mm(path["points"])}


def _muscle(muscle: Mapping[str, Any], curves: dict[str, MuscleCurves], samples: Mapping[str, Any]) -> Table:
    lengths, speeds = (np.array(samples[key]) for key in ("lengths", "speeds"))
    active, passive, of_speed = (np.array(muscle[key]) for key in ("active", "passive", "speed"))
    own = MuscleCurves(lengths, active, passive, speeds, of_speed)
    same = (name for name, known in curves.items() if _alike(known, own))
    name = next(same, f"millard_{len(curves) + 1}" if curves else "millard")
    curves.setdefault(name, own)
    return {
        **_path(muscle),
        "max_force_n": muscle["max_isometric_force"],
        "optimal_fibre_mm": 1e3 * muscle["optimal_fiber_length"],
        "tendon_slack_mm": 1e3 * muscle["tendon_slack_length"],
        "pennation_rad": muscle["pennation"],
        "max_speed_per_s": muscle["max_contraction_velocity"],
        "damping": muscle["damping"],
        "curves": name,
    }


def _alike(one: MuscleCurves, other: MuscleCurves) -> bool:
    return all(np.array_equal(getattr(one, key), getattr(other, key)) for key in ("active", "passive", "of_speed"))
