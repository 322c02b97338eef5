"""Contact in optimisation problems: variables, starts and constraints that IPOPT gets along with, and its settings."""

from casadi_contact.optimisation.contact_frames import ContactFrames, pose_in_space
from casadi_contact.optimisation.contact_in_opti import ContactInOpti
from casadi_contact.optimisation.ipopt import IpoptOutcome, ipopt_options
from casadi_contact.optimisation.joint_mechanics import angular_velocity_map, generalised_forces
from casadi_contact.optimisation.pose_range import middle_pose, pose_bounds
from casadi_contact.optimisation.scaling import KNEE_STEPS, pose_steps
from casadi_contact.optimisation.starts import (
    press_together,
    settle_in_range,
    shear_free_poses,
    start_or_default,
    touching,
)
from casadi_contact.optimisation.total_wrench import total_selection, wrench_function
from casadi_contact.statics.leaps import leaps, leaps_in_words

__all__ = [
    "KNEE_STEPS",
    "ContactFrames",
    "ContactInOpti",
    "IpoptOutcome",
    "angular_velocity_map",
    "generalised_forces",
    "ipopt_options",
    "leaps",
    "leaps_in_words",
    "middle_pose",
    "pose_bounds",
    "pose_in_space",
    "pose_steps",
    "press_together",
    "settle_in_range",
    "shear_free_poses",
    "start_or_default",
    "total_selection",
    "touching",
    "wrench_function",
]
