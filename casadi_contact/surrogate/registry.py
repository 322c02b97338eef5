"""The surrogate structures there are, by name: a new structure is its own folder and a line here."""

from __future__ import annotations

from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.patch.surrogate import PatchSurrogate
from casadi_contact.surrogate.two_stage.surrogate import TwoStageSurrogate

STRUCTURES: dict[str, type[Surrogate]] = {kind.structure: kind for kind in (PatchSurrogate, TwoStageSurrogate)}
