"""What every contact model with C source can be written out as: C for other programs, and an FMU."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from pathlib import Path

from casadi_contact.core.conventions import as_poses
from casadi_contact.networks.export_c import ExportedModel, export_c
from casadi_contact.networks.names import c_name


class Exportable(ABC):
    """A contact model that gives its C."""

    @property
    @abstractmethod
    def export_title(self) -> str:
        """Scene and kind in words: "knee contact"."""

    @property
    @abstractmethod
    def export_digest(self) -> str:
        """Hexadecimal digits that tell this model from others of the same title; "" for a ready-made one."""

    @property
    def export_name(self) -> str:
        """Default name of exported files and functions: title and digest, so that two models never share one."""
        return c_name(f"{self.export_title} {self.export_digest}".rstrip())

    @abstractmethod
    def exported(self, loads: Iterable[str] | None = None) -> ExportedModel:
        """C of the loads (all if left out), and of all that the model knows of them."""

    @abstractmethod
    def example_pose(self) -> Sequence[float]:
        """A pose (6) that the model is made for, in contact if one is at hand."""

    def export_c(
        self,
        folder: str | Path,
        name: str | None = None,
        loads: Iterable[str] | None = None,
        example_pose: Sequence[float] | None = None,
    ) -> list[Path]:
        """Write C source and header for loads, derivatives and all else that `exported` holds, an example (at
        `example_pose()`, if left out) and a Makefile; return their paths. Errors: see `transcription.export_c`;
        ValueError for a pose that is not six finite numbers."""
        pose = self._pose_or_example(example_pose)
        return export_c(self.exported(loads), folder, name=name or self.export_name, example_pose=pose)

    def export_fmu(
        self,
        path: str | Path,
        name: str | None = None,
        loads: Iterable[str] | None = None,
        start: Sequence[float] | None = None,
    ) -> Path:
        """Write an FMU (see `transcription.fmu`) that starts from a pose (6), from `example_pose()` if left out; return
        its path."""
        from casadi_contact.networks.fmu import export_fmu

        pose = self._pose_or_example(start)
        return export_fmu(self.exported(loads), path, name=name or self.export_name, start=pose)

    def _pose_or_example(self, pose: Sequence[float] | None) -> list[float]:
        """A pose as it is, `example_pose()` for none; raises ValueError unless it is six finite numbers."""
        (checked,) = as_poses([self.example_pose() if pose is None else pose])
        return [float(value) for value in checked]
