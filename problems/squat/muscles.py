"""The muscles of one leg in the sagittal plane.

Eight muscle groups with constant arms: Gerritsen KGM, van den Bogert AJ, Hulliger M, Zernicke RF. Intrinsic muscle
properties facilitate locomotor control: a computer simulation study. Motor Control 2 (1998) 206-220, as used with the
same numbers by Ackermann and van den Bogert, J Biomech 43 (2010) 1055-1060. Hamstrings and gastrocnemius are divided
into a medial and a lateral muscle in the ratio of greatest forces of Arnold et al., Ann Biomed Eng 38 (2010) 269-279
(semimembranosus with semitendinosus 1460 N, biceps femoris 700 N; gastrocnemii 1310 and 610 N), because the contact
tells these apart. Their arms in the frontal plane, and that of the vasti, are of the size of the same model's.

    length = length at zero angles - hip·η - knee·(-κ) - ankle·δ        [m]

with hip flexion η, knee flexion κ and dorsiflexion δ; a positive knee arm extends. Tendons are rigid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.conventions import Array

QUADRICEPS, THIGH, SHANK = "quadriceps", "thigh", "shank"  # what a muscle that crosses the knee pulls along


@dataclass(frozen=True)
class LegMuscle:
    """force_n: greatest isometric; fibre_m: optimal; tendon_m: slack; length_m: at zero angles; arms [m]: hip flexion,
    knee extension, dorsiflexion, and adduction of the femur; along: what it pulls along where it crosses the knee."""

    force_n: float
    fibre_m: float
    tendon_m: float
    length_m: float
    hip_m: float = 0.0
    knee_m: float = 0.0
    ankle_m: float = 0.0
    frontal_m: float = 0.0
    along: str | None = None


_MEDIAL_HAMSTRINGS, _MEDIAL_GASTROCNEMIUS = 1460.0 / 2160.0, 1310.0 / 1920.0


def _hamstrings(share: float, frontal_m: float) -> LegMuscle:
    return LegMuscle(share * 3000.0, 0.104, 0.334, 0.383, -0.072, -0.034, 0.0, frontal_m, THIGH)


def _gastrocnemius(share: float, frontal_m: float) -> LegMuscle:
    return LegMuscle(share * 3000.0, 0.055, 0.420, 0.487, 0.0, -0.020, -0.053, frontal_m, SHANK)


MUSCLES = {
    "iliopsoas": LegMuscle(1500.0, 0.102, 0.142, 0.248, hip_m=0.050),
    "glutei": LegMuscle(3000.0, 0.200, 0.157, 0.271, hip_m=-0.062),
    "medial hamstrings": _hamstrings(_MEDIAL_HAMSTRINGS, 0.020),
    "biceps femoris": _hamstrings(1.0 - _MEDIAL_HAMSTRINGS, -0.030),
    "rectus femoris": LegMuscle(1200.0, 0.081, 0.398, 0.474, 0.034, 0.050, along=QUADRICEPS),
    "vasti": LegMuscle(7000.0, 0.093, 0.223, 0.271, knee_m=0.042, frontal_m=-0.006, along=QUADRICEPS),
    "medial gastrocnemius": _gastrocnemius(_MEDIAL_GASTROCNEMIUS, 0.020),
    "lateral gastrocnemius": _gastrocnemius(1.0 - _MEDIAL_GASTROCNEMIUS, -0.020),
    "soleus": LegMuscle(4000.0, 0.055, 0.245, 0.284, ankle_m=-0.053),
    "tibialis anterior": LegMuscle(2500.0, 0.082, 0.317, 0.381, ankle_m=0.037),
}


def column(name: str) -> Array:
    """A number of all muscles (10,) by its field's name."""
    return np.array([getattr(muscle, name) for muscle in MUSCLES.values()])
