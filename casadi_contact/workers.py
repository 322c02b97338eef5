"""Worker processes for long work: one per core, gone when their parent is."""

from __future__ import annotations

import multiprocessing
import os
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager


@contextmanager
def worker_pool(executor: Executor | None = None) -> Iterator[Executor]:
    """The caller's executor, left open, or one process per core of our own.

    Our own processes are spawned, not forked (a fork of a process whose OpenMP threads have run is unsafe). They end
    at once where the block is left by an exception, Ctrl-C included, and when this process is killed.
    """
    if executor is not None:
        yield executor
        return
    others = set(multiprocessing.active_children())
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(os.cpu_count(), mp_context=context, initializer=_end_with_parent) as pool:
        try:
            yield pool
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for process in set(multiprocessing.active_children()) - others:
                process.terminate()
            raise


def _end_with_parent() -> None:
    """Make a worker process end when its parent is killed; left alone it would work, or wait for work, for ever."""
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
