"""Surrogates: networks put together so that they answer like the contact model they replace."""

from casadi_contact.structures.base import Surrogate
from casadi_contact.structures.calibration import with_trust
from casadi_contact.structures.info import SurrogateInfo
from casadi_contact.structures.load import load_surrogate, ready_surrogates
from casadi_contact.structures.patch.surrogate import PatchSurrogate
from casadi_contact.structures.registry import STRUCTURES
from casadi_contact.structures.two_stage.surrogate import TwoStageSurrogate

__all__ = [
    "STRUCTURES",
    "PatchSurrogate",
    "Surrogate",
    "SurrogateInfo",
    "TwoStageSurrogate",
    "load_surrogate",
    "ready_surrogates",
    "with_trust",
]
