"""Optimisation problems on contact surrogates, a folder each.

problem.py builds it as plain data, solve.py solves it, report.py draws and writes, __main__.py is the command
``python -m problems.NAME``, which writes into results/NAME.
"""

import sys

from casadi_contact.core.interrupts import end_on_interrupt

if sys.argv[:1] == ["-m"]:  # Python's word for a command whose modules it still imports
    end_on_interrupt()
