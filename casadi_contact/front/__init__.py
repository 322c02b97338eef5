"""The measured speed-accuracy front: train its sizes, measure it, choose from it."""

from casadi_contact.front.choose import Choice, Offer, choose
from casadi_contact.front.measure import chart, measure
from casadi_contact.front.sizes import Sized, planned, train_sizes

__all__ = ["Choice", "Offer", "Sized", "chart", "choose", "measure", "planned", "train_sizes"]
