"""Peers: what one might use instead of these surrogates, fitted on the same samples and timed in the same run.

Comparisons only; nothing else in the library needs them. Extra packages: ``pip install casadi_contact[peers]``.
"""
