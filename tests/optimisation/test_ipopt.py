"""What became of a solution: solved, not solved, or ended by Ctrl-C, which is no answer."""

from types import SimpleNamespace

import casadi as ca
import pytest

from casadi_contact.optimisation.ipopt import IpoptOutcome, ipopt_options
from tests.support.interrupted import Interrupted, interrupts_remembered


def test_a_solution_that_ctrl_c_ended_is_no_unsolved_frame():
    x = ca.MX.sym("x")
    solver = ca.nlpsol("valley", "ipopt", {"x": x, "f": ca.exp(x) - 2.0 * x}, ipopt_options())
    solver(x0=3.0)
    assert IpoptOutcome.of(solver).solved
    stopped = SimpleNamespace(stats=lambda: {"return_status": "User_Requested_Stop", "iter_count": 1})
    with pytest.raises(KeyboardInterrupt):
        IpoptOutcome.of(stopped)


def test_ctrl_c_in_a_function_that_ipopt_evaluates_is_told_from_its_failure(monkeypatch):
    """CasADi makes an unsolved problem of both."""
    x = ca.MX.sym("x")
    with interrupts_remembered(monkeypatch):
        for error in (ValueError, KeyboardInterrupt):
            function = Interrupted(error)
            options = {**ipopt_options(), "error_on_fail": False}
            solver = ca.nlpsol("broken", "ipopt", {"x": x, "f": function(x) + x**2}, options)
            solver(x0=1.0)
            if error is ValueError:
                assert not IpoptOutcome.of(solver).solved
            else:
                with pytest.raises(KeyboardInterrupt):
                    IpoptOutcome.of(solver)
