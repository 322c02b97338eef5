"""Material and placement of the fixed body as inputs of a contact function, with derivatives by CasADi's chain rule.

Loads are proportional to K(E, ν) and, under the linear law, to 1/h: material inputs are factors on the scene's own
loads, NaN unless E > 0, -1 < ν < 0.5 and h > 0. The fixed body placed at (t_f, R_f) in the scene's frame is met by the
moving body at R_fᵀ(t - t_f), R_fᵀR; its wrench (F', T') there is F = R_f F', T = R_f T' + t_f × F in the scene's frame,
about its origin.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import casadi as ca
import numpy as np

from casadi_contact.contact.pressure_law import layer_modulus
from casadi_contact.core.conventions import POSE_NAMES, Array
from casadi_contact.networks.frames import relative_pose, rotation
from casadi_contact.scenes.material import Material

PLACEMENT = tuple(f"fixed_{name}" for name in POSE_NAMES)
PARAMETERS = ("youngs_modulus", "poissons_ratio", "thickness", *PLACEMENT)


def check_parameters(parameters: Iterable[str], material: Material) -> tuple[str, ...]:
    """The parameters (E [MPa], ν, h [mm], placement [mm, rad]) asked for.

    Raises ValueError for an unknown or repeated one, and for a thickness that is no factor of the loads.
    """
    names = tuple([parameters] if isinstance(parameters, str) else parameters)
    unknown = [name for name in names if name not in PARAMETERS]
    if unknown or len(set(names)) < len(names):
        raise ValueError(f"parameters {', '.join(names)}, expected some of {', '.join(PARAMETERS)}, each once")
    if "thickness" in names and material.law != "linear":
        raise ValueError(f"thickness is no factor of the loads under the law {material.law!r}, expected the law linear")
    return names


def parametric_function(
    name: str,
    parameters: Sequence[str],
    material: Material,
    selection: Array,
    wrenches: Callable[[ca.MX], ca.MX],
) -> ca.Function:
    """Function pose (6), parameters (m) -> loads (L).

    selection (L, P, 6) picks loads from wrenches(pose) -> (6·P), those of the scene's own material in the fixed body's
    frame, patch after patch.
    """
    pose, given = ca.MX.sym("pose", 6), ca.MX.sym("parameters", len(parameters))
    value = dict(zip(parameters, ca.vertsplit(given), strict=True))
    placed = any(key in value for key in PLACEMENT)
    place = ca.vertcat(*(value.get(key, ca.MX(0.0)) for key in PLACEMENT))
    turn, shift = rotation(place[3:]), place[:3]
    forces = ca.reshape(
        wrenches(relative_pose((shift, turn), (pose[:3], rotation(pose[3:]))) if placed else pose),
        6,
        selection.shape[1],
    )
    parts = []
    for p in range(selection.shape[1]):
        force, torque = forces[:3, p], forces[3:, p]
        if placed:
            force = turn @ force
            torque = turn @ torque + ca.cross(shift, force)
        parts.append(ca.DM(selection[:, p]) @ ca.vertcat(force, torque))
    loads = _stiffness_ratio(value, material) * sum(parts[1:], parts[0])
    return ca.Function(name, [pose, given], [loads], ["pose", "parameters"], ["loads"])


def _stiffness_ratio(value: dict[str, ca.MX], material: Material) -> ca.MX:
    """(K/h) over that of the scene's material; NaN where there is no such material, so that a solver steps back."""
    names = ("youngs_modulus", "poissons_ratio", "thickness")
    E, nu, h = (ca.MX(value.get(name, getattr(material, name))) for name in names)
    modulus = (1.0 - nu) * E / ((1.0 + nu) * (1.0 - 2.0 * nu))
    bounds = {"youngs_modulus": E > 0.0, "poissons_ratio": ca.logic_and(nu > -1.0, nu < 0.5), "thickness": h > 0.0}
    ratio = modulus / layer_modulus(material) * material.thickness / h
    for name in (name for name in names if name in value):
        ratio = ca.if_else(bounds[name], ratio, np.nan)
    return ratio
