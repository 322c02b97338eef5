"""casadi_contact: neural surrogates of deformable joint contact as CasADi functions with exact derivatives.

The method is that of Eskinazi and Fregly, "Surrogate modeling of deformable joint contact using artificial neural
networks" (2015); see README.md.
"""

from casadi_contact.benchmark import choose
from casadi_contact.contact import CallableModel, ElasticFoundation, RayCastFoundation
from casadi_contact.optimisation import ContactFrames, ContactInOpti
from casadi_contact.scenes import Scene, load_scene
from casadi_contact.statics import relax, sensitive_directions, settle
from casadi_contact.structures import load_surrogate
from casadi_contact.verification import refine, verify

__all__ = [
    "CallableModel",
    "ContactFrames",
    "ContactInOpti",
    "ElasticFoundation",
    "RayCastFoundation",
    "Scene",
    "choose",
    "load_scene",
    "load_surrogate",
    "refine",
    "relax",
    "sensitive_directions",
    "settle",
    "verify",
]
