"""Verification: is the solution that a surrogate led to one of the contact model as well, and if not, refine."""

from casadi_contact.contact.elements.sharp_edges import share_at_sharp_edges
from casadi_contact.verification.open_edges import share_beyond_open_edges
from casadi_contact.verification.refine import Refinement, Solve, refine
from casadi_contact.verification.uncertain_load import uncertain_load_shares, uncertain_load_words, uncounted_share
from casadi_contact.verification.verdict import Verdict, judge, own_model
from casadi_contact.verification.verify import Verification, verify
from casadi_contact.verification.walls import share_on_walls, share_outside_patches

__all__ = [
    "Refinement",
    "Solve",
    "Verdict",
    "Verification",
    "judge",
    "own_model",
    "refine",
    "share_at_sharp_edges",
    "share_beyond_open_edges",
    "share_on_walls",
    "share_outside_patches",
    "uncertain_load_shares",
    "uncertain_load_words",
    "uncounted_share",
    "verify",
]
