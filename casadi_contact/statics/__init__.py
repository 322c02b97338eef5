"""Statics: the pose at which a contact model carries wanted loads [EF15 §2.4] by Newton's method or damped dynamics."""

from casadi_contact.contact.approach import advance_to_contact, rotate_about_anchors
from casadi_contact.statics.continuity import Motion, follow, unstable_equilibria
from casadi_contact.statics.equilibrium import Equilibrium
from casadi_contact.statics.leaps import leaps, leaps_in_words
from casadi_contact.statics.relax import relax
from casadi_contact.statics.sensitive import SensitiveDirections, sensitive_directions
from casadi_contact.statics.settle import SettleReport, settle

__all__ = [
    "Equilibrium",
    "Motion",
    "SensitiveDirections",
    "SettleReport",
    "advance_to_contact",
    "follow",
    "leaps",
    "leaps_in_words",
    "relax",
    "rotate_about_anchors",
    "sensitive_directions",
    "settle",
    "unstable_equilibria",
]
