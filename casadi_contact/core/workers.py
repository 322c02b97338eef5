"""Workers for long work: one process per core, or the caller's executor."""

import os
import signal
import threading
import warnings
from collections.abc import Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import contextmanager
from typing import Any

from loky import ProcessPoolExecutor, cpu_count

from casadi_contact.core.machine import blas_environment
from casadi_contact.core.threads import at_most_threads


class _OwnPool(ProcessPoolExecutor):  # type: ignore[misc]
    """What `worker_pool` makes, and ends with all its work."""

    def shutdown(self, wait: bool = True, kill_workers: bool = False) -> None:
        """As loky's, and waits for the thread that feeds the workers: else Python may warn of a leak where it ends."""
        queue = self._call_queue
        super().shutdown(wait, kill_workers)
        feeder = None if queue is None else queue._thread
        if wait and feeder is not None:
            feeder.join(1.0)  # one that writes to workers that were killed ends with this process


@contextmanager
def one_thread() -> Iterator[None]:
    """Our loops and BLAS on one thread, where all cores are in use already, or where times are compared."""
    from threadpoolctl import threadpool_limits

    with at_most_threads(1), threadpool_limits(1):
        yield


@contextmanager
def worker_pool(executor: Executor | None = None) -> Iterator[Executor]:
    """The caller's executor, left open, or one process of our own per core. Our processes are started afresh, not
    forked (unsafe where threads hold locks), and do not import the user's script, which needs no ``if __name__ ==
    "__main__"``. They end with this process, or when an exception leaves the block. Raises ChildProcessError where a
    worker was killed."""
    try:
        if executor is not None:
            yield executor
            return
        # loky replaces a worker whose memory has grown; nothing is lost, and a user can do nothing about it.
        warnings.filterwarnings("ignore", "A worker was restarted", UserWarning)
        ends = {"initializer": _end_with_parent, "initargs": (os.getpid(),)}
        pool = _OwnPool(cpu_count(), **ends, env=blas_environment() or None)
        try:
            yield pool
        except BaseException:
            pool.shutdown(wait=True, kill_workers=True)
            raise
        pool.shutdown(wait=True)
    except BrokenExecutor:
        raise ChildProcessError("a worker was killed (is the memory full?): run the same again to go on") from None


@contextmanager
def cancelled_if_left(workers: Executor, futures: Iterable[Future[Any]]) -> Iterator[None]:
    """When an exception leaves the block, cancel the futures that wait in a caller's executor, which lives on. A pool
    of our own ends with all its work anyway (loky 3.7 prints a traceback for futures cancelled before)."""
    try:
        yield
    except BaseException:
        for future in futures if not isinstance(workers, _OwnPool) else ():
            future.cancel()
        raise


def _end_with_parent(parent: int) -> None:
    """Make a worker process end when its parent is killed; left alone it would work, or wait for work, for ever."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the parent, which ends its workers
    pause = threading.Event()

    def watch() -> None:
        while os.getppid() == parent:
            pause.wait(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
