"""The sensitive pose parameters of a scene that leaves them out, found at its reference motion [EF15 §2.1]."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.sensitive import sensitive_directions
from casadi_contact.core.conventions import POSE_NAMES
from casadi_contact.samples.reference import Cycle, reference_poses
from casadi_contact.scenes.joint_cycle import driving_loads

_FRAMES = 21


def found_sensitive_pose(model: ContactModel, cycles: Sequence[Cycle]) -> tuple[str, ...]:
    """As many pose parameters as the scene's normal loads are made of loads, the most sensitive ones, in pose order.

    The reference pose is the first cycle's most loaded one. Raises ValueError like `reference_poses`.
    """
    poses, _ = reference_poses(model, cycles[:1], frames=_FRAMES)
    roots, _ = model.root_loads(poses[0])
    reference = poses[0][int(np.argmax((np.maximum(roots, 0.0) ** 2).sum(axis=1)))]
    found = sensitive_directions(model, reference, loads=driving_loads(model.scene))
    strongest = found.names[: len(model.scene.sensitive_loads)]
    return tuple(name for name in POSE_NAMES if name in strongest)
