"""What falls, on what, and how it is braked: plain data, which both simulations take."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.optimisation.joint_mechanics import total_selection
from casadi_contact.surrogate.base import Surrogate


@dataclass(frozen=True)
class Drop:
    """A moving body of a mass and of one moment of inertia for all axes, pushed and braked where its frame lies.

    lift_mm: above the pose that it starts from; damping acts against velocity and angular velocity.
    """

    surrogate: Surrogate
    lift_mm: float = 0.3
    mass_kg: float = 1.0
    inertia_kgm2: float = 1e-3
    push_n: tuple[float, float, float] = (0.0, -400.0, 0.0)
    damping_ns_per_m: float = 200.0
    damping_nms_per_rad: float = 0.5
    duration_s: float = 0.05
    points: int = 201
    start_pose: Array = field(init=False)

    def __post_init__(self) -> None:
        self.surrogate.scene.pose_space.check_whole("a body that falls")
        positive = (self.mass_kg, self.inertia_kgm2, self.duration_s)
        if not (np.isfinite(positive).all() and min(positive) > 0.0):
            raise ValueError(f"mass, inertia and duration are {positive}, expected positive numbers")
        if not np.isfinite([self.lift_mm, *self.push_n]).all():
            raise ValueError(f"lift is {self.lift_mm} mm, push {self.push_n} N, expected finite numbers")
        if self.points < 2:
            raise ValueError(f"points is {self.points}, expected 2 or more")
        pose = np.array(self.surrogate.learned_pose())
        pose[1] += self.lift_mm
        object.__setattr__(self, "start_pose", pose)

    @property
    def times_s(self) -> Array:
        """Times of both results."""
        return np.linspace(0.0, self.duration_s, self.points)

    def settings(self) -> dict[str, object]:
        """Plain values for another process."""
        return {
            "total": total_selection(self.surrogate.load_names, self.surrogate.patch_names).tolist(),
            "start_pose": self.start_pose.tolist(),
            "mass_kg": self.mass_kg,
            "inertia_kgm2": self.inertia_kgm2,
            "push_n": list(self.push_n),
            "damping_ns_per_m": self.damping_ns_per_m,
            "damping_nms_per_rad": self.damping_nms_per_rad,
            "times_s": self.times_s.tolist(),
        }
