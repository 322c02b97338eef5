"""Contact in optimisation problems: variables, starts and constraints that IPOPT gets along with, and its settings."""

from casadi_contact.optimisation.contact_frames import ContactFrames, pose_in_space
from casadi_contact.optimisation.contact_in_opti import ContactInOpti
from casadi_contact.optimisation.ipopt import IpoptOutcome, ipopt_options
from casadi_contact.optimisation.joint_mechanics import (
    angular_velocity_map,
    generalised_forces,
    total_selection,
    whole_wrench,
    wrench_function,
)
from casadi_contact.optimisation.knee import shear_free_poses
from casadi_contact.optimisation.starts import (
    KNEE_STEPS,
    middle_pose,
    pose_bounds,
    pose_steps,
    press_together,
    settle_in_range,
    start_or_default,
    touching,
)
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
    "whole_wrench",
    "wrench_function",
]
