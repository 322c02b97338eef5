"""Contact loads of muscle and contact beside those of the elastic foundation and beside measured forces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casadi_contact.core.conventions import Array
from casadi_contact.optimisation.knee import KNEE_LOADS, SIDES
from casadi_contact.optimisation.muscle_walk import at_times
from casadi_contact.scenes.load_cycle import LoadCycle
from problems.common.contact import grids_in_words, models_on_grids
from problems.common.records import rms_and_largest
from problems.muscle_contact.problem import MuscleContact
from problems.muscle_contact.solve import MuscleContactResult


@dataclass(frozen=True)
class Compared:
    """Contact loads (n, 7) as in `KNEE_LOADS` of the problem's model, on the fine EF grid and on the teacher grid,
    which has next to no error of its own, None where there is no EF at hand; measured (n, 2) as in `SIDES`, at the
    walk's times, or None; grids: of the EF, in words."""

    got: Array
    ef: Array | None
    teacher: Array | None
    measured: Array | None
    grids: dict[str, str]

    @classmethod
    def of(cls, problem: MuscleContact, result: MuscleContactResult, measured: LoadCycle | None) -> Compared:
        """Re-evaluate the solution on the scene's fine and teacher EF grids, and take measured forces at its times.

        Raises ValueError where the measured cycle does not reach over the walk (`at_times`).
        """
        scene, walk = problem.contact_model.scene, problem.walk
        columns = [scene.load_names.index(name) for name in KNEE_LOADS]
        models = models_on_grids(scene)
        on = {name: model(result.poses)[:, columns] for name, model in models.items()}
        grids = grids_in_words(models)
        if measured is None:
            return cls(result.loads, on.get("fine"), on.get("teacher"), None, grids)
        sides = np.column_stack([measured.fy_med, measured.fy_lat])
        forces = at_times(f"measured cycle {measured.name}", measured.time_s, sides, walk.time_s)
        return cls(result.loads, on.get("fine"), on.get("teacher"), forces, grids)

    def errors(self) -> dict[str, dict[str, dict[str, float | None]]]:
        """RMS, mean and largest difference [N] by side: predicted minus measured compression, EF minus model."""
        pairs = {
            name: ef - self.got for name, ef in (("fine_ef", self.ef), ("teacher_ef", self.teacher)) if ef is not None
        }
        if self.measured is not None:
            pairs["prediction"] = self.measured - self.got[:, : len(SIDES)]
        return {
            name: {
                key: {**rms_and_largest(off[:, column]), "mean": float(off[:, column].mean())}
                for key, off in pairs.items()
            }
            for column, name in enumerate(SIDES)
        }
