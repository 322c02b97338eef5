"""Stability where methods fail: one table, method by failure. Run ``python -m problems.studies.stability --help``."""
