"""Ctrl-C and SIGTERM end a command line with its exit status and no traceback."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager

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


def remember_interrupts() -> None:
    """From here on Ctrl-C raises KeyboardInterrupt, and is remembered: C++ that calls Python may swallow it."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _raise)


def was_interrupted() -> bool:
    """Whether Ctrl-C was pressed since `remember_interrupts`, and in work that `terminated_as_interrupted`."""
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
