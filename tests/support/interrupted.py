"""Ctrl-C that is pressed while CasADi evaluates a function."""

import signal
from contextlib import contextmanager

import casadi as ca

from casadi_contact.core import interrupts


class Interrupted(ca.Callback):
    """A function of vectors of these sizes in which Ctrl-C is pressed, or something else fails."""

    def __init__(self, error=KeyboardInterrupt, sizes=(1,), answer=1):
        ca.Callback.__init__(self)
        self.error, self.sizes, self.answer = error, sizes, answer
        self.construct("interrupted", {"enable_fd": True})

    def get_n_in(self):
        return len(self.sizes)

    def get_sparsity_in(self, i):
        return ca.Sparsity.dense(self.sizes[i], 1)

    def get_sparsity_out(self, i):
        return ca.Sparsity.dense(self.answer, 1)

    def eval(self, arguments):
        if self.error is KeyboardInterrupt:
            signal.raise_signal(signal.SIGINT)
        raise self.error


@contextmanager
def interrupts_remembered(monkeypatch):
    """Within, Ctrl-C is what it is to a command line."""
    monkeypatch.setattr(interrupts, "_interrupted", False)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        interrupts.remember_interrupts()
        yield
    finally:
        signal.signal(signal.SIGINT, before)
