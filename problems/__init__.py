"""Optimisation problems on contact surrogates, a folder each.

problem.py builds it as plain data, solve.py solves it, report.py draws and writes, __main__.py is the command
``python -m problems.NAME``, which writes into results/NAME.
"""
