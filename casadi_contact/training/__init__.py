"""Fitting networks to samples: batch Levenberg-Marquardt, stopping, growth, checkpoints (§2.6)."""

from casadi_contact.training.fit import Fit, fit
from casadi_contact.training.settings import TrainingSettings
from casadi_contact.training.side_by_side import fit_all

__all__ = ["Fit", "TrainingSettings", "fit", "fit_all"]
