"""Why muscles pull against each other more than balance asks: rules that know no measured contact force.

- Heads of one muscle have one nerve and share an activation.
- Antagonists keep both sides of the knee closed. Balance alone lets the adducting moment of mid-stance open the lateral
  side (Schipplein and Andriacchi, J Orthop Res 9 (1991) 113-119). Each side carries what keeps it loaded when the load
  knee_ty passes Δ beside its place: N_side >= knee_ty·Δ/w, with w the distance of the sides [mm].
- The calf works for the ankle. Its moment follows from the knee's own inverse dynamics at the shank's length L, without
  weight and inertia of shank and foot: M = L·knee_tx - knee_flexion [N·m], plantarflexion positive. Gastrocnemius and
  soleus give at least this, r·(F_gas + F_sol) >= M; dorsiflexors may pull against them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from casadi_contact.contact.symbolic import SymbolicContact
from casadi_contact.core.conventions import Array
from casadi_contact.optimisation.muscle_walk import MuscleWalk

SHANK_M = 0.41  # knee to ankle of the usual adult: 0.246 of 1.67 m of height
CALF_ARM_M = 0.045  # of the Achilles tendon about the ankle
SOLEUS_N = 3585.9 * np.cos(np.deg2rad(28.3))  # along its tendon (Arnold et al., Ann Biomed Eng 38 (2010) 269-279)
_WITHOUT_ANKLE = "leave the ankle out (ankle=False, in muscle_contact --no-ankle)"
_HEADS = ("vas", "gas")  # vastus and gastrocnemius, as their names begin or end in the usual models (vasint, med_gas_r)


def heads(names: Sequence[str]) -> list[tuple[int, int]]:
    """Pairs of columns of muscles that are heads of the same one: the vasti, and both heads of gastrocnemius.

    Raises ValueError where no name tells of any.
    """
    groups = [[column for column, name in enumerate(names) if part in name.lower()] for part in _HEADS]
    pairs = [(group[0], other) for group in groups for other in group[1:]]
    if not pairs:
        raise ValueError(
            f"muscles are {', '.join(names)}: no heads of a vastus or gastrocnemius, let each be driven alone "
            "(share_heads=False, in muscle_contact --no-share-heads)"
        )
    return pairs


def calf(names: Sequence[str]) -> list[int]:
    """Columns of the heads of gastrocnemius; raises ValueError where there are none."""
    columns = [column for column, name in enumerate(names) if "gas" in name.lower()]
    if not columns:
        raise ValueError(f"muscles are {', '.join(names)}: no gastrocnemius, {_WITHOUT_ANKLE}")
    return columns


def ankle_moment(walk: MuscleWalk, shank_m: float = SHANK_M) -> Array:
    """Plantarflexion moment (n,) [N·m] that inverse dynamics of the knee implies at the ankle.

    Raises ValueError for a walk without knee_tx and knee_flexion, and a length that no shank has.
    """
    walk.check_has(("knee_tx", "knee_flexion"))
    if not 0.2 <= shank_m <= 0.6:
        raise ValueError(f"shank is {shank_m} m long, expected 0.2 to 0.6 m from knee to ankle")
    return np.asarray(shank_m * walk.loads["knee_tx"] - walk.loads["knee_flexion"])


def closed_sides(model: SymbolicContact, knee_ty: Array, margin_mm: float) -> Array:
    """Least root loads (n, patches) that keep every side loaded though the load passes margin_mm beside its place."""
    if not 0.0 <= margin_mm <= 44.0:
        raise ValueError(f"margin is {margin_mm} mm, expected 0 to 44, the distance of a knee's sides")
    places = model.scene.anchors_mm[:, 2]
    least_n = np.maximum(knee_ty, 0.0) * margin_mm / np.ptp(places)
    return np.tile(np.sqrt(least_n / model.scene.reference_load)[:, None], (1, len(places)))
