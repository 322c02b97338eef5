"""Assemblies: several contacts, ligaments and springs between bodies, as one CasADi function of all their poses."""

from casadi_contact.assembly.assembly import Assembly
from casadi_contact.assembly.connections import Contact, Ligament, Pull, Spring
from casadi_contact.assembly.file import load_assembly, ready_assemblies
from casadi_contact.assembly.settle import SettledBodies, Settling, settle_assembly

__all__ = [
    "Assembly",
    "Contact",
    "Ligament",
    "Pull",
    "SettledBodies",
    "Settling",
    "Spring",
    "load_assembly",
    "ready_assemblies",
    "settle_assembly",
]
