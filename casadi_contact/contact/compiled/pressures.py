"""Pressure outputs of contact models written in C."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np

from casadi_contact.contact.compiled.foundation import BOTH, CompiledFoundation
from casadi_contact.contact.compiled.source import C_FOLDER
from casadi_contact.contact.pressure.outputs import MOMENTS, PressureOutputs
from casadi_contact.contact.twist import by_pose
from casadi_contact.core.compiler import call_in_shares
from casadi_contact.core.conventions import Array, rotation
from casadi_contact.networks.export_c import ExportedModel
from casadi_contact.networks.kernel.source import c_text


class CompiledPressures(CompiledFoundation, PressureOutputs):
    """A `CompiledFoundation` with pressure outputs: in C, or without a compiler in NumPy by the same formulas."""

    @abstractmethod
    def _moments_source(self) -> str:
        """C that defines ``patch_moments`` (see ``c/pressures.h``), after that of `_patch_source`."""

    @abstractmethod
    def _moments_by_twist(self, R: Array, t: Array) -> tuple[Array, Array]:
        """Moments (n, P, 6) and their derivatives by the twist (n, P, 6, 6), in NumPy."""

    def pressure_moments(self, poses: Array) -> tuple[Array, Array]:
        """Moments (n, P, 6) and their derivatives by the pose (n, P, 6, 6), see `contact.pressure.outputs`."""
        if self._pressure_library is None:
            values, by_twist = self._moments_by_twist(rotation(poses[:, 3:]), poses[:, :3])
            return values, by_pose(by_twist, poses)
        shape = (len(poses), len(self.patch_names), MOMENTS)
        values, slopes = np.empty(shape), np.empty((*shape, 6))
        call_in_shares(self._pressure_library, "foundation_moments", poses, values, slopes)
        return values, slopes

    def exported(self, loads: Iterable[str] | None = None) -> ExportedModel:
        """C of the loads, root loads and pressures; raises ValueError for a pressure law without C."""
        model = super().exported(loads)
        source = "\n".join([model.source, self._moments_source(), c_text("pressure_outputs.h", C_FOLDER)])
        return replace(model, source=source, pressure_names=self.pressure_names)

    @cached_property
    def _pressure_library(self) -> Path | None:
        """A kernel of its own, compiled when pressures are first asked for."""
        more = "\n".join([self._moments_source(), c_text("pressures.h", C_FOLDER)])
        return self._kernel(BOTH, self.load_names, ("loads", "roots"), more=more)
