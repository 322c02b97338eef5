"""Cycles that may be in other units than N, N·mm and mm, by their size alone: questions, for a joint may be unusual."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from casadi_contact.conventions import Array
from casadi_contact.quantities import FORCE, TORQUE, of_kind, two_digits
from casadi_contact.scenes.scene import Scene

_LEAST, _MOST = 0.01, 20.0  # of the scene's reference load
_LEAST_LEVER_MM = 0.05  # largest torque over largest force; levers of joints are some millimetres
_LEAST_TRAVEL_MM = 0.05  # joints slide by some millimetres
_ROUNDING_MM = 1e-6  # what stands still, or turns about its own middle, in a file of some digits


def unit_warnings(scene: Scene, wanted: Mapping[str, Array], measured: Mapping[str, Array]) -> list[str]:
    """Lines that ask about the units of a cycle's forces, torques and translations; none where these have usual sizes.

    wanted: loads and centres of pressure, measured: pose parameters, by name, each (n,).
    """
    lines = (force_unit_warning(scene, wanted), torque_unit_warning(wanted), translation_unit_warning(measured))
    return [line for line in lines if line]


def force_unit_warning(scene: Scene, wanted: Mapping[str, Array]) -> str:
    """A line where the largest force of a cycle is below a hundredth of the scene's reference load or above 20 times
    it; "" where it is not, and where all are zero. Pounds-force and percent of body weight, 4 and 7 times as small
    numbers, lie within what joints carry.

    wanted: loads and centres of pressure by name, each (n,).
    """
    largest = max((float(np.abs(wanted[name]).max()) for name in of_kind(tuple(wanted), FORCE)), default=0.0)
    share = largest / scene.reference_load
    if largest == 0.0 or _LEAST <= share <= _MOST:
        return ""
    made_for = f"where the scene's reference load is {scene.reference_load:.4g} N"
    if share < _LEAST:
        return (
            f"the largest force is {two_digits(largest)} N, {made_for}: are forces in kN or body weights? Multiply "
            "them by 1000 or by the weight in N"
        )
    return (
        f"the largest force is {float(two_digits(largest)):,.0f} N, {made_for}: are forces in mN, or converted twice? "
        "Give them in N"
    )


def torque_unit_warning(wanted: Mapping[str, Array]) -> str:
    """A line where the largest torque of a cycle is that of its largest force on a lever below 0.05 mm; "" where it is
    not, and without a force or a torque but for rounding."""
    largest = [
        max((float(np.abs(wanted[name]).max()) for name in of_kind(tuple(wanted), kind)), default=0.0)
        for kind in (FORCE, TORQUE)
    ]
    if not _ROUNDING_MM * largest[0] < largest[1] < _LEAST_LEVER_MM * largest[0]:
        return ""
    return (
        f"the largest torque is {two_digits(largest[1])} N·mm, that of the largest force on a lever of "
        f"{two_digits(largest[1] / largest[0])} mm: are torques in N·m? Multiply them by 1000"
    )


def translation_unit_warning(measured: Mapping[str, Array]) -> str:
    """A line where the measured translations of a cycle all vary by less than 0.05 mm; "" where one varies by more, and
    where none varies but for rounding."""
    travel = max((float(np.ptp(curve)) for name, curve in measured.items() if name.startswith("t")), default=0.0)
    if not _ROUNDING_MM < travel < _LEAST_TRAVEL_MM:
        return ""
    return f"measured translations vary by {two_digits(travel)} mm at most: are they in m? Multiply them by 1000"
