"""Surrogates: networks put together so that they answer like the contact model they replace."""

from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.calibration import calibrated
from casadi_contact.surrogate.info import SurrogateInfo
from casadi_contact.surrogate.load import load_surrogate, ready_surrogates
from casadi_contact.surrogate.patch import PatchSurrogate
from casadi_contact.surrogate.two_stage import TwoStageSurrogate

__all__ = [
    "PatchSurrogate",
    "Surrogate",
    "SurrogateInfo",
    "TwoStageSurrogate",
    "calibrated",
    "load_surrogate",
    "ready_surrogates",
]
