"""Whether a walk's numbers are of a knee: units and signs that would be solved, and be wrong.

Velocities and arms are told from lengths, with v = dL/dt and, where nothing but flexion moved, v = -arm·d(rz)/dt. Of
four measured walks the first correlates by 0.996 and more in every muscle; the second by 0.98 in the muscles that cross
the knee alone, and by 0.8 to 0.9 in those that hip or ankle move too.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence

import numpy as np

from casadi_contact.conventions import Array
from casadi_contact.quantities import three_digits, two_digits
from problems.muscle_contact.knee_coordinates import coordinate_unit, is_translation

_LONGEST_M = 2.0  # of a muscle with its tendon; sartorius has 0.6 m
_LARGEST_ARM_M = 0.3
_LARGEST_COSINE = 1.5  # of a muscle's direction; curves that are differenced exceed 1 a little
_LEAST_LOAD = {"N": 10.0, "Nm": 1.5}  # that a leg's largest reach; over weight and mass they are about 1 and 0.5
_LARGEST_LOAD = {"N": np.inf, "Nm": 1e3}
_SWINGING_LEG_N = 200.0  # pulls less at the knee: in walking 60 to 80 N
_MOVES_M = 0.002  # less travel tells nothing of velocity
_FEWEST_FRAMES = 5  # to compare rates of two curves by
_FEWEST_OF_RATES = 10  # to tell a rate itself from: of true velocities at 6 frames a cycle hardly any agree with it
_ARM_M = 0.01  # less, and other coordinates move the muscle more
_AGREES, _CONTRADICTS = 0.5, -0.8
# Muscles as the usual leg models name them, by where they cross a right knee: their arms about this coordinate are
# larger than those of the others.
_SIDES = {
    "knee_adduction": (
        ("grac", "sar", "semimem", "semiten", "gasmed", "med_gas"),
        ("bf", "bifem", "gaslat", "lat_gas", "tfl"),
    ),
    "knee_rotation": (("bf", "bifem"), ("semimem", "semiten", "grac")),
}


def check_lengths(what: str, names: Sequence[str], lengths_m: Array) -> None:
    """ValueError for musculotendon lengths (n, m) that are not positive, or longer than a leg's; what: the walk or file
    that they are of."""
    low, high = lengths_m.min(axis=0), lengths_m.max(axis=0)
    for name, least, most in zip(names, low, high, strict=True):
        if least <= 0.0 or most > _LONGEST_M:
            raise ValueError(
                f"{what}: {name} is {least:g} to {most:g} m long, expected more than 0 and at most "
                f"{_LONGEST_M:g} m: are lengths in mm?"
            )


def check_arms(walk: str, names: Sequence[str], arms: Mapping[str, Array]) -> None:
    """ValueError for arms (n, m) by coordinate that are no metres or direction cosines, and where muscles would push
    the femur off the tibia."""
    for coordinate, table in arms.items():
        frame, muscle = divmod(int(np.abs(table).argmax()), len(names))
        largest, limit = float(table[frame, muscle]), _LARGEST_COSINE if is_translation(coordinate) else _LARGEST_ARM_M
        if abs(largest) > limit:
            meant = f"direction cosines, at most {limit:g}" if is_translation(coordinate) else f"m, at most {limit:g}"
            raise ValueError(
                f"walk {walk}: the arm of {names[muscle]} about {coordinate} is {largest:g} at frame {frame}, expected "
                f"{meant}: is it in mm?"
            )
    if "knee_ty" in arms and (pull := float(arms["knee_ty"].mean())) > 0.0:
        raise ValueError(
            f"walk {walk}: arms about knee_ty are {pull:+.2g} in the mean, expected negative ones: arm = "
            "-dlength/dcoordinate, and a femur that rises lengthens what crosses the knee; turn their sign"
        )


def check_sides(walk: str, names: Sequence[str], arms: Mapping[str, Array]) -> None:
    """ValueError where muscles known to cross the knee medially and laterally turn it as if they crossed on the other
    side (arms (n, m) about adduction or rotation of the wrong sign, or of a left knee); other names tell nothing."""
    for coordinate, groups in _SIDES.items():
        known = [[k for k, name in enumerate(names) if name.lower().startswith(group)] for group in groups]
        if coordinate not in arms or not all(known):
            continue
        more, less = (float(arms[coordinate][:, of].mean()) for of in known)
        if more < less:
            more_names, less_names = (", ".join(names[k] for k in of) for of in known)
            raise ValueError(
                f"walk {walk}: arms about {coordinate} are {more:+.2g} m in the mean of {more_names} and "
                f"{less:+.2g} m of {less_names}, expected the first larger: turn their sign, or mirror a left knee"
            )


def check_loads(walk: str, loads: Mapping[str, Array]) -> None:
    """ValueError for loads (n,) by coordinate that are too small or too large for a body, in N and N·m; RuntimeWarning
    for a knee_ty that never presses as hard as it pulls, and pulls harder than a leg that swings."""
    for unit in ("N", "Nm"):
        curves = {name: float(np.abs(curve).max()) for name, curve in loads.items() if coordinate_unit(name) == unit}
        largest = max(curves.values(), default=0.0)
        reached = f"{two_digits(largest)} in {', '.join(curves)}"
        said = f"walk {walk}: inverse dynamics reaches {reached}, expected {unit} of a body"
        if 0.0 < largest < _LEAST_LOAD[unit]:
            raise ValueError(f"{said}: is it over body weight or mass? Multiply by it")
        if largest > _LARGEST_LOAD[unit]:
            raise ValueError(f"{said}, at most {_LARGEST_LOAD[unit]:g}: is it in N·mm?")
    vertical = loads.get("knee_ty", np.zeros(1))
    if -vertical.min() > max(_SWINGING_LEG_N, vertical.max()):
        pulled_n, pressed_n = three_digits(-vertical.min()), three_digits(max(vertical.max(), 0.0))
        warnings.warn(
            f"walk {walk}: knee_ty pulls the knee apart by up to {pulled_n} N and never presses it by more than "
            f"{pressed_n} N, expected the ground's push to be positive: if this is no kick, turn the signs of inverse "
            "dynamics",
            RuntimeWarning,
            stacklevel=2,
        )


def check_velocities(walk: str, names: Sequence[str], time_s: Array, lengths_m: Array, velocities: Array) -> None:
    """ValueError for velocities (n, m) [m/s] that are not how lengths (n, m) change, reversed ones and other units;
    zero is taken for muscles that are meant to be slow, and anything at fewer frames than tell rates."""
    if len(time_s) < _FEWEST_OF_RATES:
        return
    rates = np.gradient(lengths_m, time_s, axis=0)
    for muscle in np.flatnonzero(np.ptp(lengths_m, axis=0) > _MOVES_M).tolist():
        given, rate = velocities[:, muscle], rates[:, muscle]
        if not given.any():
            continue
        share = float(given @ rate / (rate @ rate))
        if _together(given, rate) < _AGREES or not 0.5 < share < 2.0:
            cure = "turn their sign, lengthening is positive" if share < 0.0 else "give m/s, lengthening positive"
            raise ValueError(
                f"walk {walk}: velocities of {names[muscle]} are {share:.2g} times dlength/dt (correlation "
                f"{_together(given, rate):.2f}), expected dlength/dt: {cure}"
            )


def check_flexion_arms(
    walk: str, names: Sequence[str], time_s: Array, rz: Array, lengths_m: Array, arms: Array
) -> None:
    """ValueError where most muscles shorten while their arms (n, m) about rz say that they lengthen, RuntimeWarning
    where single ones do."""
    if len(time_s) < _FEWEST_FRAMES:
        return
    rates, by_flexion = np.gradient(lengths_m, time_s, axis=0), -arms * np.gradient(rz, time_s)[:, None]
    told = (np.abs(arms).mean(axis=0) > _ARM_M) & (np.ptp(lengths_m, axis=0) > _MOVES_M) & by_flexion.any(axis=0)
    agreement = {names[k]: _together(by_flexion[:, k], rates[:, k]) for k in np.flatnonzero(told).tolist()}
    if agreement and np.median(list(agreement.values())) < -_AGREES:
        raise ValueError(
            f"walk {walk}: as rz changes, muscles shorten that lengthen by their arms about knee_flexion (correlation "
            f"{np.median(list(agreement.values())):.2f} in the middle), expected arm = -dlength/drz with flexion "
            "negative: turn the sign of these arms or of rz"
        )
    for name, together in agreement.items():
        if together < _CONTRADICTS:
            warnings.warn(
                f"walk {walk}: {name} shortens where its arm about knee_flexion says that it lengthens (correlation "
                f"{together:.2f}): is that arm's sign right, or do hip or ankle move the muscle?",
                RuntimeWarning,
                stacklevel=2,
            )


def _together(one: Array, other: Array) -> float:
    """Correlation of curves (n,) about zero."""
    size = float(np.linalg.norm(one) * np.linalg.norm(other))
    return float(one @ other) / size if size > 0.0 else 0.0
