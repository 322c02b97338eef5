"""Finite elements: the fixed body as an elastic solid on a rigid back, condensed onto its contact surface."""
