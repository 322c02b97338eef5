"""Numba compiles the loops of the contact models at the first evaluation, and keeps them on disk.

Compiled loops lie beside the source (``__pycache__``), in numba's folder of the user's cache, or in
``$NUMBA_CACHE_DIR``; where none can be written, they serve the process that compiled them.
"""

import multiprocessing
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import FunctionCache

_PACKAGE = __name__.partition(".")[0]


class _Cache(FunctionCache):
    """Compiled loops on disk."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Called before a loop is compiled; None where it is not on disk."""
        found = super().load_overload(sig, target_context)
        if found is None:
            _announce_first(Path(self.cache_path))
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Called after a compilation; on a full disc the loops serve this process alone."""
        with suppress(OSError):
            super().save_overload(sig, data)


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """``numba.njit(cache=True, **options)``, which works where the disc is full and where no folder can be written."""

    def compiled(function: Callable[..., Any]) -> Any:
        dispatcher = numba.njit(**options)(function)
        with suppress(RuntimeError):  # where numba finds no folder that can be written
            dispatcher._cache = _Cache(function)  # as Dispatcher.enable_caching does
        return dispatcher

    return compiled


def announce(what: str, folder: Path) -> None:
    """Say on stderr what is being compiled and where it will lie; worker processes stay silent."""
    if multiprocessing.parent_process() is None:
        print(f"{_PACKAGE}: compiling {what}, once (kept in {folder})", file=sys.stderr, flush=True)


@cache
def _announce_first(folder: Path) -> None:
    """Say once per process what the first evaluation waits for."""
    announce("the contact model, about 15 s", folder)
