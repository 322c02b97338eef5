"""The measured speed-accuracy front: train its sizes, measure it, choose from it."""

from casadi_contact.front.measure import chart, measure
from casadi_contact.front.sizes import Sized, planned, train_sizes

__all__ = ["Sized", "chart", "measure", "planned", "train_sizes"]
