"""Centres of pressure of a scene: where its total force meets the plane across the direction of pressing.

The plane goes through the fixed origin. With the force F along axis a, and T = c × F about the origin, the centre has
the coordinate c_b = ε_kba·T_k/F_a along each other axis b, k being the third: for a knee, pressed along y,

    cop_ap = cop_x = Tz/Fy,    cop_ml = cop_z = -Tx/Fy    [mm]
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from casadi_contact.scenes.normal_load import NormalLoad

_AXES = "xyz"
_ANATOMICAL = {"cop_ap": "cop_x", "cop_ml": "cop_z"}  # of a joint that is pressed along y


@dataclass(frozen=True)
class CentreOfPressure:
    """One coordinate, along axis 0 (x), 1 or 2: sign·T/F [mm] of the total force F and torque T by these names.

    pressing: the sign of F where the body is pressed.
    """

    axis: int
    force: str
    torque: str
    sign: float
    pressing: float

    @property
    def made_of(self) -> tuple[str, str]:
        """Components of the total wrench."""
        return self.force, self.torque


def centre_of_pressure(name: str, normals: Sequence[NormalLoad]) -> CentreOfPressure | None:
    """The centre of pressure of this name ("cop_x", "cop_ap"; "_mm" may follow), None where the name is another's.

    Raises ValueError for a coordinate that the scene's normal loads leave without meaning.
    """
    name = name.removesuffix("_mm")
    if not name.startswith("cop_"):
        return None
    pressed = {(normal.component, normal.sign) for normal in normals if normal.component is not None}
    axis, pressing = next(iter(pressed)) if len(pressed) == 1 else (None, 0.0)
    if axis is None:
        raise ValueError(f"{name}: the scene's patches are not pressed in one direction, expected forces and torques")
    a = _AXES.index(axis[-1])
    known = {f"cop_{_AXES[b]}": b for b in range(3) if b != a}
    known |= {alias: known[of] for alias, of in _ANATOMICAL.items() if a == 1}
    if name not in known:
        raise ValueError(
            f"unknown centre of pressure {name!r} of a scene pressed along {axis}, expected {', '.join(known)}"
        )
    b = known[name]
    k = 3 - a - b
    return CentreOfPressure(b, axis, f"T{_AXES[k]}", 1.0 if (b - k) % 3 == 1 else -1.0, pressing)
