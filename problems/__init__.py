"""Whole programs on contact models, one file each: ``python -m problems.NAME`` writes into results/NAME.

The docstring states the problem as formulas, `main` solves it, prints a table and draws one picture. `scenes` holds
scene files of real meshes, `studies` the measurements that the documentation cites.
"""
