"""Peers: what one might use instead of these surrogates, fitted on the same samples and timed as carefully.

Comparisons only; nothing else in the library needs them. Extra packages: ``pip install casadi_contact[peers]``.
"""

from casadi_contact.benchmark.peers.candidates import FAMILIES, peer_candidates

__all__ = ["FAMILIES", "peer_candidates"]
