"""Finite elements: the fixed body as an elastic solid on a rigid back, condensed onto its contact surface.

`FiniteElements` is a contact model like any other. It stands here until the library has room for it.
"""
