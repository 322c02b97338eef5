"""A scene's [loads]: which loads are wanted, how its patches are pressed, and what goes by the size of that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from casadi_contact.core.conventions import load_selection, pose_index
from casadi_contact.scenes.normal_load import NormalLoad, normal_loads
from casadi_contact.scenes.pose_space import PoseSpace
from casadi_contact.scenes.shapes.checks import distinct_names, fail, identifier, number, table_of


@dataclass(frozen=True)
class LoadsTable:
    """The names, the normal load of each patch, the pose parameters that set these, N0 [N] of a root load, its slope
    out of contact [1/mm] and the load [N] that counts as the boundary of contact."""

    load_names: tuple[str, ...]
    normal_loads: tuple[NormalLoad, ...]
    sensitive_pose: tuple[str, ...]
    reference_load: float
    gap_slope: float
    boundary_load: float

    @classmethod
    def from_table(cls, table: object, patch_names: Sequence[str], space: PoseSpace) -> LoadsTable:
        """Of a scene with these patches and this pose space; raises ValueError naming the key at fault."""
        numbers = ("reference_load", "gap_slope", "boundary_load")
        loads = table_of("loads", table, ("names", "sensitive", *numbers), complete=True, optional=("sensitive_pose",))
        names = tuple(identifier("loads.names", load) for load in distinct_names("loads.names", loads["names"]))
        pressed = normal_loads(distinct_names("loads.sensitive", loads["sensitive"]), patch_names)
        load_selection(names, patch_names)  # refuses a name that is none of a patch's loads
        pose = distinct_names("loads.sensitive_pose", loads["sensitive_pose"]) if "sensitive_pose" in loads else ()
        if any(pose_index(parameter) not in space.free for parameter in pose):
            raise fail("loads.sensitive_pose", list(pose), "pose parameters that are free (see [pose])")
        return cls(names, pressed, pose, *(number(f"loads.{key}", loads[key], low=0.0) for key in numbers))
