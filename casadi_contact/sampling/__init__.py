"""Sampling: envelopes, domains D1 to D7, and drawing samples of a contact model [EF15 §2.2-2.4, §3.3]."""

from casadi_contact.sampling.chunk import plan_chunks
from casadi_contact.sampling.domains import Block, plan_domains
from casadi_contact.sampling.draw import (
    MODELS,
    check_rejection_rate,
    draw_samples,
    elastic_foundations,
    foundations,
    model_name_of,
    model_pair,
    models_identity,
    models_of,
    settings_of,
    teacher_of,
)
from casadi_contact.sampling.envelopes import Envelopes
from casadi_contact.sampling.hammersley import hammersley
from casadi_contact.sampling.reference import ReferenceMotion, ReferenceReport, reference_motion, reference_poses
from casadi_contact.sampling.sample_point import SamplePoint
from casadi_contact.sampling.sensitive_pose import found_sensitive_pose
from casadi_contact.sampling.settings import PAPER_COUNTS, SamplingSettings

__all__ = [
    "MODELS",
    "PAPER_COUNTS",
    "Block",
    "Envelopes",
    "ReferenceMotion",
    "ReferenceReport",
    "SamplePoint",
    "SamplingSettings",
    "check_rejection_rate",
    "draw_samples",
    "elastic_foundations",
    "found_sensitive_pose",
    "foundations",
    "hammersley",
    "model_name_of",
    "model_pair",
    "models_identity",
    "models_of",
    "plan_chunks",
    "plan_domains",
    "reference_motion",
    "reference_poses",
    "settings_of",
    "teacher_of",
]
