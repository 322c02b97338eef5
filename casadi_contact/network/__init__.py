"""A network as plain arrays, what it learns, and its activations."""

from casadi_contact.network.network import Network, Regression, size_text

__all__ = ["Network", "Regression", "size_text"]
