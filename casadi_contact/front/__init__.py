"""The measured speed-accuracy front: train its sizes, measure it, choose from it."""

from casadi_contact.front.choose import Choice, Offer, choose
from casadi_contact.front.measure import chart, measure
from casadi_contact.front.sizes import Sized, planned, train_sizes
from casadi_contact.front.speed import speed

__all__ = ["Choice", "Offer", "Sized", "chart", "choose", "measure", "planned", "speed", "train_sizes"]
