"""The CasADi functions that every contact model gives: loads and root loads of a pose, alone and together."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from typing import ClassVar

import casadi as ca

from casadi_contact.conventions import whole_number


def checked_batch(batch: int | None) -> int | None:
    """The number of poses of a function; raises ValueError unless it is a whole number of 1 or more, or None."""
    return None if batch is None else whole_number("batch", batch, 1)


class ContactFunctions(ABC):
    """Functions of a pose that differ in what they give, made by one method, `_function`, of the model."""

    compiled_by_default: ClassVar[bool] = False

    @abstractmethod
    def check_loads(self, loads: Iterable[str] | None) -> tuple[str, ...]:
        """The loads asked for (None: all); ValueError for one that the model does not give."""

    def check_roots(self) -> None:
        """Raise ValueError where the model cannot give root loads."""
        return

    @abstractmethod
    def _function(
        self, name: str, loads: Sequence[str], wanted: Sequence[str], compiled: bool, batch: int | None
    ) -> ca.Function:
        """casadi.Function pose (6) -> the wanted ones of "loads", "roots"; batch: of so many poses, checked."""

    def function(
        self,
        loads: Iterable[str] | None = None,
        name: str = "contact_loads",
        *,
        compiled: bool | None = None,
        batch: int | None = None,
    ) -> ca.Function:
        """casadi.Function pose (6) -> loads (L) with derivatives; batch: (6 x batch) -> (L x batch), in one call.

        Works in ``map`` and in nlpsol. compiled: whether to take a kernel in C where the model has one, compiled once
        and kept in the user's cache folder (None: ``compiled_by_default``); where that fails, one warning and the
        slower form. A kernel has no third derivatives, and is not for `save_function` (the library lies in the cache).
        A function of n poses has CasADi's own name for that, ``mapn_name``.
        Raises ValueError for an unknown load and for a batch that is no whole number of 1 or more.
        """
        return self._made(name, self.check_loads(loads), ("loads",), compiled, batch)

    def root_function(
        self, name: str = "contact_roots", *, compiled: bool | None = None, batch: int | None = None
    ) -> ca.Function:
        """casadi.Function pose (6) -> signed root load of every patch (P); the rest as for `function`."""
        self.check_roots()
        return self._made(name, (), ("roots",), compiled, batch)

    def load_and_root_function(
        self,
        loads: Iterable[str] | None = None,
        name: str = "contact_loads_and_roots",
        *,
        compiled: bool | None = None,
        batch: int | None = None,
    ) -> ca.Function:
        """casadi.Function pose (6) -> loads (L), roots (P): both for the price of the loads."""
        names = self.check_loads(loads)
        self.check_roots()
        return self._made(name, names, ("loads", "roots"), compiled, batch)

    def _made(
        self, name: str, loads: Sequence[str], wanted: Sequence[str], compiled: bool | None, batch: int | None
    ) -> ca.Function:
        chosen = self.compiled_by_default if compiled is None else compiled
        return self._function(name, loads, wanted, chosen, checked_batch(batch))
