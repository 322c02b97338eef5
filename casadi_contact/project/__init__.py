"""A project: its folder of results, how much work it takes, its samples, and its networks."""

from casadi_contact.project.project import (
    Project,
    alone,
    built_in_motion,
    cycle_files,
    has_motion,
    motion_at_hand,
    poses_at_hand,
    project_surrogates,
    read_motion,
    reference_motion_cycles,
    shipped_surrogate,
    shipped_surrogates,
    surrogates_at_hand,
    surrogates_made,
    walks,
)

__all__ = [
    "Project",
    "alone",
    "built_in_motion",
    "cycle_files",
    "has_motion",
    "motion_at_hand",
    "poses_at_hand",
    "project_surrogates",
    "read_motion",
    "reference_motion_cycles",
    "shipped_surrogate",
    "shipped_surrogates",
    "surrogates_at_hand",
    "surrogates_made",
    "walks",
]
