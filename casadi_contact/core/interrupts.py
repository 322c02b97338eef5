"""Ctrl-C and SIGTERM end a command line with its exit status and no traceback, also while modules are imported.

This file imports nothing that takes time.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType

INTERRUPTED = 130  # exit status of what Ctrl-C ended
_interrupted = False


def is_interrupt(error: BaseException) -> bool:
    """Whether an error is Ctrl-C, or came of it: in a loop that numba compiled it arrives as a SystemError."""
    known: list[BaseException] = []
    cause: BaseException | None = error
    while cause is not None and cause not in known:
        if isinstance(cause, KeyboardInterrupt):
            return True
        known.append(cause)
        cause = cause.__cause__ or cause.__context__
    return False


def end_on_interrupt() -> None:
    """From here on an uncaught interrupt ends Python with `INTERRUPTED`.

    Until `raise_interrupts` Ctrl-C ends Python at once: a KeyboardInterrupt raised during imports may be lost, because
    libraries try imports under a bare ``except``.
    """
    sys.excepthook = _end
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end_at_once)


def raise_interrupts() -> None:
    """From here on Ctrl-C raises KeyboardInterrupt, and is remembered: C++ that calls Python may swallow it."""
    if signal.getsignal(signal.SIGINT) is _end_at_once:
        signal.signal(signal.SIGINT, _raise)


def was_interrupted() -> bool:
    """Whether Ctrl-C was pressed since `raise_interrupts`, and in work that `terminated_as_interrupted`."""
    return _interrupted


@contextmanager
def terminated_as_interrupted() -> Iterator[None]:
    """In the block, SIGTERM (`kill`, a batch system) acts like Ctrl-C: workers end first. For the main thread."""
    before = signal.signal(signal.SIGTERM, _raise)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _raise(*_: object) -> None:
    global _interrupted
    _interrupted = True
    raise KeyboardInterrupt


def _end_at_once(*_: object) -> None:
    os._exit(INTERRUPTED)


def _end(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    if is_interrupt(error):
        sys.exit(INTERRUPTED)
    sys.__excepthook__(kind, error, trace)
