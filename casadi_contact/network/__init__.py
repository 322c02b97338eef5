"""A network as plain arrays, what it learns, its activations, and the joint root load of several spots."""

from casadi_contact.network.network import Network, PartsRegression, Regression, size_text

__all__ = ["Network", "PartsRegression", "Regression", "size_text"]
