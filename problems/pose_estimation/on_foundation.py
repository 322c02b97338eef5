"""What the elastic foundation says of the poses of a solution."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from casadi_contact.contact.pressures import PressureSummary
from casadi_contact.core.conventions import Array
from casadi_contact.optimisation.verification.uncertain_load import uncertain_load_shares, uncertain_load_words
from problems.common.contact import grids_in_words, models_on_grids
from problems.pose_estimation.problem import PoseEstimation
from problems.pose_estimation.solve import PoseResult


@dataclass(frozen=True)
class OnFoundation:
    """What is wanted, (n, wanted), on the fine EF grid, and on the teacher grid, which has next to no error of its own
    and tells the pressures and the shares (n,) of the load that are `uncertain_load_shares`; grids: in words."""

    fine: Array
    teacher: Array
    pressures: PressureSummary
    shares: dict[str, Array]
    grids: dict[str, str]

    @classmethod
    def of(cls, problem: PoseEstimation, result: PoseResult) -> OnFoundation | None:
        """Re-evaluate the solution on the scene's fine and teacher EF grids; None where there is no EF at hand."""
        wanted, scene, poses = problem.wanted, problem.model.scene, result.poses
        models = models_on_grids(scene)
        if not models:
            return None
        columns = [scene.load_names.index(name) for name in wanted.load_names]
        fine, teacher = (wanted.got(models[grid](poses)[:, columns]) for grid in ("fine", "teacher"))
        own = models["teacher"]
        return cls(fine, teacher, own.summary(poses), uncertain_load_shares(own, poses), grids_in_words(models))

    @property
    def caveats(self) -> list[str]:
        """What the verdict does not know of, since solution and elements share it."""
        return list(uncertain_load_words(self.shares).values())

    def record(self) -> dict[str, Any]:
        """A summary's part."""
        return {f"largest_share_{where}": float(share.max()) for where, share in self.shares.items()}
