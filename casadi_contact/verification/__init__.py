"""Verification: is the solution that a surrogate led to one of the contact model as well, and if not, refine."""

from casadi_contact.verification.refine import Refinement, Solve, refine
from casadi_contact.verification.verify import Verification, verify

__all__ = ["Refinement", "Solve", "Verification", "refine", "verify"]
