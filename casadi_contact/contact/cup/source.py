"""The quadrature of a cup as C (``contact/c/cup.h``)."""

from __future__ import annotations

import numpy as np

from casadi_contact.contact.compiled.source import C_FOLDER, braces
from casadi_contact.contact.cup.cup import Cup
from casadi_contact.contact.cup.quadrature import any_across, nodes
from casadi_contact.networks.kernel.source import c_text


def cup_source(cup: Cup, points: int) -> str:
    """Tables of the cup and `patch_loads`."""
    numbers = {
        "BALL_RADIUS": cup.ball_radius,
        "CUP_RADIUS": cup.radius,
        "RIM_COS": float(np.cos(cup.half_angle)),
        "RIM_SIN": float(np.sin(cup.half_angle)),
    }
    n = nodes(points)
    tables = {
        "cup_pole[3]": cup.pole,
        "cup_centre[3]": cup.centre,
        "cup_beside[3]": any_across(cup),
        "whole_node[POINTS]": n.whole,
        "whole_weight[POINTS]": n.whole_weight,
        "arc_node[POINTS]": n.arc,
        "arc_weight[POINTS]": n.arc_weight,
    }
    return "\n".join(
        [
            f"#define POINTS {points}",
            *(f"#define {name} {value!r}" for name, value in numbers.items()),
            *(f"static const double {name} = {braces(values)};" for name, values in tables.items()),
            c_text("cup.h", C_FOLDER),
            c_text("orders.h", C_FOLDER),
        ]
    )
