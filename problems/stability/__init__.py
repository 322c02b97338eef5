"""Stability where methods fail: one table, method by failure, measured (``python -m problems.stability --help``)."""
