"""A component that falls onto another, once by OpenSim and once by CasADi, on the same contact kernel.

Run ``python -m problems.opensim_drop --help``.
"""
