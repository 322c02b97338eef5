"""Stability where methods fail: one table, method by failure, measured.

Run ``python -m problems.studies.stability --help``.
"""
