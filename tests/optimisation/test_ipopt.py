"""What became of a solution: solved, not solved, or ended by Ctrl-C, which is no answer."""

import casadi as ca
import pytest

from casadi_contact.optimisation.ipopt import IpoptOutcome, ipopt_options
from tests.support.interrupted import Interrupted, interrupts_remembered


class Stopping(ca.Callback):
    """Asks IPOPT to stop after its first iteration, as CasADi does for Ctrl-C."""

    def __init__(self):
        ca.Callback.__init__(self)
        self.construct("stopping")

    def get_n_in(self):
        return ca.nlpsol_n_out()

    def get_n_out(self):
        return 1

    def get_sparsity_in(self, i):
        return ca.Sparsity.dense(1, 1) if ca.nlpsol_out(i) in ("x", "f", "lam_x") else ca.Sparsity(0, 0)

    def eval(self, arguments):
        return [1]


def solver_of_a_valley(**options):
    x = ca.MX.sym("x")
    return ca.nlpsol("valley", "ipopt", {"x": x, "f": ca.exp(x) - 2.0 * x}, {**ipopt_options(), **options})


def test_a_solution_that_ctrl_c_ended_is_no_unsolved_frame():
    solver = solver_of_a_valley()
    solver(x0=3.0)
    assert IpoptOutcome.of(solver).solved
    stopping = Stopping()
    stopped = solver_of_a_valley(iteration_callback=stopping)
    stopped(x0=3.0)
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
